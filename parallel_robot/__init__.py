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

PLACES = {  # what is offered, and its module
    name: module
    for module, names in {
        'parallel_robot.analysis.export': 'export',
        'parallel_robot.analysis.replay.bag_replay': 'replay',
        'parallel_robot.analysis.replay.bag_rerun': 'rerun',
        'parallel_robot.analysis.report.report_files': 'report',
        'parallel_robot.analysis.video_file': 'video',
        'parallel_robot.bags.writing.recovery': 'recover',
        'parallel_robot.python.descriptions': 'show urdf',
        'parallel_robot.python.notebook': 'compare grid load metrics plot save',
        'parallel_robot.python.spectra': 'linearise spectrum',
        'parallel_robot.python.written_tables': 'laws scenarios table',
        'parallel_robot.studies.benchmark.benchmark': 'benchmark check_score',
        'parallel_robot.studies.calibration.bag_calibration': 'calibrate',
        'parallel_robot.studies.calibration.design': 'calibration_poses',
        'parallel_robot.studies.identification.bag_identification': 'identify sensor_noise',
        'parallel_robot.studies.identification.design': 'exciting_motion',
        'parallel_robot.studies.least_errors': 'limit',
        'parallel_robot.studies.sweep.sweep': 'sweep',
        'parallel_robot.studies.tuning.tuned': 'tune',
        'parallel_robot.studies.tuning.front': 'fronts',
        'parallel_robot.studies.verification': 'verify',
        'parallel_robot_control.foreign.c_law': 'get_include',
        'parallel_robot_model.common.errors': 'BagError InputError ParallelRobotError RunError',
        'parallel_robot_sim.scenario_run': 'Run simulate',
    }.items()
    for name in names.split()
}
__all__ = [
    'BagError', 'InputError', 'ParallelRobotError', 'Run', 'RunError', 'benchmark', 'calibrate',
    'calibration_poses', 'check_score', 'compare', 'exciting_motion', 'export', 'fronts',
    'get_include', 'grid', 'identify', 'laws', 'limit', 'linearise', 'load', 'metrics', 'plot',
    'recover', 'replay', 'report', 'rerun', 'save', 'scenarios', 'sensor_noise', 'show',
    'simulate', 'spectrum', 'sweep', 'table', 'tune', 'urdf', 'verify', 'video',
]  # fmt: skip

if TYPE_CHECKING:
    from parallel_robot.analysis.export import export
    from parallel_robot.analysis.replay.bag_replay import replay
    from parallel_robot.analysis.replay.bag_rerun import rerun
    from parallel_robot.analysis.report.report_files import report
    from parallel_robot.analysis.video_file import video
    from parallel_robot.bags.writing.recovery import recover
    from parallel_robot.python.descriptions import show, urdf
    from parallel_robot.python.notebook import (
        compare,
        grid,
        load,
        metrics,
        plot,
        save,
    )
    from parallel_robot.python.spectra import linearise, spectrum
    from parallel_robot.python.written_tables import laws, scenarios, table
    from parallel_robot.studies.benchmark.benchmark import benchmark, check_score
    from parallel_robot.studies.calibration.bag_calibration import calibrate
    from parallel_robot.studies.calibration.design import calibration_poses
    from parallel_robot.studies.identification.bag_identification import identify, sensor_noise
    from parallel_robot.studies.identification.design import exciting_motion
    from parallel_robot.studies.least_errors import limit
    from parallel_robot.studies.sweep.sweep import sweep
    from parallel_robot.studies.tuning.front import fronts
    from parallel_robot.studies.tuning.tuned import tune
    from parallel_robot.studies.verification import verify
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
        if name in PLACES:
            return getattr(import_module(PLACES[name]), name)
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')

    def __dir__() -> list[str]:
        return sorted([*globals(), *__all__])
