"""What all nodes share: parameters, topics, life cycle, diagnostics."""

import parallel_robot_base  # noqa: F401, before Numba
