"""The usual step of stamps, of which single ones may be missing or late."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LONG = 1.5  # times the usual step, of one over missing stamps
PARTS = (1, 2, 3)  # of the median of the steps, that a single step may be
CLEARER = 0.5  # of the distance from whole numbers of steps, at which a smaller part is taken


def usual_step(steps: NDArray[np.int64]) -> float:
    """The usual one of steps from a stamp to the next, all positive [ns], shape (N,).

    What jitters is averaged over all of them; of long ones it is counted how many they are. Where
    stamps are missing after every other one, the median is no single step.
    """
    usual, least = float(steps.mean()), np.inf
    for part in PARTS:
        single = steps[steps < LONG / part * np.median(steps)]
        if not len(single):
            break
        counts = np.maximum(np.rint(steps / single.mean()), 1.0)
        step = float(steps.sum() / counts.sum())
        apart = np.abs(steps / step - counts).mean()
        if apart < CLEARER * least:
            usual, least = step, apart
    return usual
