"""Base parameters by weighted least squares, with a covariance that holds for correlated errors.

Source:
    Newey, West (1987), A simple, positive semi-definite, heteroskedasticity and autocorrelation
    consistent covariance matrix, Econometrica 55(3); Kiefer, Vogelsang (2005), A new asymptotic
    theory for heteroskedasticity-autocorrelation robust tests, Econometric Theory 21(6).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import stats

from parallel_robot.studies import estimate as estimation
from parallel_robot.studies.identification.base_parameters import (
    ALWAYS,
    FRICTION,
    BaseParameters,
    FrictionColumn,
    columns_of,
)
from parallel_robot.studies.identification.measured_motion import STILL
from parallel_robot.studies.identification.regression_rows import Rows
from parallel_robot_model.common.units import Array

ITERATIONS = 3  # of the weights
FLOOR = 1e-9  # of the torque, the smallest error of a joint that is assumed
RANK = 1e-9  # of the largest singular value: a combination that the motion does not show
UNKNOWN = 1e3  # relative standard error of such a combination
POOR = 0.1  # relative standard error of a combination that is reported
SHOWN = 0.3  # share in a unit vector from which a parameter is named


@dataclass(frozen=True)
class Fit(estimation.Fit):
    """Least-squares estimate of the base parameters."""

    residual: Array  # torques that are not explained, rms of each joint [N m], shape (n,)
    correlation: Array  # of what is left of the torques in one row and the next, shape (n,)


@dataclass(frozen=True)
class Squares:
    """Few rows in place of many: with any weights and parameters, their squares are the same."""

    Y: Array  # regressor, shape (K, n, B)
    torque: Array  # torques [N m], shape (K, n)
    together: Array  # in how many of the many rows two joints are known, shape (n, n)
    count: int  # how many rows they stand for
    duration: float  # time that these represent [s]

    def first(self, parameters: int) -> Squares:
        """The same without the parameters after so many."""
        return replace(self, Y=self.Y[..., :parameters])

    def rms(self, values: Array) -> Array:
        """What values of the parameters leave of the torques, rms of each joint, shape (n,)."""
        left = self.torque - self.Y @ values
        return np.sqrt((left**2).sum(axis=0) / np.maximum(np.diag(self.together), 1.0))


@dataclass(frozen=True)
class Estimate:
    """Estimates without their uncertainty."""

    values: Array  # of the parameters, shape (B,)
    weight: Array  # inverse of the covariance of what is left of the torques, shape (n, n)
    condition: float  # see :class:`Fit`


def squares_of(parts: Iterable[Rows]) -> Squares:
    """Few rows in place of many, part by part: R of a QR decomposition.

    Args:
        parts: Rows that follow each other; at least one.
    """
    R: Array | None = None
    together, count, duration = np.zeros(()), 0, 0.0
    for rows in parts:
        known = rows.known.astype(float)
        together = together + known.T @ known
        count, duration = count + len(rows.time), duration + rows.duration
        flat = np.concatenate([rows.Y.reshape(len(rows.Y), -1), rows.torque], axis=1)
        flat = flat if R is None else np.concatenate([R, flat])
        R = np.asarray(np.linalg.qr(flat, mode='r'))
    assert R is not None
    n = len(together)
    return Squares(R[:, :-n].reshape(len(R), n, -1), R[:, -n:], together, count, duration)


def estimate(squares: Squares, nominal: Array, scale: Array) -> Estimate:
    """Estimate the base parameters.

    Args:
        squares: The rows of the regression.
        nominal: Values that a combination keeps which the motion does not show, shape (B,).
        scale: Sizes of the parameters, shape (B,).
    """
    Y, error = squares.Y * scale, squares.torque - squares.Y @ nominal
    n = error.shape[1]
    floor = FLOOR * np.sqrt(np.sum(squares.torque**2) / (squares.count * n)) + 1e-15
    weight = np.eye(n)
    for _ in range(ITERATIONS):
        change, condition = _solve(Y, weight, error)
        spread = _spread(error - Y @ change, squares.together)
        weight = np.linalg.inv(spread + floor**2 * np.eye(n))
    change, condition = _solve(Y, weight, error)
    return Estimate(nominal + scale * change, weight, condition)


def with_uncertainty(
    found: Estimate, squares: Squares, scale: Array, parts: Iterable[Rows]
) -> Fit:
    """An estimate with its uncertainty, from one more look at all rows.

    Args:
        found: The estimate.
        squares: Its rows, by their squares.
        scale: Sizes as of :func:`estimate`.
        parts: The rows, each part of one stretch; parameters after those of the estimate are left.
    """
    n, parameters = len(found.weight), len(scale)
    Y = squares.Y * scale
    A = Y.transpose(0, 2, 1) @ found.weight
    bread, unknown = _inverse(np.einsum('tpi,tiq->pq', A, Y))
    lags = int(np.ceil(4.0 * (squares.count / 100.0) ** (2.0 / 9.0)))
    meat = np.zeros((parameters, parameters))
    pulls, pulls_squares = np.zeros((2, parameters))
    products, first, second = np.zeros((3, n))
    for rows in parts:
        Y = rows.Y[..., :parameters]
        left = rows.torque - Y @ found.values
        Y = Y * scale
        A = Y.transpose(0, 2, 1) @ found.weight
        # A row pulls the fit towards itself: its residual is that of a fit without it (jackknife).
        leverage = Y @ bread @ A
        without = np.linalg.solve(np.eye(n) - leverage, left[..., np.newaxis])[..., 0]
        meat += _long_run(np.einsum('tpi,ti->tp', A, without), lags)
        pull = ((bread @ A) ** 2).sum(axis=2)
        pulls += pull.sum(axis=0)
        pulls_squares += (pull**2).sum(axis=0)
        pairs = rows.known[1:] & rows.known[:-1]
        one, other = left[1:] * pairs, left[:-1] * pairs
        products += (one * other).sum(axis=0)
        first += (one**2).sum(axis=0)
        second += (other**2).sum(axis=0)
    # Few rows say most about a parameter: their effective number counts. Intervals grow with the
    # share of the lags in all rows (Kiefer, Vogelsang).
    share = np.minimum((lags + 1) * pulls_squares / (pulls**2 + 1e-300), 1.0)
    covariance = bread @ meat @ bread + UNKNOWN**2 * unknown
    degrees = max(int(np.trace(squares.together)) - parameters, 1)
    return Fit(
        found.values,
        covariance * np.outer(scale, scale),
        stats.t.ppf(0.975, degrees) + 2.9694 * share + 0.4160 * share**2,
        found.condition,
        squares.rms(found.values),
        products / np.maximum(np.sqrt(first * second), 1e-300),
    )


def _spread(left: Array, together: Array) -> Array:
    """Covariance of what is left of the torques [N^2 m^2], shape (n, n).

    Joints that stand still at different times are seldom known together. Where the mean over those
    times is no covariance, as of errors that are much alike, that over the times of each joint is.
    """
    total = np.einsum('ti,tj->ij', left, left)
    together = np.maximum(together, 1.0)
    found = total / together
    if np.linalg.eigvalsh(found)[0] > 0.0:
        return np.asarray(found)
    alone = np.diag(together)
    return np.asarray(total / np.sqrt(np.outer(alone, alone)))


def poorly_determined(
    fit: Fit, names: tuple[str, ...], scale: Array, nominal: Array
) -> list[tuple[str, float]]:
    """Combinations whose relative standard error is large, the worst first, with that error.

    They are eigenvectors of the covariance of the parameters over their sizes, of which the fit
    had the nominal ones.
    """
    # not shown at all, whatever the others are
    alone = np.diag(fit.covariance) > 0.99 * (UNKNOWN * nominal) ** 2
    relative = fit.covariance / np.outer(scale, scale)
    found = [(name, UNKNOWN) for name, one in zip(names, alone, strict=True) if one]
    rest = np.flatnonzero(~alone)
    variances, vectors = np.linalg.eigh(relative[np.ix_(rest, rest)])
    for variance, vector in zip(variances[::-1], vectors.T[::-1], strict=True):
        error = float(np.sqrt(max(variance, 0.0)))
        if error > POOR:
            vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
            found.append((estimation.combination(vector, [names[k] for k in rest], SHOWN), error))
    return found


def _solve(Y: Array, weight: Array, error: Array) -> tuple[Array, float]:
    """Weighted least squares; nothing where the rows show nothing. Also the condition number."""
    root = np.linalg.cholesky(weight).T
    flat, right = (root @ Y).reshape(-1, Y.shape[-1]), (error @ root.T).ravel()
    change, _, _, singular = np.linalg.lstsq(flat, right, rcond=RANK)
    return np.asarray(change, np.float64), estimation.condition_number(singular)


def _inverse(information: Array) -> tuple[Array, Array]:
    """Inverse where there is information, and the projector on where there is none."""
    sizes, vectors = np.linalg.eigh(information)
    shown = sizes > RANK**2 * sizes[-1]
    shown &= sizes > 1e-14 * sizes[-1]
    some, none = vectors[:, shown], vectors[:, ~shown]
    return np.asarray((some / sizes[shown]) @ some.T), np.asarray(none @ none.T)


def _long_run(scores: Array, lags: int) -> Array:
    """Covariance of the sum of correlated scores of a stretch, with Bartlett's weights."""
    total = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return np.asarray(total)


