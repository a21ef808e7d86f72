"""The least errors of the robots of a scenario, or of a study: as tables, rows and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.pictures import RUNS, check_new, save, stacked
from parallel_robot.analysis.readable_metrics import shown
from parallel_robot.bags import output
from parallel_robot.bags.output import tracked, without_mathematics
from parallel_robot.studies.calm import CAUSES, NEGLIGIBLE, REST, WHOLE, LeastError, least_error
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import Frame, InputError, pandas
from parallel_robot_model.common.options import named, optional_path
from parallel_robot_model.common.tables import (
    Part,
    ShownResult,
    Table,
    comma_separated,
    returning,
)
from parallel_robot_model.common.units import HINGES, JointUnits, all_of
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.config import Changes, Place, changes
from parallel_robot_model.configuration.config_files import (
    MAX_BASES,
    absolute_scenario,
    scenario_stem,
)
from parallel_robot_model.configuration.plain_data import merged
from parallel_robot_sim.configuration import Configuration, configure
from parallel_robot_sim.imperfections import ENCODERS
from parallel_robot_sim.simulation import ENDLESS
from trajectory_gen.configuration import with_duration

# The price of calm as a picture: least error against chattering.

WIDTH, HEIGHT = 6.5, 4.2  # in
GRID = np.logspace(-1.5, 1.0, 60)  # N m, of chattering


def draw(found: Mapping[str, Sequence[LeastError]], error: str, units: JointUnits) -> Any:
    """Draw the robots of each scenario, and their median.

    Args:
        found: Scenario to its robots.
        error: Name and unit of the error.
        units: Units of the joints.
    """
    figure, (panel,) = stacked(WIDTH, [HEIGHT])
    for k, (scenario, members) in enumerate(found.items()):
        color = RUNS[k % len(RUNS)].light
        known = [one.calm for one in members if one.calm is not None]
        for each in known:
            panel.plot(each.chattering, 1e6 * each.error, color=color, alpha=0.25, linewidth=0.7)
        if known:
            values = np.array([[1e6 * each.at(level) for level in GRID] for each in known])
            whole = np.isfinite(values).all(axis=0)
            middle = np.median(values[:, whole], axis=0)
            name = without_mathematics(scenario)
            panel.plot(GRID[whole], middle, color=color, linewidth=2.2, label=f'{name}: median')
            limit = 1e6 * np.median([one.errors[WHOLE] for one in members if one.calm])
            panel.axhline(limit, color=color, linestyle=':', label=f'{name}: limit, median')
    panel.set_xscale('log')
    panel.set_yscale('log')
    panel.set_xlabel(units.label('torque, chattering [N m]'))
    panel.set_ylabel(f'least {error}')
    panel.grid(alpha=0.3, which='both')
    if panel.lines:
        panel.legend(fontsize=8)
    return figure


LEVELS = (0.1, 0.2, 0.3, 0.5, 1.0, 2.0)  # N m, of chattering
RIGID = 'compliance, stiction: the limit is that of rigid gears that do not stick: no bound'
ESTIMATE = 'encoders: their step counts as noise: an estimate, no bound'
TRAVELLED = 'travelled while a state is late'
GEOMETRY = 'joints exact, geometry as it is'


@dataclass(frozen=True, repr=False)
class LeastErrors(ShownResult):
    """The least errors of some robots."""

    members: Mapping[str, list[LeastError]]  # name of a scenario to its robots
    planar: bool  # whether errors are those of the end effector [m], not of joints [rad]
    calm: bool  # whether the price of calm was asked for
    warnings: tuple[str, ...]  # what to know of them, one line each
    units: JointUnits = HINGES  # units of the joints of all robots
    # weight of joints that the error does not see in the price of calm, relative
    rest: float = REST
    out: Path | None = None  # file of the rows
    figure: Path | None = None  # that of the picture

    def parts(self) -> list[Part]:
        """The tables."""
        parts: list[Part] = []
        for scenario, members in self.members.items():
            parts += _table(scenario, members, self.planar, self.units)
            if self.calm:
                parts += _calm_table(members, self.planar, self.units, self.rest)
        return parts

    def rows(self) -> tuple[list[str], list[list[Any]]]:
        """Names of columns, and one row for each robot in SI units; NaN for what is not known."""
        unit = 'm' if self.planar else 'rad'
        errors = [f'{name.replace(" ", "_")}_{unit}' for name in CAUSES]
        calm = any(one.calm for members in self.members.values() for one in members)
        levels = LEVELS if calm else ()
        head = ['scenario', 'sample', *errors, 'travelled_m', f'geometry_{unit}']
        head += [f'at_{level:g}_nm_{unit}' for level in levels]
        rows = []
        for scenario, members in self.members.items():
            for k, one in enumerate(members):
                prices = [one.calm.at(level) if one.calm else math.nan for level in levels]
                causes = [*one.errors.values(), one.travelled, one.geometry]
                rows.append([scenario, k, *causes, *prices])
        return [*map(self.units.key, head)], rows

    def as_data(self) -> list[dict[str, Any]]:
        """The rows as plain data."""
        head, rows = self.rows()
        return [dict(zip(head, row, strict=True)) for row in rows]

    def frame(self) -> Frame:
        """The rows as a pandas.DataFrame."""
        head, rows = self.rows()
        frame: Frame = pandas().DataFrame(rows, columns=head)
        frame.attrs['warnings'] = self.warnings
        return frame

    def file_lines(self) -> list[str]:
        """The files that were written."""
        files = {'rows': self.out, 'figure': self.figure}
        return [f'{name:8}{path}' for name, path in files.items() if path]

    def csv(self) -> str:
        """The rows as comma-separated values."""
        head, rows = self.rows()
        known = (['' if value != value else value for value in row] for row in rows)
        return comma_separated(head, known)

    def save_figure(self, path: Path) -> None:
        """Draw the price of calm into a file, which must not exist.

        Raises:
            InputError: it cannot be written.
        """
        error = 'end-effector error, rms [µm]' if self.planar else 'joint error, rms [µrad]'
        save(draw(self.members, self.units.label(error), self.units), path)


@returning(LeastErrors.frame, pandas)
def limit(
    scenario: Place,
    *,
    runs: int | None = None,
    duration: float | None = None,
    out: Place | None = None,
    calm: bool = False,
    rest: float = REST,
    figure: Place | None = None,
    param_file: Changes = None,
    **values: Any,
) -> LeastErrors:
    """Compute the least error that any controller can have, as ``parallel_robot limit`` does.

    >>> import parallel_robot as pr
    >>> noise = {'disturbance.noise': 0.1, 'sensor.delay': 0.002}
    >>> found = pr.limit('axes_step', duration=1, **noise)
    >>> (1e9 * found[['as_it_is_rad', 'without_delays_rad']]).round().values.tolist()
    [[1435.0, 243.0]]

    Args:
        scenario: Name or file of a scenario; or of a study, of which it is asked for all robots.
        runs: Robots of each scenario of a study; default: the study's.
        duration: Length of the motion of a scenario [s]; default: its own.
        out: CSV file with one row for each robot, which must not exist; default: none.
        calm: Whether the least errors with at most some chattering are asked for, too.
        rest: Weight of joints that the error does not see, as a rotation, in these; 1: as of the
            place; default: 0.0001.
        figure: Picture of these, .png, .pdf or .svg, which must not exist; default: none.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values.

    Returns:
        A pandas.DataFrame with one row a robot, the root mean square error over the second half
        of its motion without some of the causes, as `out` has it; ``attrs['warnings']`` says what
        to know of them.

    Raises:
        InputError: something is wrong in the arguments, or pandas is not installed.
    """
    file, picture = optional_path('out', out), optional_path('figure', figure)
    if file:
        output.check_new(file, '--out')
    if picture:
        check_new(picture)
    name, changed = named('scenario', scenario), changes(param_file, values)
    assigned = changed.get('duration', duration)
    if duration is not None and 'duration' not in changed.locations and assigned != duration:
        raise InputError(f'--duration {duration} and --set duration={assigned} differ; give one')
    found = compute(name, changed, runs, duration, calm or picture is not None, rest)
    if file:
        output.save(file, found.csv().encode())
    if picture:
        found.save_figure(picture)
    return replace(found, out=file, figure=picture)


def compute(
    name: str,
    changes: Mapping[str, Any],
    runs: int | None = None,
    duration: float | None = None,
    calm: bool = False,
    rest: float = REST,
) -> LeastErrors:
    """Compute the least errors of the robots of a scenario or a study.

    Args:
        name: Name or file of either.
        changes: What changes in the configuration.
        runs: Robots of each scenario of a study; None: the study's.
        duration: Length of the motion of a scenario [s]; None: its own.
        calm: Whether the price of calm is asked for.
        rest: Its weight of joints that the error does not see, relative.

    Raises:
        InputError: there is no such scenario or study, or an argument is wrong.
    """
    if not 0.0 < rest <= 1.0:
        raise InputError(f'--rest must be above 0 and at most 1, not {rest:g}')
    found: dict[str, list[LeastError]] = {}
    planar, encoders, drives = True, False, False
    units: list[JointUnits] = []
    for scenario, configuration in _experiments(name, changes, runs, duration):
        if not configuration.loop.duration:
            raise InputError(ENDLESS)
        planar &= configuration.true_robot.place > 0
        encoders |= any(np.any(configuration.values[key]) for key in ENCODERS)
        drives |= configuration.imperfections.drive.on
        units.append(configuration.true_robot.joint_units)
        found.setdefault(scenario, []).append(least_error(configuration, calm=calm, rest=rest))
    remarks = (*((ESTIMATE,) if encoders else ()), *((RIGID,) if drives else ()))
    return LeastErrors(found, planar, calm, remarks, all_of(units), rest)


def _experiments(
    name: str, changes: Mapping[str, Any], runs: int | None, duration: float | None
) -> Iterator[tuple[str, Configuration]]:
    """Each robot with its motion, and the name of its scenario."""
    if not is_study(name):
        if runs is not None:
            raise InputError(f'--runs is for studies; {name} is a scenario')
        changed = merged([changes, {} if duration is None else {'duration': duration}])
        yield scenario_stem(name), configure(resolve(name, with_duration(name, changed, None)))
        return
    from parallel_robot.studies.sweep import study  # they take long to import
    from parallel_robot.studies.sweep.plan import plan

    file = study.file_of(name)
    if duration is not None:
        raise InputError(f'--duration is for scenarios; the study {name} has its own')
    asked = study.parse(study.read(file), str(file), file.parent).changed(runs, changes)
    planned = plan(asked)
    first = {case.scenario: k for k, case in reversed([*enumerate(planned.cases)])}
    rows = [row for k in first.values() for row in planned.rows(k, 0, asked.runs)]
    for row in tracked(rows, len(rows), 'robots'):
        yield scenario_stem(row.scenario), configure(resolve(row.scenario, row.overrides))


def is_study(name: str, bases: int = MAX_BASES) -> bool:
    """Whether a name or a file is that of a study, which may have so many bases."""
    if (config.directory() / 'studies' / f'{name}.yaml').is_file():
        return True
    path = Path(name)
    if not path.is_file():
        return False
    from parallel_robot.studies.sweep.study import read

    found = plain_data.mapping(read(path))
    base = found.get('base')
    if 'scenarios' in found or not isinstance(base, str) or not bases:
        return 'scenarios' in found
    return is_study(absolute_scenario(base, path.parent), bases - 1)


def _table(
    scenario: str, members: list[LeastError], planar: bool, units: JointUnits
) -> list[Part]:
    """The least errors of some robots."""
    what, unit = ('end-effector error', 'µm') if planar else ('joint error', units.of('µrad'))
    count = f', {len(members)} robots' if len(members) > 1 else ''
    head = f'{scenario}{count}: least {what} of any controller, rms [{unit}], second half'
    columns = {name: [1e6 * one.errors[name] for one in members] for name in CAUSES}
    travelled = [1e6 * one.travelled for one in members]
    if np.isfinite(travelled).all():
        columns[TRAVELLED] = travelled
    geometry = [1e6 * one.geometry for one in members]
    if max(geometry) > 1e6 * NEGLIGIBLE:
        columns[GEOMETRY] = geometry
    rows = [_row(name, values) for name, values in columns.items()]
    return [head, _figures('least error', rows, unit)]


def _row(name: str, values: list[float]) -> list[str]:
    """A name and a figure; of several robots median and percentiles."""
    found = np.percentile(values, [50, 5, 95] if len(values) > 1 else [50])
    return [name, *(shown(float(each)) for each in found)]


def _figures(name: str, rows: list[list[str]], unit: str) -> Table:
    """Rows as a table."""
    several = any(len(row) > 2 for row in rows)
    heads = [f'{head} [{unit}]' for head in (('median', '5 %', '95 %') if several else ('error',))]
    return Table([name, *heads], rows, bare=not several)


def _calm_table(
    members: list[LeastError], planar: bool, units: JointUnits, rest: float
) -> list[Part]:
    """The least errors with at most some chattering."""
    known = [one.calm for one in members if one.calm is not None]
    if not known:
        return ['  the limit is zero, calm costs nothing: see disturbance.noise, actuator.noise']
    found = {level: [1e6 * each.at(level) for each in known] for level in LEVELS}
    rows = [
        _row(f'{level:g}', values)
        for level, values in found.items()
        if not np.isnan(values).any()  # else calmer than what was computed for some robot
    ]
    nm, small = units.of('N m'), 'µm' if planar else units.of('µrad')
    head = f'  with a chattering of at most [{nm}]; {len(known)} robots with noise'
    if planar:
        head += f'; the rest of the joints weighs {rest:g}'
    return [head, _figures(f'chattering [{nm}]', rows, small)]
