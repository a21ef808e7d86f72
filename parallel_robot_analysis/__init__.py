"""What a run was like: metrics, claims, timing, replay, report, video; the monitor."""

import parallel_robot_base  # noqa: F401, before Numba
