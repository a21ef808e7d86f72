"""Metrics, pictures and bags from Python, for scripts and notebooks."""

from __future__ import annotations

import html
import io
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from parallel_robot.analysis import metrics as evaluation
from parallel_robot.analysis import pictures, readable_metrics, recorded_motions
from parallel_robot.analysis.metrics import METRICS, Metrics
from parallel_robot.analysis.readable_metrics import (
    NEVER,
    defined,
    early,
    shown,
    unsettled,
    window,
)
from parallel_robot.analysis.report import figures
from parallel_robot.analysis.report.looks import AUTO, law_label
from parallel_robot.analysis.table import sliding_variable
from parallel_robot.bags.bag_reader import view
from parallel_robot.bags.history import LIMIT_TEXT
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recorded_robot
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.studies.sweep import store
from parallel_robot_control import law_loader
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.errors import (
    BagError,
    Frame,
    InputError,
    KinematicsError,
    RunError,
    pandas,
)
from parallel_robot_model.common.options import path
from parallel_robot_model.common.tables import Part, ShownResult
from parallel_robot_model.common.units import NANOSECONDS, JointUnits, all_of
from parallel_robot_model.configuration.config import Changes, Place
from parallel_robot_model.messages.topics import SLIDING_VARIABLE
from parallel_robot_sim.motions import Motions, of_simulation
from parallel_robot_sim.scenario_run import Run, simulate

RESOLUTION = 70  # dots per inch of a picture in a notebook


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
        pictures.save(self.figure, path)

    def __repr__(self) -> str:
        return 'Picture'

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.figure.savefig(content, format='png', dpi=RESOLUTION)
        return content.getvalue()


def load(
    bag: Place,
    *,
    memory: int = MEMORY,
    trust: bool = False,
    topic: Mapping[str, str] | None = None,
    namespace: str | None = None,
    joints: Sequence[str] = (),
    scenario: Place | None = None,
    param_file: Changes = None,
    override: bool = False,
    start: float | None = None,
    stop: float | None = None,
    **values: Any,
) -> Run:
    """Read a bag as a run.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/loaded')
    >>> pr.load('runs/loaded').error.shape
    (101, 3)

    Args:
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of it [bytes].
        trust: Whether the code of its robot may run, where the bag holds it: with all your rights.
        topic: Topics of the bag in place of those of the suite, e.g.
            ``{'joint_states': '/robot1/joint_states'}``.
        namespace: Of the robot, in a bag of several.
        joints: Names of the joints in the bag, in the order of those of the robot.
        scenario: What a bag without a configuration is of; default: ``paper_circle``.
        param_file: YAML file or mapping of keys of the configuration of such a bag, or several.
        override: Whether scenario, joints, file and values take the place of what a bag says.
        start: Time from which on it is read [s]; default: from the first state.
        stop: Time up to which it is read [s]; default: to the last state.
        values: Keys of the configuration of a bag without one, and their values; of any bag
            ``custom_robots``, files of robots of yours, which take the place of that in the bag.

    Raises:
        BagError: not a bag, or one that is not of a run or takes too much; or its robot is in
            neither bag nor files.
        InputError: a file is not a robot, or `bag` is no path.
    """
    bag = path('bag', bag)
    asked = view(
        topic=topic,
        namespace=namespace,
        joints=joints,
        scenario=scenario,
        override=override,
        start=start,
        stop=stop,
        param_file=param_file,
        **values,
    )
    code = recorded_robot.code_of(trust, asked)
    log, past, extra = recorded_robot.read(bag, memory, code, (SLIDING_VARIABLE,), asked)
    law_loader.learn_titles(past.sources['custom_laws'])
    try:
        part = recorded_motions.of_bag(log, past)
    except KinematicsError as error:
        raise BagError(f'{bag}: {error}') from None
    log = part.log
    time = part.motions.best.time
    ended = early(float(time[-1] - time[0]), float(log.config['duration']))
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
        part.pose,
        part.poses.reference,
        log.stamps,
        log.reference_acceleration,
        log.answer,
        sliding_variable(log, extra),
        part.poses.place,
        first and ((first.stamp - log.start_stamp) / NANOSECONDS, first.fault_text),
        ', '.join(sorted(limits)),
        (*log.warnings, *filter(None, [part.cut, ended]), *part.remarks, *part.doubts),
        motions=part.motions,
        name=bag.resolve().name.removesuffix('.mcap'),
        has_efforts=log.has_efforts,
    )


