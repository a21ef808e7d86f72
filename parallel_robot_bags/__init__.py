"""Bags: written, read, recovered, recorded, played."""

import parallel_robot_base  # noqa: F401, before Numba
