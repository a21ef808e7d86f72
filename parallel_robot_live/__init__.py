"""The live page: a robot that moves, in a browser."""

import parallel_robot_base  # noqa: F401, before Numba