def save(run: Run, bag: str | Path) -> None:
    """Write a simulated run as a bag, the one that ``parallel_robot simulate`` writes.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/saved')

    Args:
        run: What ``simulate`` returned.
        bag: Its directory, which must not exist.

    Raises:
        InputError: the run is not a simulation, or the directory exists or cannot be made.
        RunError: the disk is full.
    """
    if run.simulation is None:
        raise InputError('only a simulated run can be saved; this one is from a bag')
    simulation_bag.save(bag, run.values, [run.simulation])


class RunMetrics(ShownResult, Metrics):
    """Metrics that are shown as a table; by their keys they are in SI units."""

    def _rows(self) -> list[tuple[str, str, str]]:
        metrics = (one.in_units(self.units) for one in defined(METRICS, self))
        found = [(one, shown(one.printed(self))) for one in metrics]
        return [(one.name, value, one.unit if value != NEVER else '') for one, value in found]

    def parts(self) -> list[Part]:
        """A row for each metric, with its unit, and what they are of."""
        return [readable_metrics.table(self._rows()), *self._notes()]

    def _notes(self) -> list[str]:
        return [f'errors over {window(self)}', *unsettled(self)]

    def _repr_html_(self) -> str:
        """The same for a notebook."""
        rows = (''.join(f'<td>{word}</td>' for word in row) for row in self._rows())
        notes = '<br>'.join(map(html.escape, self._notes()))
        return f'<table>{"".join(f"<tr>{row}</tr>" for row in rows)}</table>{notes}'


def metrics(run: Run, *, start: float | None = None, stop: float | None = None) -> RunMetrics:
    """Metrics of a run, in SI units; shown as a table in units that fit.

    >>> import parallel_robot as pr
    >>> found = pr.metrics(pr.simulate('paper_circle', law='smc', duration=2))
    >>> round(found['torque_max_nm'], 2)
    8.24

    Args:
        run: The run.
        start: Time from which on it is looked at [s]; all metrics are then of that part.
        stop: Time up to which it is looked at [s], likewise.

    Raises:
        InputError: there is none of the run between `start` and `stop`.
    """
    return RunMetrics(**vars(evaluation.figures(motions_of(run), start, stop)))


def compare(runs: Iterable[Run] | Mapping[str, Run]) -> Frame:
    """Metrics of several runs as a pandas.DataFrame, one row each.

    >>> import parallel_robot as pr
    >>> laws = ('smc', 's_smc')
    >>> found = pr.compare(pr.simulate('paper_circle', law=law, duration=2) for law in laws)
    >>> found.torque_max_nm.round(2).to_dict()
    {'smc': 8.24, 's_smc': 16.97}

    Args:
        runs: The runs, or name to run; without names the rows are named after bags or laws.

    Returns:
        Columns with units in their names, as those of a sweep; a bound that is never reached is
        infinite, a metric that the robot does not have is NaN.

    Raises:
        InputError: something among them is not a run, or pandas is not installed.
    """
    named = _named('compare', runs)
    rows = []
    for run in named.values():
        found = metrics(run)
        rows.append({'scenario': run.scenario, 'law': run.law, **store.columns_of(found)})
    frame: Frame = pandas().DataFrame(rows, index=list(named))
    return _told(frame, [run.units for run in named.values()])


