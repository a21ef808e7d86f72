"""What a fit leaves of the torques: noise, or a motion that no inertias explain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot.studies.identification.least_squares import Fit, Squares
from parallel_robot_model.common.units import Array

ALIKE = 0.5  # correlation of neighbouring rows; noise that passed the low-pass filter has about 0
SMALL = 1e-3  # of the torque; less is of no interest
UNKNOWN = 'no set of inertias explains the motion with this geometry'
MUCH = 0.2  # of the torque, of which noise is seldom so much


class Unexplained(NamedTuple):
    """What a fit leaves of the torques.

    Attributes:
        share: Of the torques, rms, shape (n,).
        correlation: Of what is left in one row and the next, the median of the joints.
    """

    share: Array
    correlation: float

    @property
    def doubt(self) -> str:
        """That no inertias explain the motion, in one line; empty if what is left is noise."""
        most, alike = float(self.share.max()), self.correlation > ALIKE
        if not (most > MUCH or (alike and most > SMALL)):
            return ''
        what = ', and that is no noise' if alike else ''
        return (
            f'{UNKNOWN}: {100.0 * most:.2g} % of a torque is left{what}; the geometry, the robot, '
            'the order of joints or efforts is another one, or something slow disturbs it'
        )


def unexplained(squares: Squares, fit: Fit) -> Unexplained:
    """Find what a fit leaves of the torques of its rows."""
    size = squares.rms(np.zeros(len(fit.values)))
    return Unexplained(fit.residual / np.maximum(size, 1e-300), float(np.median(fit.correlation)))
