"""Simulate, compare and analyse sliding-mode control of parallel robots.

>>> import parallel_robot as pr
>>> run = pr.simulate('paper_circle', law='smc', duration=1)
>>> round(pr.metrics(run).steady.xy_rms_m, 6)
0.001386

What is offered here is imported when it is used first: the compiler takes a second. Files of users
import :mod:`parallel_robot.law`, :mod:`parallel_robot.robot` or :mod:`parallel_robot.trajectory`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import parallel_robot_model  # noqa: F401, before Numba

__all__ = [
    'InputError', 'ParallelRobotError', 'Run', 'RunError', 'compare', 'grid', 'load', 'metrics',
    'plot', 'save', 'simulate', 'sweep',
]  # fmt: skip

if TYPE_CHECKING:
    from parallel_robot.studies.notebook import (
        compare,
        grid,
        load,
        metrics,
        plot,
        save,
        sweep,
    )
    from parallel_robot_model.common.errors import InputError, ParallelRobotError, RunError
    from parallel_robot_sim.scenario_run import Run, simulate
else:

    def __getattr__(name: str) -> Any:
        if name not in __all__:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        place = 'parallel_robot.studies.notebook'
        if name in ('Run', 'simulate'):
            place = 'parallel_robot_sim.scenario_run'
        elif name.endswith('Error'):
            place = 'parallel_robot_model.common.errors'
        return getattr(import_module(place), name)

    def __dir__() -> list[str]:
        return sorted([*globals(), *__all__])
