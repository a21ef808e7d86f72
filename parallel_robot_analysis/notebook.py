"""Metrics, pictures, bags and sweeps from Python, for scripts and notebooks."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import yaml

from parallel_robot_analysis import metrics as evaluation
from parallel_robot_analysis.metrics import Metrics, Poses
from parallel_robot_analysis.report import figures
from parallel_robot_analysis.study import study as studies
from parallel_robot_analysis.study import table
from parallel_robot_analysis.study.plan import plan
from parallel_robot_analysis.study.store import RUNS
from parallel_robot_analysis.study.sweep import MOST_WORKERS, default_workers
from parallel_robot_analysis.study.sweep import sweep as run_sweep
from parallel_robot_analysis.study.workers import Processes
from parallel_robot_bags import history, run_log, simulation_bag
from parallel_robot_bags.limits import MEMORY
from parallel_robot_bags.statuses import LIMIT_TEXT
from parallel_robot_base.errors import BagError, InputError, KinematicsError, RunError
from parallel_robot_base.fields import Field, check
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_sim.scenario_run import Run

RESOLUTION = 70  # dots per inch of a picture in a notebook

Frame = Any  # a pandas.DataFrame; pandas is optional, and untyped


@dataclass(frozen=True)
class _Drawn:
    """A run as metrics and figures take it; see figures.NamedMotion."""

    scenario: str
    law: str
    joints: tuple[str, ...]
    time: np.ndarray
    position: np.ndarray
    reference_position: np.ndarray
    effort: np.ndarray


class Picture:
    """A figure that a notebook shows.

    Attributes:
        figure: The figure of matplotlib.
    """

    def __init__(self, figure: Any) -> None:
        self.figure = figure

    def save(self, path: str | Path) -> None:
        """Write a PNG, PDF or SVG file, which must not exist.

        Raises:
            InputError: the suffix is of no picture format, or the file cannot be written.
        """
        try:
            figures.save(self.figure, path)
        except OSError as error:
            raise InputError(f'cannot write {path}: {error.strerror}') from None

    def __repr__(self) -> str:
        return 'Picture'

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.figure.savefig(content, format='png', dpi=RESOLUTION)
        return content.getvalue()


def load(bag: str | Path, *, memory: int = MEMORY) -> Run:
    """Read a bag as a run.

    Args:
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of it [bytes].

    Raises:
        BagError: not a bag, or one that is not of a run or takes too much.
    """
    log, past = run_log.read(bag, memory), history.read(bag, memory)
    try:
        log, poses, cut = evaluation.with_poses(log)
    except KinematicsError as error:
        raise BagError(f'{bag}: {error}') from None
    first = next((status for status in past.statuses if status.fault != NO_FAULT), None)
    limits = {LIMIT_TEXT.get(code, code) for status in past.statuses for code in status.limits}
    return Run(
        log.scenario,
        log.law,
        log.joints,
        log.config,
        log.time,
        log.position,
        log.velocity,
        log.reference_position,
        log.reference_velocity,
        log.effort,
        poses.actual,
        poses.reference,
        poses.planar,
        first and ((first.stamp - log.start_stamp) / NANOSECONDS, first.fault_text),
        ', '.join(sorted(limits)),
        (*log.warnings, *([cut] if cut else [])),
    )


def save(run: Run, bag: str | Path) -> None:
    """Write a simulated run as a bag, the one that ``parallel_robot simulate`` writes.

    Args:
        run: What ``simulate`` returned.
        bag: Its directory, which must not exist.

    Raises:
        InputError: the run is not a simulation, or the directory exists or cannot be made.
        RunError: the disk is full.
    """
    if run.simulation is None:
        raise InputError('only a simulated run can be saved; this one is from a bag')
    try:
        simulation_bag.write(bag, run.values, run.simulation)
    except OSError as error:
        raise RunError(f'cannot write {bag}: {error.strerror}') from None


def metrics(run: Run) -> Metrics:
    """Metrics of a run, in SI units.

    >>> from parallel_robot_sim import simulate
    >>> found = metrics(simulate('paper_circle', law='smc', duration=2))
    >>> round(found.torque.max_nm, 2)
    8.24
    """
    return evaluation.evaluate(_drawn(run), _poses(run))


def compare(runs: Iterable[Run] | Mapping[str, Run]) -> Frame:
    """Metrics of several runs as a pandas.DataFrame, one row each.

    >>> from parallel_robot_sim import simulate
    >>> laws = ('smc', 's_smc')
    >>> found = compare(simulate('paper_circle', law=law, duration=2) for law in laws)
    >>> found.torque_max_nm.round(2).to_dict()
    {'smc': 8.24, 's_smc': 16.97}

    Args:
        runs: The runs, or name to run; without names the rows are named after the laws.

    Returns:
        Columns with units in their names, as those of a sweep; a bound that is never reached is
        infinite, a metric that the robot does not have is NaN.

    Raises:
        InputError: something among them is not a run, or pandas is not installed.
    """
    named = dict(runs) if isinstance(runs, Mapping) else _named(runs)
    for run in named.values():
        if not isinstance(run, Run):
            raise InputError(f'compare takes runs, not {run!r}')
    rows = []
    for run in named.values():
        found = metrics(run)
        values = {name: of(found) for name, of in table.METRICS.items()}
        rows.append({'scenario': run.scenario, 'law': run.law, **values})
    frame: Frame = _pandas().DataFrame(rows, index=list(named))
    return frame


def plot(run: Run) -> Picture:
    """Path, errors and torques of a run as a picture, which a notebook shows."""
    return Picture(figures.figure_of_run(_drawn(run), _poses(run)))


def sweep(
    study: str | Path | Mapping[str, Any],
    out: str | Path,
    *,
    runs: int | None = None,
    workers: int | None = None,
    **values: Any,
) -> Frame:
    """Run a study on several cores, or what is left of it, as ``parallel_robot sweep`` does.

    Args:
        study: File of a study, name of one in ``config/studies``, or its keys and values.
        out: Directory of the results; new, or that of the same sweep, which is continued.
        runs: Runs of each law and scenario; default: the study's.
        workers: Processes; default: one for each core.
        values: Keys of the configuration and their values in all runs.

    Returns:
        The table of the runs, one row each, as a pandas.DataFrame; see docs/studies.md.

    Raises:
        InputError: something in the study or in the arguments is wrong.
        RunError: workers cannot run it, or the disk is full; finished rows are kept.
    """
    pandas = _pandas()
    if isinstance(study, Mapping):
        text, name, folder = _as_yaml(study), 'study', None
    elif isinstance(study, str | Path):
        file = studies.file_of(str(study))
        text, name, folder = studies.read(file), str(file), file.parent
    else:
        raise InputError(f'study must be a name, a path or keys and values, not {study!r}')
    asked = studies.parse(text, name, folder).changed(runs, values)
    given = default_workers() if workers is None else workers
    count = check('workers', int, Field('', '', 1, MOST_WORKERS), given)
    directory = Path(out)
    run_sweep(plan(asked), text, directory, Processes(count), count)
    frame: Frame = pandas.read_parquet(directory / RUNS)
    return frame


def _as_yaml(study: Mapping[str, Any]) -> str:
    try:
        return yaml.safe_dump(dict(study), sort_keys=False)
    except yaml.YAMLError:
        raise InputError('study must hold plain numbers, texts, lists and mappings') from None


def _named(runs: Iterable[Run]) -> dict[str, Run]:
    """Runs by the names of their laws, with a number where there are several of one."""
    seen: Counter[str] = Counter()
    named = {}
    if isinstance(runs, Run) or not isinstance(runs, Iterable):
        raise InputError('compare takes several runs: a list, or name to run')
    for run in runs:
        law = run.law if isinstance(run, Run) else ''
        seen[law] += 1
        named[law if seen[law] == 1 else f'{law} #{seen[law]}'] = run
    return named


def _drawn(run: Run) -> _Drawn:
    if not isinstance(run, Run):
        raise InputError(f'a run is wanted, as of simulate or load, not {run!r}')
    names = run.scenario, run.law, run.joints
    return _Drawn(*names, run.time, run.position, run.reference, run.torque)


def _poses(run: Run) -> Poses:
    return Poses(run.pose, run.pose_reference, run.planar)


def _pandas() -> ModuleType:
    """The module pandas.

    Raises:
        InputError: it is not installed.
    """
    try:
        import pandas  # optional
    except ImportError:
        raise InputError('pandas is not installed; pip install pandas') from None
    found: ModuleType = pandas
    return found
