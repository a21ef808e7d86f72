"""Trials around an effort as the laws of a study, and the fronts that its sweep makes of them."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from parallel_robot.bags import output
from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.store import RUNS, STUDY, arrow, manifest_of
from parallel_robot.studies.tuning import trial
from parallel_robot.studies.tuning.front import (
    FORMATS,
    Front,
    check_fronts,
    draw_fronts,
    fronts_data,
    fronts_table,
    read_front,
)
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.configuration.config_files import is_scenario_path, scenario_stem

STEPS = (0.64, 0.8, 1.0, 1.25, 1.5625)  # times the effort: near each of these a trial is taken


def study_of(fronts: Sequence[Front], effort: float, base: str) -> str:
    """The text of a study of trials around an effort, and of those that were taken.

    Args:
        fronts: The fronts, which can be compared.
        effort: The effort [unit of its column].
        base: Name or file of the study whose samples judge them.

    Raises:
        InputError: the study cannot be read, has another scenario or the samples of the searches,
            or two fronts have the same name.
    """
    file = study.file_of(base)
    judge = study.parse(study.read(file), str(file), file.parent)
    scenario = scenario_stem(str(fronts[0].manifest['scenario']))
    scenarios = [each for each in judge.scenarios if scenario_stem(each) == scenario]
    if not scenarios:
        raise InputError(f'--study: {base} has no scenario {scenario}, that of the tunings')
    told = fronts[0].manifest.get('uncertainty')  # seed, method, uncertain parameters
    if isinstance(told, list) and told[:1] == [str(judge.seed)] and told[-1] != '[]':
        what = f'{base} has the seed {judge.seed} of the searches, which have seen its samples'
        raise InputError(f'--study: {what}; give one with another seed')
    laws: dict[str, dict[str, object]] = {}
    for front in fronts:
        for name, k in _named(front):
            if k in _around(front, effort):
                if name in laws:
                    raise InputError(f'two tunings are called {front.name}; rename a directory')
                laws[name] = {'law': front.law, **front.trials[k][1]}
    own = {'base': str(file.resolve()) if is_scenario_path(base) else base, 'scenarios': scenarios}
    return yaml.safe_dump({**own, 'laws': laws}, sort_keys=False, allow_unicode=True)


def judged(fronts: Sequence[Front], directory: Path) -> list[Front]:
    """The fronts of those trials that a sweep has run, with its medians.

    Args:
        fronts: The fronts, which can be compared.
        directory: That of a sweep of the study by :func:`study_of`.

    Raises:
        InputError: it is not, or has not ended.
    """
    manifest_of(directory)
    parsed = study.parse(study.read(directory / STUDY), str(directory / STUDY))
    variants = {variant.name: variant for variant in parsed.laws}
    columns = [fronts[0].effort.key, fronts[0].error.key]
    try:
        table = arrow().parquet.read_table(
            directory / RUNS,
            columns=['law', 'status', *columns],
            filters=[('scenario', '=', scenario_stem(str(fronts[0].manifest['scenario'])))],
            partitioning=None,
        )
        law, status, *figures = (table[each].to_numpy() for each in ('law', 'status', *columns))
        spent, error = (np.where(status == 'ok', each, math.inf) for each in figures)
    except (OSError, ValueError, KeyError):
        raise InputError(
            f'the sweep in {directory} has not ended, or is of other robots'
        ) from None
    found = []
    for front in fronts:
        points = {}
        for name, k in _named(front):
            if name in variants:
                variant, (_, gains) = variants[name], front.trials[k]
                theirs = {key.removeprefix(f'{front.law}.'): v for key, v in variant.gains.items()}
                if (variant.law, theirs) != (front.law, gains):
                    raise InputError(f'{directory}: {name} is not that trial of {front.directory}')
                mine = law == name
                points[k] = float(np.median(spent[mine])), float(np.median(error[mine]))
        if front.chosen not in points:
            raise InputError(f'{directory} is no sweep of the trials of {front.directory}')
        order = sorted(points, key=lambda k: points[k][::-1])
        found.append(
            replace(
                front,
                points=tuple(points[k] for k in order),
                trials=tuple(front.trials[k] for k in order),
                chosen=order.index(front.chosen),
            )
        )
    return found


def _named(front: Front) -> Iterator[tuple[str, int]]:
    """What a study calls each trial of a front, and its index."""
    for k, (number, _) in enumerate(front.trials):
        yield f'{front.name}@{number}', k


def _around(front: Front, effort: float) -> set[int]:
    """Indices of the trials that a study has: some enclose the effort on other robots, too."""
    shares = np.array([spent / effort for spent, _ in front.points])  # falling
    above, below = np.flatnonzero(shares >= STEPS[-1]), np.flatnonzero(shares <= STEPS[0])
    with np.errstate(divide='ignore'):
        near = [int(np.argmin(np.abs(np.log(shares / step)))) for step in STEPS]
    return {front.chosen, *near, *above[-1:].tolist(), *below[:1].tolist()}


# The error of each law at exactly one effort, from the fronts of its searches.


class Reached(NamedTuple):
    """A law at an effort."""

    fronts: list[Front]  # those of its searches, which differ in their seeds alone
    # error of each at the effort [unit of its column]; NaN where it is not enclosed
    errors: list[float]

    @property
    def known(self) -> list[float]:
        """The errors of those that enclose the effort, by size."""
        return sorted(error for error in self.errors if error == error)


def error_at(front: Front, effort: float) -> float:
    """The error of a front at an effort, on the line between the two nearest points about it.

    Logarithms are interpolated, as error goes with a power of effort; nothing is extrapolated.

    Args:
        front: The front.
        effort: The effort [unit of its column].

    Returns:
        The error [unit of its column]; NaN where no two points, with less than half of the runs
        failed, enclose the effort.
    """
    for (below, most), (above, least) in pairwise(sorted(front.points)):
        known = min(below, most, least) > 0.0 and max(above, most, least) < math.inf
        if known and below <= effort <= above:
            share = math.log(effort / below) / math.log(above / below) if below < above else 0.0
            return most * (least / most) ** share
    return math.nan


def laws_at_effort(fronts: Sequence[Front], effort: float) -> list[Reached]:
    """The laws at an effort, in the order of their first fronts.

    Raises:
        InputError: two fronts are of the same search.
    """
    groups: dict[str, dict[str, Front]] = {}
    for front in fronts:
        law, space, seed = (
            json.dumps(front.manifest.get(key), sort_keys=True)
            for key in ('law', 'search space', 'seed')
        )
        other = groups.setdefault(law + space, {}).setdefault(seed, front)
        if other is not front:
            what = f'{other.directory} and {front.directory} are one search, with seed {seed}'
            raise InputError(f'{what}; give searches with other seeds')
    return [
        Reached([*group.values()], [error_at(front, effort) for front in group.values()])
        for group in groups.values()
    ]


def parts_at_effort(laws: Sequence[Reached], effort: float) -> list[Part]:
    """Median and spread over the searches of each law, and which searches miss the effort."""
    first = laws[0].fronts[0]
    spent, error = first.effort, first.error
    limit = f'{spent.scale * effort:g} {spent.unit}'
    heads = [f'{what} [{error.unit}]' for what in ('median', 'least', 'largest')]
    rows, lacking = [], []
    for law in laws:
        known, count = law.known, len(law.fronts)
        figures = (statistics.median(known), known[0], known[-1]) if known else (math.nan,) * 3
        shown = [f'{error.scale * value:.4g}' if known else '' for value in figures]
        rows.append([law.fronts[0].name, law.fronts[0].law, f'{len(known)} of {count}', *shown])
        for front, value in zip(law.fronts, law.errors, strict=True):
            if value != value:
                efforts = [spent.scale * each for each, _ in front.points]
                ends = f'{min(efforts):.4g} to {max(efforts):.4g} {spent.unit}'
                lacking.append(f'{front.name} is left out: its front, from {ends}, misses {limit}')
    head = ['front', 'law', 'searches', *heads]
    title = f'{error.name}, at exactly {limit} of {spent.name}'
    return [title, Table(head, rows, 'llr'), *lacking]


def data_at_effort(laws: Sequence[Reached], effort: float) -> list[dict[str, Any]]:
    """The same as plain data, in the units of the columns; NaN where a front misses the effort."""
    return [
        {
            'law': law.fronts[0].law,
            law.fronts[0].effort.key: effort,
            f'median {law.fronts[0].error.key}': statistics.median(law.known or [math.nan]),
            'fronts': dict(zip((front.name for front in law.fronts), law.errors, strict=True)),
        }
        for law in laws
    ]


# Fronts of several tunings from what is asked of them to the file, and their table.


@dataclass(frozen=True, repr=False)
class Compared(ShownResult):
    """Fronts of several tunings."""

    fronts: Sequence[Front]
    effort: float | None  # at which effort laws are compared [unit of its column]; None: at none
    out: Path  # the file that was written

    def parts(self) -> list[Part]:
        """The trials that were taken, or the laws at the effort."""
        if self.effort is None:
            return [fronts_table(self.fronts)]
        return parts_at_effort(laws_at_effort(self.fronts, self.effort), self.effort)

    def as_data(self) -> list[dict[str, Any]]:
        """The same as plain data; without an effort, all points of the fronts."""
        if self.effort is None:
            return fronts_data(self.fronts)
        return data_at_effort(laws_at_effort(self.fronts, self.effort), self.effort)


def compare(
    directories: Sequence[Path],
    out: Path,
    effort: str | None = None,
    study: str | None = None,
    sweep: Path | None = None,
    option: str = 'out',
) -> Compared:
    """Compare the fronts of some tunings.

    Args:
        directories: Each the results of a tuning that has ended.
        out: A picture, or with `study` a file of a study; must not exist.
        effort: ``MEASURE=VALUE``, at which laws are compared.
        study: Study whose samples are to judge the trials around the effort.
        sweep: Directory of a sweep of those, whose medians take the place of the searches'.
        option: What `out` is called in messages.

    Raises:
        InputError: one has no front, they cannot be compared, or the file cannot be written.
        RunError: the disk is full.
    """
    formats = FORMATS if study is None else ('.yaml', '.yml')
    if out.suffix not in formats:
        raise InputError(f'{option} must end with {" or ".join(formats)}, not {out.name!r}')
    output.check_new(out, option)
    if not directories:
        raise InputError('directories of tunings are needed')
    found = [read_front(directory) for directory in directories]
    check_fronts(found)
    if sweep is not None:
        found = judged(found, sweep)
    limit = None if effort is None else _limit(effort, found[0])
    compared = Compared(found, limit, out)
    compared.parts()  # may refuse them
    if study is None:
        content = draw_fronts(found, limit)[out.suffix.removeprefix('.')]
    elif limit is None or sweep is not None:
        raise InputError('--study needs --effort MEASURE=VALUE, and no --sweep')
    else:
        content = study_of(found, limit, study).encode()
    output.save(out, content)
    return compared


def _limit(text: str, front: Front) -> float:
    """The effort that is asked for."""
    asked = trial.parse_effort(text)
    measure = front.manifest['measure of effort']
    if asked.measure != measure or asked.limit is None:
        raise InputError(f'--effort must be {measure}=VALUE, as the tunings have it, not {text!r}')
    return asked.limit
