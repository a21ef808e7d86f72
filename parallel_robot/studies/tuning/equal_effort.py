"""The error of each law at exactly one effort, from the fronts of its searches."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from parallel_robot.studies.tuning.front import Front
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.tables import Part, Table


class Reached(NamedTuple):
    """A law at an effort.

    Attributes:
        fronts: Those of its searches, which differ in their seeds alone.
        errors: Error of each at the effort [unit of its column]; NaN where it is not enclosed.
    """

    fronts: list[Front]
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


def reached(fronts: Sequence[Front], effort: float) -> list[Reached]:
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


def parts(laws: Sequence[Reached], effort: float) -> list[Part]:
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


def as_data(laws: Sequence[Reached], effort: float) -> list[dict[str, Any]]:
    """The same as plain data, in the units of the columns; NaN where a front misses the effort."""
    return [
        {
            'law': law.fronts[0].law,
            law.fronts[0].effort.column: effort,
            f'median {law.fronts[0].error.column}': statistics.median(law.known or [math.nan]),
            'fronts': dict(zip((front.name for front in law.fronts), law.errors, strict=True)),
        }
        for law in laws
    ]
