"""The Pareto front of a tuning, and the point of it that is chosen."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.metrics import Metric
from parallel_robot.analysis.pictures import encoded, law_look, stacked
from parallel_robot.analysis.report.looks import label, law_label
from parallel_robot.bags.output import check_new, save
from parallel_robot.studies.sweep.picture import LINE, MARGIN, name_lines
from parallel_robot.studies.sweep.results import ERRORS
from parallel_robot.studies.tuning import output
from parallel_robot.studies.tuning.trial import MEASURES, Effort, Trial, Weights
from parallel_robot.studies.tuning.tune import Store
from parallel_robot_control.laws import PAPER
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import path
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.common.units import BOTH, HINGES, PRISMATIC, JointUnits
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.config import Place


def front(trials: Iterable[Trial]) -> list[Trial]:
    """Trials than which no other has both less error and less effort, by rising error.

    Args:
        trials: Trials; infeasible ones and a default outside the search space are left out.
    """
    found: list[Trial] = []
    candidates = [trial for trial in trials if trial.feasible and trial.chosen is not None]
    for trial in sorted(candidates, key=lambda each: (each.error, each.effort, each.number)):
        if not found or trial.effort < found[-1].effort:
            found.append(trial)
    return found


def knee(points: Sequence[Trial]) -> Trial:
    """The point of a front that lies farthest below the line between its ends.

    Logarithms of error and effort, both scaled from 0 to 1 over the front, are compared; of
    a front of one or two points, it is the one with the smaller error.

    Source:
        Das (1999), On characterizing the "knee" of the Pareto curve.
    """
    if len(points) < 3:
        return points[0]
    smallest = np.finfo(float).tiny  # of a robot at rest
    figures = np.array([[point.error, point.effort] for point in points])
    logs = np.log(np.maximum(figures, smallest))
    scaled = (logs - logs.min(axis=0)) / np.ptp(logs, axis=0)
    return points[int(np.argmin(scaled.sum(axis=1)))]


def choose(
    points: Sequence[Trial],
    default: Trial,
    weights: Weights | None,
    pick: int | None,
    effort: Effort,
) -> tuple[Trial, str]:
    """The point of a front that is taken, and why.

    Args:
        points: The front, at least one.
        default: The trial of the default gains.
        weights: Weights, if there are any.
        pick: Number of a trial of the front, if requested.
        effort: The measure of effort, and its limit, if there is one.

    Raises:
        InputError: the trial is not on the front, or the whole front takes more effort.
    """
    if pick is not None:
        chosen = {point.number: point for point in points}
        if pick not in chosen:
            known = ', '.join(map(str, chosen))
            raise InputError(f'--pick: trial {pick} is not on the front; it holds {known}')
        return chosen[pick], 'asked for'
    quantity = effort.quantity
    if effort.limit is not None:
        calm = [point for point in points if point.effort <= effort.limit]
        limit = f'{quantity.scale * effort.limit:g} {quantity.unit}'
        if not calm:
            least = f'{quantity.scale * points[-1].effort:.4g}'
            raise InputError(
                f'{quantity.name}: no trial has {limit} or less, the least is {least}'
            )
        return calm[0], f'the least error with at most {limit} of {effort.measure}'
    if weights is not None:
        best = min(points, key=lambda point: weights.cost(point, default))
        shown = f'error={weights.error:g}, {effort.measure}={weights.effort:g}'
        return best, f'the least weighted sum, {shown}'
    return knee(points), 'the knee of the front'


# The fronts of several tunings in one picture: error against effort, each law at its curve.

FORMATS = tuple(f'.{suffix}' for suffix in output.SUFFIXES)
SIZE = (7.0, 4.8)  # inches; higher for more labels
SAME = ('scenario', 'measure of effort', 'number of runs', 'uncertainty')  # to be comparable


@dataclass(frozen=True)
class Front:
    """The front of a tuning."""

    directory: Path
    manifest: dict[str, Any]  # what its trials depend on
    error: Metric  # which metric its error is
    # effort and error of its points, by rising error, in their columns' units
    points: tuple[tuple[float, float], ...]
    trials: tuple[tuple[int, dict[str, Any]], ...]  # number and gains of the trial of each point
    chosen: int  # index of the point that was taken
    units: JointUnits  # those of the joints

    @property
    def name(self) -> str:
        """Name of its directory."""
        return self.directory.resolve().name

    @property
    def law(self) -> str:
        """Name of the law."""
        return str(self.manifest['law'])

    @property
    def effort(self) -> Metric:
        """Which metric its effort is."""
        return MEASURES[self.manifest['measure of effort']].in_units(self.units)


def read_front(directory: Path) -> Front:
    """Read the front of a tuning.

    Raises:
        InputError: the directory has none.
    """
    manifest, table = Store.manifest(directory), str(directory / 'front.csv')
    try:
        with open(table, newline='') as file:
            rows = [*csv.DictReader(file)]
    except OSError as missing:
        what = f'{missing.filename}: {missing.strerror}'
        raise InputError(f'no front in {directory}: {what}') from None
    except ValueError:
        rows = []
    try:
        measure, head = MEASURES[manifest['measure of effort']], rows[0]
        effort, units = next(
            (told, each)
            for each in (HINGES, PRISMATIC, BOTH)
            if (told := measure.in_units(each)).key in head
        )
        (error,) = (told for each in ERRORS if (told := each.in_units(units)).key in head)
        points = tuple((float(row[effort.key]), float(row[error.key])) for row in rows)
        own = {'trial', 'chosen', effort.key, error.key}
        gains = [key for key in head if key not in own]
        trials = tuple(
            (
                int(row['trial']),
                yaml_file.parse_assignments([f'{key}={row[key]}' for key in gains], table),
            )
            for row in rows
        )
        chosen = [row['chosen'] for row in rows].index('1')
    except (KeyError, ValueError, IndexError, TypeError, StopIteration):
        raise InputError(f'{table} is not the front of a tuning') from None
    return Front(directory, manifest, error, points, trials, chosen, units)


def check_fronts(fronts: Sequence[Front]) -> None:
    """Refuse fronts that cannot be compared.

    Raises:
        InputError: they differ in something else than the law and its search.
    """
    first = fronts[0]
    for other in fronts[1:]:
        for key in SAME:
            if other.manifest.get(key) != first.manifest.get(key):
                raise InputError(f'{first.directory} and {other.directory} differ in the {key}')


def draw_fronts(fronts: Sequence[Front]) -> dict[str, bytes]:
    """Draw the fronts; the gains that were taken are stars.

    Returns:
        Suffix to content.
    """
    height = max(SIZE[1], MARGIN + LINE * len(fronts))
    figure, (panel,) = stacked(SIZE[0], [height])
    laws = [each.law for each in fronts]
    ends = {}
    for k, front in enumerate(fronts):
        scales = front.effort.scale, front.error.scale
        figures = np.array(front.points) * scales
        efforts, errors = figures[np.argsort(-figures[:, 0], kind='stable')].T
        (line,) = panel.plot(efforts, errors, **law_look(k, front.law in PAPER))
        panel.plot(*figures[front.chosen], '*', color=line.get_color())
        name = law_label(front.law)
        if laws.count(front.law) > 1:
            name = label(f'{name} ({front.name})')
        ends[k] = name, front.law in PAPER, line, (efforts[0], errors[0])
    first = fronts[0]
    output.label_axes(panel, str(first.manifest['scenario']), first.effort, first.error)
    name_lines(panel, [*ends.values()], LINE / (height - MARGIN))
    return encoded(figure, output.SUFFIXES)


@dataclass(frozen=True, repr=False)
class Compared(ShownResult):
    """Fronts of several tunings."""

    fronts: Sequence[Front]
    out: Path  # the picture that was written

    def file_lines(self) -> list[str]:
        """The file that was written."""
        return [f'fronts  {self.out}']

    def parts(self) -> list[Part]:
        """The trials that were taken."""
        quantities = self.fronts[0].effort, self.fronts[0].error
        head = ['front', 'law', *(f'{each.name} [{each.unit}]' for each in quantities)]
        rows = []
        for front in self.fronts:
            values = zip(quantities, front.points[front.chosen], strict=True)
            figures = (f'{each.scale * value:.4g}' for each, value in values)
            rows.append([front.name, front.law, *figures])
        return [Table(head, rows, 'llr')]

    def as_data(self) -> list[dict[str, Any]]:
        """All points of the fronts as plain data."""
        return [
            {
                'front': front.name,
                'law': front.law,
                'scenario': front.manifest['scenario'],
                'points': [
                    {front.effort.key: effort, front.error.key: error}
                    for effort, error in front.points
                ],
                'chosen': front.chosen,
            }
            for front in self.fronts
        ]


def fronts(directories: Iterable[Place], out: Place) -> Compared:
    """Draw the fronts of several tunings in one picture, as ``parallel_robot fronts`` does.

    >>> import parallel_robot as pr
    >>> chosen = {'trials': 16, 'duration': 1, 'bounds': {'z': (10, 50)}}
    >>> tuned = pr.tune('smc', 'paper_circle', 'runs/fronts', **chosen)
    >>> pr.fronts(['runs/fronts'], 'runs/fronts.png').out.name
    'fronts.png'

    Args:
        directories: Those of the results of `tune` that have ended.
        out: Picture, .png or .svg; must not exist.

    Returns:
        What the command prints; ``as_data()`` has the figures.

    Raises:
        InputError: one is no directory of a tuning that has ended, they cannot be compared, or the
            file cannot be written.
        RunError: the disk is full.
    """
    folders, out = [path('a directory', each) for each in directories], path('out', out)
    if out.suffix not in FORMATS:
        raise InputError(f'--out must end with {" or ".join(FORMATS)}, not {out.name!r}')
    check_new(out, '--out')
    if not folders:
        raise InputError('directories of tunings are needed')
    found = [read_front(folder) for folder in folders]
    check_fronts(found)
    save(out, draw_fronts(found)[out.suffix.removeprefix('.')])
    return Compared(found, out)
