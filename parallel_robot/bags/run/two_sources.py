"""Two sources of one number in a bag, compared: efforts and commands, joints and references.

Means over SMOOTHED are compared, at the delay at which they are most alike, so that neither
chattering nor the lag of motors counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array, JointUnits

SMOOTHED = 0.1  # s
LATEST, TRIED = 0.1, 21  # s, longest delay that is looked for; how many
ROWS = 2000  # that are compared
FEWEST = 20  # rows that tell a factor
CLEAR = 0.05  # of a signal: no more is left where a factor is clear
UNLIKE = 0.3  # of a signal: more is left where two are different
NEAR = 0.05  # by which a factor may differ from 1
ANOTHER = 2.0  # factor from which on, or below its inverse, a number is no longer the other one
MOVES = 1e-3  # rad or m, rms about the mean
DEGREES, MILLI, OPPOSITE = 180.0 / math.pi, 1000.0, -1.0


class Ratio(NamedTuple):
    """What columns are of the columns of another source."""

    factors: Array  # of each by each of the other, shape (n, n)
    left: Array  # share of a column that the other one times the factor does not explain, (n, n)

    @property
    def order(self) -> list[int]:
        """Which of the other is each column: its own one unless another one explains it alone."""
        own = np.diag(self.left)
        best = np.where(own > UNLIKE, self.left.argmin(axis=1), np.arange(len(own)))
        return best.tolist() if len({*best.tolist()}) == len(best) else [*range(len(best))]

    def clear(self) -> dict[int, float]:
        """Factors that are clear, by column, each by the column that :attr:`order` has for it."""
        pairs = [*enumerate(self.order)]
        return {k: float(self.factors[k, j]) for k, j in pairs if self.left[k, j] < CLEAR}


def ratio(one: Array, other: Array, period: float, centred: bool = False) -> Ratio | None:
    """Compare two sources, each shape (N, n); None where they tell nothing.

    Args:
        one: What may be the other, later, times a factor.
        other: The other.
        period: From row to row [s].
        centred: Whether constants between them do not count.
    """
    known = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    width = max(1, round(SMOOTHED / period)) if period > 0.0 else 1
    late = round(LATEST / period) if period > 0.0 else 0
    if int(known.sum()) < width + late + FEWEST:
        return None
    one, other = (
        (np.cumsum(each[known], axis=0)[width:] - np.cumsum(each[known], axis=0)[:-width]) / width
        for each in (one, other)
    )
    count = len(one) - late
    every = max(1, count // ROWS)
    return min(
        (
            ratio_of_rows(one[delay : delay + count : every], other[:count:every], centred)
            for delay in np.unique(np.linspace(late, 0, TRIED).astype(int))
        ),
        key=lambda found: float(found.left.min(axis=1).sum()),
    )


def ratio_of_rows(one: Array, other: Array, centred: bool = False) -> Ratio:
    """Compare two sources row by row, each shape (N, n); see :func:`ratio`."""
    if centred:
        one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    products, size, of_other = one.T @ other, (one**2).sum(axis=0), (other**2).sum(axis=0)
    scale = np.outer(size, of_other)
    with np.errstate(divide='ignore', invalid='ignore'):
        left = np.sqrt(np.clip(1.0 - products**2 / scale, 0.0, 1.0))
        return Ratio(products / of_other, np.where(scale > 0.0, left, 1.0))


def is_another(factor: float) -> bool:
    """Whether a number that is a factor times another is no longer the same one."""
    return not 1.0 / ANOTHER < factor < ANOTHER


class Contradiction(NamedTuple):
    """That two sources of one number differ by a clear factor, or in their order."""

    text: str = ''  # in one line; empty where they do not
    grave: bool = False  # whether the first is no longer the second one


def efforts(
    joints: Sequence[str], effort: Array, command: Array, period: float, units: JointUnits
) -> Contradiction:
    """How measured efforts and the commands before them, each shape (N, n), differ."""
    found = ratio(effort, command, period)
    if found is None:
        return Contradiction()
    measured, commanded = effort.any(axis=0), np.nan_to_num(command).any(axis=0)
    unmeasured, idle = ~measured & commanded, ~commanded & measured
    silent = {
        'efforts of {} are always 0, the commands are not: are they measured?': unmeasured,
        'commands of {} are always 0, the efforts are not: does another controller act?': idle,
    }
    told = [
        what.format(_names(joints, np.flatnonzero(of))) for what, of in silent.items() if of.any()
    ]
    order, clear = found.order, found.clear()
    permuted = order != sorted(order) and len(clear) == len(order)
    if permuted:
        told.append(f'efforts are the commands in the order {_names(joints, order)}')
    off = {k: factor for k, factor in clear.items() if abs(factor - 1.0) > NEAR}
    causes = {MILLI: f'are they in m{units.of("N m")}?', OPPOSITE: 'is a sign wrong?'}
    for factor, names, why in _told(joints, off, causes):
        whose = f' of {names}' if len(off) < len(joints) else ''
        why = why or 'currents, percent, or torques before a gear?'
        told.append(f'efforts{whose} are {factor:g} of the commands: {why}')
    return Contradiction('; '.join(told), permuted or any(map(is_another, off.values())))


def positions(
    joints: Sequence[str], position: Array, reference: Array, period: float, units: JointUnits
) -> Contradiction:
    """How measured joints and their references, each shape (N, n), differ."""
    known = np.isfinite(reference).all(axis=1)
    if not known.any():
        return Contradiction()
    position, reference = position[known], reference[known]
    found = ratio(position, reference, period, centred=True)
    size = np.sqrt((reference**2).mean(axis=0))
    milli = f'm{units.of("rad")}'
    causes = {
        OPPOSITE: 'is its sign wrong?',
        DEGREES: 'are they in degrees?',
        1.0 / DEGREES: 'are the references in degrees?',
        MILLI: f'are they in {milli}?',
        1.0 / MILLI: f'are the references in {milli}?',
    }

    def error(factor: float = 1.0) -> Array:
        """Of each joint by each reference, rms, shape (n, n)."""
        apart = position[:, :, np.newaxis] / factor - reference[:, np.newaxis]
        return np.asarray(np.sqrt((apart**2).mean(axis=0)))

    every = error()
    own, off = np.diag(every), {}
    moving = (position.std(axis=0) > MOVES) & (reference.std(axis=0) > MOVES)
    for k, factor in enumerate(np.diag(found.factors) if found else ()):
        if found and moving[k] and found.left[k, k] < CLEAR and is_another(factor):
            off[k] = float(factor)
    for factor in causes:
        less = np.diag(error(factor))
        near = (own > MOVES) & (less < 0.1 * own) & (less < CLEAR * size)
        off |= {k: factor for k in np.flatnonzero(near).tolist() if k not in off}
    told = [
        f'{names}: {factor:g} times the reference: '
        f'{why or "a gear, or an encoder with another scale?"}'
        for factor, names, why in _told(joints, off, causes)
    ]
    best = every.argmin(axis=1).tolist()
    wrong = moving & (own > MOVES) & (every.min(axis=1) < 0.1 * own)
    if not off and wrong.any() and len({*best}) == len(best):
        what = f'joints are their references in the order {_names(joints, best)}'
        told.append(f'{what}: is --joints in another order?')
    return Contradiction('; '.join(told), bool(told))


def _names(joints: Sequence[str], order: Iterable[int]) -> str:
    return ', '.join(joints[k] for k in order)


def _told(
    joints: Sequence[str], factors: Mapping[int, float], causes: Mapping[float, str]
) -> Iterator[tuple[float, str, str]]:
    """Factors, those near to each other as one, with their joints and the cause, or none."""
    found: dict[float, list[int]] = {}
    for k, factor in factors.items():
        near = [each for each in found if abs(factor / each - 1.0) < NEAR]
        found.setdefault(near[0] if near else float(f'{factor:.3g}'), []).append(k)
    for factor, members in found.items():
        likely = OPPOSITE if factor < 0.0 else factor
        why = [text for each, text in causes.items() if abs(likely / each - 1.0) < NEAR]
        yield factor, _names(joints, members), ''.join(why)
