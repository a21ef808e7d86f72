"""Studies: sweeps over uncertain robots, tuning, limits of any controller, identification."""

import parallel_robot_base  # noqa: F401, before Numba
