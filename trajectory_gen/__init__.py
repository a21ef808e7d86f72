"""Reference motions of the platform, their check before the start, and the trajectory node."""
