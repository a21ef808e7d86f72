"""Control laws, the control cycle around them, and the controller node."""

import parallel_robot_model  # noqa: F401, before Numba
