"""The simulated plant, the plant node, and the closed loop without ROS."""

import parallel_robot_model  # noqa: F401, before Numba
