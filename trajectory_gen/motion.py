"""What a reference motion is: a pose with two derivatives as a function of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PoseMotion(NamedTuple):
    """Pose with two derivatives at one time.

    Attributes:
        pose: (x, y, phi) [m, m, rad], shape (3,).
        rate: Its first derivative [m/s, m/s, rad/s], shape (3,).
        acceleration: Its second derivative [m/s^2, m/s^2, rad/s^2], shape (3,).
    """

    pose: Array
    rate: Array
    acceleration: Array
