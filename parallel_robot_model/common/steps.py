"""The usual step of stamps, of which single ones may be missing or late."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LONG = 1.5  # times the usual step, of one over missing stamps


def usual_step(steps: NDArray[np.int64]) -> float:
    """The usual one of steps from a stamp to the next, all positive [ns], shape (N,).

    What jitters is averaged over all of them; of long ones it is counted how many they are.
    """
    single = steps[steps < LONG * np.median(steps)]
    periods = np.maximum(np.rint(steps / single.mean()), 1.0)
    return float(steps.sum() / periods.sum())
