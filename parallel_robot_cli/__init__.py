"""The command line `parallel_robot`, its commands, and `top`."""

import parallel_robot_base  # noqa: F401, before Numba
