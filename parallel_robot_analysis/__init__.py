"""Metrics, claims, timing, reports, the monitor, and the command line of the suite."""

import parallel_robot_base  # noqa: F401, before Numba
