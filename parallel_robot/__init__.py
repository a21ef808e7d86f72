"""Bags, analysis, studies, the command line and the page."""

import parallel_robot_model  # noqa: F401, before Numba
