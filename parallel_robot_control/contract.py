"""What a control law gets and gives: the seam between the laws and everything else.

A law is a module with ``Gains``, ``initial_memory(n)`` and a kernel ``update``; it is written for
n joints and knows nothing of the robot but its model. It may have ``judge(gains)``, which returns
warnings or raises InputError where its theory forbids a set of gains. See
:mod:`parallel_robot_control.laws.s_fotsmc`.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.dynamics import Model

Array = NDArray[np.float64]


class JointReference(NamedTuple):
    """Desired joint motion at one time [rad, rad/s, rad/s^2], each shape (n,)."""

    position: Array
    velocity: Array
    acceleration: Array


class Feedback(NamedTuple):
    """Measured joint motion at one time [rad, rad/s], each shape (n,)."""

    position: Array
    velocity: Array


class ControlOutput(NamedTuple):
    """Result of one update.

    Attributes:
        torque: [N m], shape (n,).
        sliding_variable: In the law's own unit, shape (n,).
        memory: What the law must know at its next update.
    """

    torque: Array
    sliding_variable: Array
    memory: Any


class Law(Protocol):
    """A law module."""

    Gains: Any

    def initial_memory(self, joints: int) -> Any:
        """Memory before the first update."""

    def update(
        self,
        gains: Any,
        model: Model,
        reference: JointReference,
        feedback: Feedback,
        memory: Any,
        dt: float,
    ) -> ControlOutput:
        """Compute the joint torque of one control cycle."""
