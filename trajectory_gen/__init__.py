"""Reference motions of the platform, their check before the start, and the trajectory node."""

import parallel_robot_model  # noqa: F401, before Numba
