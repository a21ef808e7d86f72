"""Poses that are not what the others tell: a tracker that lost its target, rows that were swapped.

They hide behind the noise that they make of a least-squares fit. So a fit with a robust loss, of
the scale of the median error, tells them first; then least squares of those that are left judge
each pose, those that are left out, too, by what they predict of it, until none changes sides. In
that way the intervals are those of least squares, and without outliers so is the estimate.

Source:
    Rousseeuw, Leroy (1987), Robust Regression and Outlier Detection, chapter 1 (reweighted least
    squares after a robust fit); Cook, Weisberg (1982), Residuals and Influence in Regression,
    section 2.2 (studentised residuals, of a pose that is left out).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot.studies.calibration import least_squares
from parallel_robot.studies.calibration.least_squares import Fit
from parallel_robot.studies.calibration.pose_model import PoseModel
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import Array

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

    Raises:
        BagError: there are too few poses, or least squares do not end.
    """
    count, each = model.measured.pose.shape
    values, scale = _robust(model, start)
    far = np.abs(model.errors(values) / scale).max(axis=1)
    least = (count + len(values) // each) // 2 + 1  # as many are believed at first
    used = far <= max(STRAY, float(np.sort(far)[min(least, count) - 1]))
    for _ in range(ROUNDS):
        believed, part = used, model.of(used)
        found = least_squares.fit(part, values)
        values, left = found.values, model.errors(found.values)
        share = _deviations(model, found, left, used)
        near = share.max(axis=1) <= max(
            STRAY, least_squares.beyond(FALSE / share.size, found.degrees)
        )
        if (near == used).all() or 2 * near.sum() <= count:
            break
        used = near
    if 2 * near.sum() <= count:
        return Sifted(model, least_squares.fit(model, values), ())
    stray = np.flatnonzero(~believed).tolist()
    time = model.measured.time
    return Sifted(part, found, tuple(Outlier(float(time[k]), left[k], share[k]) for k in stray))


def _robust(model: PoseModel, start: Array) -> tuple[Array, Array]:
    """Estimates by a robust loss, and the scale of what they leave, shape (k,)."""
    values, kept = start.copy(), least_squares.first_kept(model)[0]
    values[kept] = model.start[kept]
    scale = good = model.noise
    told = [k for k in range(len(values)) if k not in kept]
    for _ in range(ROUNDS):
        before, scale = scale, np.maximum(_scale(model, model.errors(values)), EXACT * good)
        if np.allclose(scale, before, rtol=SETTLED):
            break
        values[told] = least_squares.solved(
            model, values, told, TUNED * scale, loss='cauchy', tolerance=COARSE
        )
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
