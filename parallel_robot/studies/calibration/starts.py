"""A spread of starts where the first one leaves much: least squares know the next valley alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot.studies.calibration.least_squares import NOISE
from parallel_robot.studies.calibration.outliers import Sifted, sifted
from parallel_robot.studies.calibration.pose_model import PoseModel
from parallel_robot_model.common.errors import BagError

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
    noise = np.array([NOISE[unit] for unit in model.units])
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
    left = [np.asarray(model.left(each.found.values)) for each in ends]
    costs = [float(np.median(np.abs(each / noise))) for each in left]  # outliers do not count
    best = int(np.argmin(costs))
    near = ALIKE * ends[best].found.noise
    same = [bool((np.abs(each - left[best]) < near).all()) for each in left]
    rivals = sum(
        cost < SIMILAR * costs[best] and not alike for cost, alike in zip(costs, same, strict=True)
    )
    return ends[same.index(True)], Starts(tried, sum(same), rivals)