def grid(
    scenario: str | Path,
    law: str | Path,
    choices: Mapping[str, Iterable[Any]],
    *,
    duration: float | None = None,
    **values: Any,
) -> Frame:
    """Run a law with every combination of some values.

    >>> import parallel_robot as pr
    >>> gains = {'smc.z': [10, 25], 'smc.u': [0.2, 0.7]}
    >>> found = pr.grid('paper_circle', 'smc', gains, duration=2)
    >>> found[['smc.z', 'smc.u', 'torque_max_nm']].round(2).values.tolist()
    [[10.0, 0.2, 10.9], [10.0, 0.7, 4.38], [25.0, 0.2, 13.96], [25.0, 0.7, 10.16]]

    Args:
        scenario: Name or file of a scenario.
        law: Control law, or its file.
        choices: Key of the configuration to the values that it takes.
        duration: Length of the motion [s], see ``simulate``.
        values: Other keys and their values in all runs.

    Returns:
        A pandas.DataFrame with one row a combination, the last key changing fastest: the values,
        ``status`` and ``reason`` and the metrics, as in the table of a sweep.

    Raises:
        InputError: a key or a value is wrong, or pandas is not installed.
    """
    frames = pandas()
    for key, some in choices.items():
        if isinstance(some, str) or not isinstance(some, Iterable):
            raise InputError(f'{key} must have a list of values, not {some!r}')
    rows, units = [], []
    for combination in itertools.product(*choices.values()):
        chosen = dict(zip(choices, combination, strict=True))
        row = {**chosen, 'status': 'ok', 'reason': ''}
        try:
            run = simulate(scenario, law=law, duration=duration, **{**values, **chosen})
        except RunError as error:
            row |= {'status': 'failed', 'reason': str(error)}
        else:
            if run.fault is not None:
                row |= {'status': 'fault', 'reason': f'{run.fault[1]} at t = {run.fault[0]:.3f} s'}
            found = metrics(run)
            row |= store.columns_of(found)
            units.append(found.units)
        rows.append(row)
    columns = [*choices, 'status', 'reason', *store.COLUMNS]
    return _told(frames.DataFrame(rows, columns=columns), units)


def _told(frame: Frame, units: Iterable[JointUnits]) -> Frame:
    """A frame of metrics, named after the units of the joints of all its runs."""
    key = all_of(units).key
    return frame.rename(columns={name: key(name) for name in store.COLUMNS})


def plot(runs: Run | Iterable[Run] | Mapping[str, Run], *, scale: str = AUTO) -> Picture:
    """Path, errors and torques as a picture, which a notebook shows.

    >>> import parallel_robot as pr
    >>> pr.plot(pr.simulate('paper_circle', law='smc', duration=0.1)).save('smc.pdf')

    Args:
        runs: A run; or several, which are drawn over one another, or name to run.
        scale: Of errors: 'linear'; 'log', their magnitude; 'auto', log where a curve would look
            like zero.

    Raises:
        InputError: something among them is not a run, they are too many, or the scale is unknown.
    """
    if isinstance(runs, Run):
        return Picture(figures.figure_of_run(runs, motions_of(runs).best, scale))
    named = _named('plot', runs, law_label)
    if not 1 <= len(named) <= len(pictures.RUNS):
        raise InputError(f'plot takes up to {len(pictures.RUNS)} runs, not {len(named)}')
    drawn = {name: (run, motions_of(run).best) for name, run in named.items()}
    return Picture(figures.figure_of_runs(drawn, scale))


def _named(
    caller: str,
    runs: Iterable[Run] | Mapping[str, Run],
    title: Callable[[str], str] = str,
) -> dict[str, Run]:
    """Runs by name; without names by their bags or laws, with a number for several of one.

    Raises:
        InputError: something is not a run.
    """
    if isinstance(runs, Run) or not isinstance(runs, Iterable):
        raise InputError(f'{caller} takes several runs: a list, or name to run')
    members = list(runs.values()) if isinstance(runs, Mapping) else list(runs)
    for run in members:
        if not isinstance(run, Run):
            raise InputError(f'{caller} takes runs, not {run!r}')
    if isinstance(runs, Mapping):
        return {str(name): run for name, run in runs.items()}
    seen: Counter[str] = Counter()
    named = {}
    for run in members:
        name = run.name or title(run.law)
        seen[name] += 1
        number = '' if seen[name] == 1 else f' #{seen[name]}'
        named[name + number] = run
    return named


def motions_of(run: Run) -> Motions:
    """The motions of a run.

    Raises:
        InputError: it is not a run.
    """
    if not isinstance(run, Run):
        raise InputError(f'a run is wanted, as of simulate or load, not {run!r}')
    if run.simulation is not None:
        return of_simulation(run.simulation)
    assert run.motions is not None  # it is from a bag
    return run.motions
