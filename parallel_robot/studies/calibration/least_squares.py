"""Geometry and zero angles by least squares, with what the poses cannot tell.

Combinations of the unknown that the poses do not tell, as the place of a base that nobody has
measured, are the singular vectors of the Jacobian with small singular values. As many of the
unknown as there are such combinations keep their values; the others can be told then.

Source:
    Hollerbach, Khalil, Gautier (2016), Model identification, in: Springer Handbook of Robotics,
    2nd edition, chapter 6; Golub, Van Loan (2013), Matrix Computations, 4th edition, section 5.5.7
    (subset selection by QR with column pivoting).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize, stats

from parallel_robot.studies import estimate as estimation
from parallel_robot.studies.calibration.pose_model import PoseModel, unexplained
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import Array

SAME = 1e-12  # of the largest singular value: a combination that changes nothing
ITERATIONS = 4  # of weights, and of what keeps its value
FLOOR = 1e-9  # m or rad, least noise that is assumed
TOLERANCE = 1e-10  # relative, at which the search ends
STEPS = 1000  # of a search, which is slow where the poses hardly tell a combination
FAR = 1e6  # of the noise, in place of poses that there are not


@dataclass(frozen=True)
class Fit(estimation.Fit):
    """Least-squares estimate of what is unknown; what keeps its value has no covariance."""

    degrees: float  # of freedom, of the noise
    noise: Array  # standard deviation of the measured coordinates, shape (k,)
    kept: tuple[int, ...]  # numbers of those that keep their values, as the poses cannot tell them
    untold: Array  # combinations that they cannot tell, unit vectors, shape (len(kept), P)
    left: Array  # what is left of the poses, shape (N, k)
    before: Array  # what was left before, shape (N, k)
    slopes: Array  # derivatives of the predicted poses, shape (N, k, P)


def beyond(share: float, degrees: float) -> float:
    """Standard errors that a share of errors exceeds, by Student's t."""
    return float(stats.t.isf(share / 2.0, degrees))


def fit(model: PoseModel, start: Array | None = None) -> Fit:
    """Estimate what is unknown.

    Args:
        model: What is looked for.
        start: Where the search begins, for what does not keep its value; None: as believed.

    Raises:
        BagError: there are too few poses, or the nominal robot is too far from them.
    """
    size, (poses, each) = len(model.start), model.measured.pose.shape
    least = size // each + 1
    if poses < least:
        what = f'{poses} poses of {each} numbers are too few for {size} unknown'
        raise BagError(f'{what}; at least {least} are needed')
    noise = model.noise
    kept, untold = first_kept(model)
    start = model.start if start is None else start
    for _ in range(ITERATIONS):
        values, noise, degrees = _weighted(model, start, kept, noise)
        slopes = model.slopes(values)
        found, combinations = kept_values(_flat(slopes, noise) * model.told, model.preference)
        if len(found) == len(kept):
            untold = combinations
            break
        kept, untold = found, combinations
    else:
        values, noise, degrees = _weighted(model, start, kept, noise)
        slopes = model.slopes(values)
    told = [k for k in range(size) if k not in kept]
    _, singular, vectors = np.linalg.svd(_flat(slopes, noise)[:, told], full_matrices=False)
    if not len(singular) or not singular[-1] > 0.0:
        raise np.linalg.LinAlgError('they tell nothing of it')
    inverse = vectors.T / singular
    covariance = np.zeros((size, size))
    covariance[np.ix_(told, told)] = inverse @ inverse.T
    return Fit(
        values,
        covariance,
        np.full(size, beyond(0.05, degrees)),
        estimation.condition_number(singular),
        degrees,
        noise,
        tuple(kept),
        untold,
        model.errors(values),
        model.errors(model.start),
        slopes,
    )


def first_kept(model: PoseModel) -> tuple[list[int], Array]:
    """What :func:`kept_values` are of the robot that is believed in, by a good tracker."""
    return kept_values(
        _flat(model.slopes(model.start), model.noise) * model.told, model.preference
    )


def kept_values(slopes: Array, preference: Array) -> tuple[list[int], Array]:
    """Which of the unknown keep their values, so that the others can be told.

    Args:
        slopes: Derivatives of what was measured over its noise, times the standard errors from
            which on an unknown is not told, shape (N, P).
        preference: How much each is to keep its value, shape (P,).

    Returns:
        Their numbers, and as many combinations that are not told, unit vectors.
    """
    _, singular, vectors = np.linalg.svd(slopes, full_matrices=False)
    weak = (singular < 1.0) | (singular < SAME * singular[0])
    untold = vectors[weak]
    if not len(untold):
        return [], untold
    _, _, order = linalg.qr(untold * preference, pivoting=True)
    return sorted(order[: len(untold)].tolist()), untold


