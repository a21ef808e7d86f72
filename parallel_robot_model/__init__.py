"""Robots: parameters, kinematics, singularities, dynamics."""

import parallel_robot_base  # noqa: F401, before Numba
