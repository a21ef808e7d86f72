"""The code of a user that a bag holds: kept, shown, and whether it may run."""