def _weighted(
    model: PoseModel, start: Array, kept: list[int], noise: Array
) -> tuple[Array, Array, float]:
    """Estimates, and the noise of the coordinates of each unit that is left by them."""
    told = [k for k in range(len(model.start)) if k not in kept]
    values = start.copy()
    values[kept] = model.start[kept]
    for _ in range(ITERATIONS):
        values[told] = solved(model, values, told, noise)
        left = model.errors(values)
        orthogonal, _ = np.linalg.qr(_flat(model.slopes(values, kept), noise)[:, told])
        pull = (orthogonal**2).sum(axis=1).reshape(left.shape)
        found, least = noise.copy(), float(left.size)
        for of in model.columns_by_unit.values():
            degrees = max(left[:, of].size - float(pull[:, of].sum()), 0.5)
            least = min(least, max(degrees, 1.0))
            found[of] = max(np.sqrt((left[:, of] ** 2).sum() / degrees), FLOOR)
        same = np.allclose(found, noise, rtol=1e-3)
        noise = found
        if same:
            break
    return values, noise, least


def solved(
    model: PoseModel,
    start: Array,
    told: list[int],
    noise: Array,
    loss: str = 'linear',
    tolerance: float = TOLERANCE,
) -> Array:
    """Weighted least squares for those of the unknown that are told; or another loss of SciPy."""
    kept = set(range(len(start))) - set(told)

    def whole(x: Array) -> Array:
        values = start.copy()
        values[told] = x
        return values

    def residual(x: Array) -> Array:
        left = model.left(whole(x))
        return np.full(model.measured.pose.size, FAR) if left is None else (left / noise).ravel()

    def jacobian(x: Array) -> Array:
        return -_flat(model.slopes(whole(x), kept), noise)[:, told]

    found = optimize.least_squares(
        residual,
        start[told],
        jacobian,
        x_scale=model.told[told],
        loss=loss,
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=STEPS,
    )
    if not found.success or model.left(whole(found.x)) is None:
        raise unexplained()
    return np.asarray(found.x, np.float64)


def _flat(slopes: Array, noise: Array) -> Array:
    """Derivatives over the noise, one row for each number that was measured, shape (N k, P)."""
    return np.asarray((slopes / noise[:, np.newaxis]).reshape(-1, slopes.shape[-1]))


# Poses that are not what the others tell: a tracker that lost its target, rows that were swapped.
#
# They hide behind the noise that they make of a least-squares fit. So a fit with a robust loss, of
# the scale of the median error, tells them first; then least squares of those that are left judge
# each pose, those that are left out, too, by what they predict of it, until none changes sides. In
# that way the intervals are those of least squares, and without outliers so is the estimate.
#
# Source:
#     Rousseeuw, Leroy (1987), Robust Regression and Outlier Detection, chapter 1 (reweighted least
#     squares after a robust fit); Cook, Weisberg (1982), Residuals and Influence in Regression,
#     section 2.2 (studentised residuals, of a pose that is left out).

STRAY = 6.0  # standard deviations, an error that is doubted; with few poses
FALSE = 0.01  # it is one that clean poses exceed in so many calibrations
EXACT = 0.01  # of the noise of a good tracker, below which it is not of poses but of numbers
TUNED = 2.385  # of the scale, of Cauchy's loss: 95 % efficient (Holland, Welsch, 1977)
ROUNDS = 10
SETTLED = 0.02  # relative change of the scale
COARSE = 1e-5  # relative, at which a search for outliers ends


class Outlier(NamedTuple):
    """A pose that is not what the others tell."""

    time: float  # [s]
    off: Array  # measured less predicted by the others [m or rad], shape (k,)
    share: Array  # the same over their standard deviations, shape (k,)


def summary(count: int, poses: int) -> str:
    """How many of some poses are outliers, in words."""
    return (
        f'{count} of {poses} poses are more than {STRAY:g} standard deviations beside what the '
        'others tell'
    )


class Sifted(NamedTuple):
    """Poses that tell the same robot, and others."""

    used: PoseModel  # what is looked for, by poses that tell the same
    found: Fit  # least squares of these
    outliers: tuple[Outlier, ...]  # the others


