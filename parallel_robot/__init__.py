"""Simulate, compare and analyse sliding-mode control of parallel robots.

>>> import parallel_robot as pr
>>> run = pr.simulate('paper_circle', law='smc', duration=1)
>>> round(pr.metrics(run)['xy_rms_m'], 6)
0.001386

What is offered here is imported when it is used first: the compiler takes a second. Files of users
import :mod:`parallel_robot.law`, :mod:`parallel_robot.robot` or :mod:`parallel_robot.trajectory`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import parallel_robot_model  # noqa: F401, before Numba

_PLACES = {  # module to what it offers
    'parallel_robot.python.descriptions': ('show', 'urdf'),
    'parallel_robot.python.estimation': ('calibrate', 'identify'),
    'parallel_robot.python.notebook': (
        'compare', 'grid', 'load', 'metrics', 'plot', 'save', 'sweep',
    ),
    'parallel_robot.python.presentations': ('export', 'replay', 'report', 'rerun', 'video'),
    'parallel_robot.python.spectra': ('linearise', 'spectrum'),
    'parallel_robot.python.studies': ('benchmark', 'fronts', 'limit', 'recover', 'tune', 'verify'),
    'parallel_robot.python.written_tables': ('laws', 'scenarios', 'table'),
    'parallel_robot_control.foreign.c_law': ('get_include',),
    'parallel_robot_model.common.errors': (
        'BagError', 'InputError', 'ParallelRobotError', 'RunError',
    ),
    'parallel_robot_sim.scenario_run': ('Run', 'simulate'),
}  # fmt: skip
__all__ = [
    'BagError', 'InputError', 'ParallelRobotError', 'Run', 'RunError', 'benchmark', 'calibrate',
    'compare', 'export', 'fronts', 'get_include', 'grid', 'identify', 'laws', 'limit',
    'linearise', 'load', 'metrics', 'plot', 'recover', 'replay', 'report', 'rerun', 'save',
    'scenarios', 'show', 'simulate', 'spectrum', 'sweep', 'table', 'tune', 'urdf', 'verify',
    'video',
]  # fmt: skip

if TYPE_CHECKING:
    from parallel_robot.python.descriptions import show, urdf
    from parallel_robot.python.estimation import calibrate, identify
    from parallel_robot.python.notebook import (
        compare,
        grid,
        load,
        metrics,
        plot,
        save,
        sweep,
    )
    from parallel_robot.python.presentations import export, replay, report, rerun, video
    from parallel_robot.python.spectra import linearise, spectrum
    from parallel_robot.python.studies import benchmark, fronts, limit, recover, tune, verify
    from parallel_robot.python.written_tables import laws, scenarios, table
    from parallel_robot_control.foreign.c_law import get_include
    from parallel_robot_model.common.errors import (
        BagError,
        InputError,
        ParallelRobotError,
        RunError,
    )
    from parallel_robot_sim.scenario_run import Run, simulate
else:

    def __getattr__(name: str) -> Any:
        for place, names in _PLACES.items():
            if name in names:
                return getattr(import_module(place), name)
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')

    def __dir__() -> list[str]:
        return sorted([*globals(), *__all__])