# What a fit leaves of the torques: noise, or a motion that no inertias explain.

ALIKE = 0.5  # correlation of neighbouring rows; noise that passed the low-pass filter has about 0
SMALL = 1e-3  # of the torque; less is of no interest
NOT_THESE_INERTIAS = 'no set of inertias explains the motion with this geometry'
ANOTHER = (
    'the geometry, the robot, the order of joints or efforts is another one, or something slow '
    'disturbs it'
)
MUCH = 0.2  # of the torque, of which noise is seldom so much


class Unexplained(NamedTuple):
    """What a fit leaves of the torques."""

    share: Array  # of the torques, rms, shape (n,)
    correlation: float  # of what is left in one row and the next, the median of the joints

    @property
    def doubt(self) -> str:
        """That no inertias explain the motion, in one line; empty if what is left is noise."""
        most, alike = float(self.share.max()), self.correlation > ALIKE
        if not (most > MUCH or (alike and most > SMALL)):
            return ''
        what = ', and that is no noise' if alike else ''
        return f'{NOT_THESE_INERTIAS}: {100.0 * most:.2g} % of a torque is left{what}; {ANOTHER}'


# Which kinds of friction a robot shows: those that predict torques that were not fitted.
#
# A motion is cut into blocks of time. Each block is predicted by a fit to the others. A column
# stays if the error of its joint is less with it, and if its value is surely not zero.
#
# Source:
#     Roberts et al. (2017), Cross-validation strategies for data with temporal, spatial,
#     hierarchical, or phylogenetic structure, Ecography 40(8), for blocks.

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