def sifted(model: PoseModel, start: Array) -> Sifted:
    """Tell outliers from other poses, and estimate what is unknown by these.

    Where less than half of the poses tell the same robot, all are used.

    Args:
        model: What is looked for.
        start: Where the search begins, for what does not keep its value.
    """
    count, each = model.measured.pose.shape
    values, scale = _robust(model, start)
    far = np.abs(model.errors(values) / scale).max(axis=1)
    least = (count + len(values) // each) // 2 + 1  # as many are believed at first
    used = far <= max(STRAY, float(np.sort(far)[min(least, count) - 1]))
    for _ in range(ROUNDS):
        believed, part = used, model.of(used)
        found = fit(part, values)
        values, left = found.values, model.errors(found.values)
        share = _deviations(model, found, left, used)
        near = share.max(axis=1) <= max(STRAY, beyond(FALSE / share.size, found.degrees))
        if (near == used).all() or 2 * near.sum() <= count:
            break
        used = near
    if 2 * near.sum() <= count:
        return Sifted(model, fit(model, values), ())
    stray = np.flatnonzero(~believed).tolist()
    time = model.measured.time
    return Sifted(part, found, tuple(Outlier(float(time[k]), left[k], share[k]) for k in stray))


def _robust(model: PoseModel, start: Array) -> tuple[Array, Array]:
    """Estimates by a robust loss, and the scale of what they leave, shape (k,)."""
    values, kept = start.copy(), first_kept(model)[0]
    values[kept] = model.start[kept]
    scale = good = model.noise
    told = [k for k in range(len(values)) if k not in kept]
    for _ in range(ROUNDS):
        before, scale = scale, np.maximum(_scale(model, model.errors(values)), EXACT * good)
        if np.allclose(scale, before, rtol=SETTLED):
            break
        values[told] = solved(model, values, told, TUNED * scale, loss='cauchy', tolerance=COARSE)
    return values, scale


def _scale(model: PoseModel, left: Array) -> Array:
    """Standard deviation by the median of each unit, shape (k,)."""
    of = {
        unit: 1.4826 * np.median(np.abs(left[:, columns]))
        for unit, columns in model.columns_by_unit.items()
    }
    return np.array([of[unit] for unit in model.units])


def _deviations(model: PoseModel, found: Fit, left: Array, used: Array) -> Array:
    """Errors `left` over their standard deviations, shape (N, k): of poses that are used, less."""
    slopes = model.slopes(found.values)
    noise = np.maximum(found.noise, EXACT * model.noise)
    pull = ((slopes @ found.covariance) * slopes).sum(axis=2)
    variance = noise**2 + np.where(used[:, np.newaxis], -pull, pull)
    return np.asarray(np.abs(left) / np.sqrt(np.maximum(variance, 1e-3 * noise**2)))


# A spread of starts where the first one leaves much: least squares know the next valley alone.

MOST_OF_NOISE = 10.0  # of a good tracker: with less left there is nothing better
STARTS = 5  # the nominal robot, and others beside it by as much as makes an unknown untold
ALIKE = 0.1  # of the noise, by which poses of the same answer differ
SIMILAR = 1.1  # of the median error of the best answer: another one is as good


class Starts(NamedTuple):
    """From where an answer was looked for."""

    tried: int
    agreeing: int  # starts that end in the answer
    rivals: int  # starts that end in another one which is about as good


def search(model: PoseModel) -> tuple[Sifted, Starts]:
    """Estimate what is unknown: the best of some starts, the same ones at every call.

    Raises:
        BagError: there are too few poses, or none of the starts ends.
    """
    noise = model.noise
    rng, spread = np.random.default_rng(0), model.told / model.preference
    ends: list[Sifted] = []
    failure: Exception | None = None
    for tried in range(1, STARTS + 1):
        beside = spread * rng.normal(size=len(spread)) if tried > 1 else 0.0 * spread
        try:
            ends.append(sifted(model, model.start + beside))
        except (BagError, np.linalg.LinAlgError) as error:
            failure = failure or error
        if tried == 1 and ends and (ends[0].found.noise <= MOST_OF_NOISE * noise).all():
            break
    if failure is not None and not ends:
        raise failure
    left = [model.errors(each.found.values) for each in ends]
    costs = [float(np.median(np.abs(each / noise))) for each in left]  # outliers do not count
    best = int(np.argmin(costs))
    near = ALIKE * ends[best].found.noise
    same = [bool((np.abs(each - left[best]) < near).all()) for each in left]
    rivals = sum(
        cost < SIMILAR * costs[best] and not alike for cost, alike in zip(costs, same, strict=True)
    )
    return ends[same.index(True)], Starts(tried, sum(same), rivals)
