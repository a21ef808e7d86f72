"""Base of all packages: errors, configuration, message bytes; no ROS, no law."""

from parallel_robot_base.numba_settings import take_from_environment_alone

take_from_environment_alone()
