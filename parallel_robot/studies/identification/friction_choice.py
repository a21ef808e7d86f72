"""Which kinds of friction a robot shows: those that predict torques that were not fitted.

A motion is cut into blocks of time. Each block is predicted by a fit to the others. A column stays
if the error of its joint is less with it, and if its value is surely not zero.

Source:
    Roberts et al. (2017), Cross-validation strategies for data with temporal, spatial,
    hierarchical, or phylogenetic structure, Ecography 40(8), for blocks.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from parallel_robot.studies.identification.base_parameters import (
    ALWAYS,
    FRICTION,
    BaseParameters,
    FrictionColumn,
    columns_of,
)
from parallel_robot.studies.identification.least_squares import Estimate
from parallel_robot.studies.identification.measured_motion import STILL
from parallel_robot.studies.identification.regression_rows import Rows
from parallel_robot_model.common.units import Array

BLOCKS, FEWEST = 10, 5  # blocks, and those below which there are too few to choose by
APART = 3.0  # lengths of the filter, a block at least
SPEEDS = (0.04, 0.08, 0.16, 0.32, 0.64)  # of the Stribeck effect that are tried, by `typical`
USUAL = 0.16  # of it, where none is known
LEAST = 0.002  # of the error of its joint that a column must save
EXACT = 5e-3  # of the torque: errors that are less are of no interest
# Of the mean eigenvalue: inertias that the others of a block do not tell stay nominal.
RIDGE = 1e-9


def candidates(base: BaseParameters, speeds: Iterable[float]) -> BaseParameters:
    """With all kinds of friction; `speeds` of the Stribeck effect [rad/s]."""
    kinds, n = [*FRICTION], base.joints
    columns = columns_of([kind for kind in kinds if kind != 'stribeck'], n)
    for speed in speeds:
        columns += columns_of(['stribeck'], n, speed)
    return base.with_friction(columns)


def typical(rates: Array) -> float:
    """Typical rate of the joints that move [rad/s]; `rates` of all, shape (n,)."""
    return float(np.median(rates[rates > STILL])) if (rates > STILL).any() else 1.0


class Choice(NamedTuple):
    """The friction that pays."""

    columns: tuple[FrictionColumn, ...]
    # of each that is not always there: what it saves of the error of its joint [1], with the half
    # width of its 95 % interval
    saved: dict[FrictionColumn, tuple[float, float]]

    def pays(self, column: FrictionColumn) -> bool:
        """Whether what a column saves is above its interval."""
        mean, half = self.saved[column]
        return mean > half

    def without(self, doubtful: Collection[FrictionColumn]) -> Choice:
        """The same without some columns."""
        return Choice(
            tuple(each for each in self.columns if each not in doubtful),
            {each: saved for each, saved in self.saved.items() if each not in doubtful},
        )


class Blocks:
    """Rows of a motion in blocks of time, by their sums of squares."""

    def __init__(
        self, base: BaseParameters, found: Estimate, begin: float, end: float, apart: float
    ) -> None:
        """Begin without rows, of a motion from `begin` to `end` [s].

        `base` has all columns that may be chosen, `found` the weights of the joints; `apart` is
        the length of the filter [s].
        """
        self._base = base
        n, parameters = len(found.weight), len(base.names)
        self._root = np.linalg.cholesky(found.weight).T
        self._apart, self.count = apart, min(BLOCKS, int((end - begin) / (APART * apart)))
        self._edges = np.linspace(begin, end, self.count + 1)
        self._weighted = np.zeros((self.count, parameters + 1, parameters + 1))
        self._joints = np.zeros((self.count, n, parameters + 1, parameters + 1))

    def add(self, rows: Rows) -> None:
        """Take rows, but for those whose filter sees two blocks."""
        whole = np.concatenate([rows.Y, rows.torque[:, :, np.newaxis]], axis=2)
        for block, (begin, end) in enumerate(zip(self._edges, self._edges[1:], strict=False)):
            inside = (rows.time > begin + 0.5 * self._apart) & (
                rows.time < end - 0.5 * self._apart
            )
            some = whole[inside]
            weighted = (self._root @ some).reshape(-1, some.shape[2])
            self._weighted[block] += weighted.T @ weighted
            self._joints[block] += np.einsum('tjp,tjq->jpq', some, some)

    def choose(self, nominal: Array, scale: Array) -> Choice | None:
        """Choose the columns; values and sizes of all parameters, each shape (P,).

        Columns with a nominal value stay. None: there are too few blocks.
        """
        joints = self._base.joints
        moving = self._joints[:, :, -1, -1] > 0.0
        used = moving.any(axis=1)
        if used.sum() < FEWEST:
            return None
        sizes = np.append(scale, 1.0)
        start = np.append(nominal / scale, -1.0)
        weighted = sizes[:, np.newaxis] * self._weighted[used] * sizes
        each = sizes[:, np.newaxis] * self._joints[used] * sizes
        torque = each[:, :, -1, -1].mean(axis=0)
        inertia = len(scale) - len(self._base.friction)

        def errors(columns: Sequence[int]) -> Array:
            """Squared errors of blocks that were not fitted, relative, shape (K, n)."""
            kept = [*range(inertia), *(inertia + k for k in columns)]
            some = np.ix_(kept, kept)
            found = np.empty((len(each), joints))
            for block in range(len(each)):
                total = weighted.sum(axis=0) - weighted[block]
                x = start.copy()
                x[inertia:-1] = 0.0
                x[kept] = start[kept]
                slope = -(total @ x)[kept]
                normal = total[some]
                ridge = RIDGE * np.trace(normal) / len(kept) + np.finfo(float).tiny
                normal = normal + ridge * np.eye(len(kept))
                x[kept] += np.linalg.solve(normal, slope)
                found[block] = np.einsum('p,jpq,q->j', x, each[block], x)
            return found / np.maximum(torque, 1e-300)

        columns = self._base.friction
        speeds = sorted({column.speed for column in columns} - {0.0})

        def with_speed(speed: float) -> list[int]:
            return [k for k, each in enumerate(columns) if each.speed in (0.0, speed)]

        def whole(squares: Array) -> float:
            return float(np.sqrt(squares.mean(axis=0)).mean())

        chosen = min(map(with_speed, speeds), key=lambda each: whole(errors(each)))
        while True:
            now = errors(chosen)
            saved = {}
            for k in chosen:
                if columns[k].kind in [*FRICTION][ALWAYS:] and not nominal[inertia + k]:
                    joint = columns[k].joint
                    without = errors([other for other in chosen if other != k])[:, joint]
                    some = moving[used, joint]
                    saved[k] = _saved(without[some], now[some, joint])
            useless = {k: mean for k, (mean, _) in saved.items() if mean <= LEAST}
            if not useless:
                return Choice(
                    tuple(columns[k] for k in chosen),
                    {columns[k]: each for k, each in saved.items()},
                )
            worst: dict[int, int] = {}
            for k in sorted(useless, key=lambda each: -useless[each]):
                worst[columns[k].joint] = k
            chosen = [k for k in chosen if k not in worst.values()]


def _saved(without: Array, within: Array) -> tuple[float, float]:
    """Share of an error that is saved, with half of its interval, from squares by block."""
    if len(without) < 2:
        return 0.0, 0.0
    count, scale = len(without), max(float(np.sqrt(without.mean())), EXACT)
    by_block = (np.sqrt(without) - np.sqrt(within)) / scale
    half = stats.t.ppf(0.975, count - 1) * by_block.std(ddof=1) / np.sqrt(count)
    return float(by_block.mean()), float(half)
