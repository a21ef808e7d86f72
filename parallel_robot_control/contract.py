"""What a control law gets and gives: the seam between the laws and everything else.

A law is a module with ``Gains``, ``initial_memory(n)`` and a kernel ``update``; it is written for
n joints and knows nothing of the robot but its model. It may have ``judge(gains)``, which returns
warnings or raises InputError where its theory forbids a set of gains. See
:mod:`parallel_robot_control.laws.s_fotsmc`.

Around the law stands :mod:`parallel_robot_control.cycle`: it limits the torque, and after a fault
replaces it by a safe action. A law may ask for anything, but what it integrates must not wind up
while less is applied: see :mod:`parallel_robot_control.antiwindup`.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.contract import Model

Array = NDArray[np.float64]


class JointReference(NamedTuple):
    """Desired joint motion at one time [rad, rad/s, rad/s^2], each shape (n,)."""

    position: Array
    velocity: Array
    acceleration: Array


class Feedback(NamedTuple):
    """Measured joint motion at one time, and what became of the last torque, each shape (n,).

    Attributes:
        position: [rad].
        velocity: [rad/s].
        excess: Torque of the last update beyond what the limits let through [N m]; mostly zero.
    """

    position: Array
    velocity: Array
    excess: Array


class ControlOutput(NamedTuple):
    """Result of one update.

    Attributes:
        torque: [N m], shape (n,).
        sliding_variable: In the law's own unit, shape (n,).
        coupled_error: e_c, for those who watch [rad], shape (n,); e in a law without coupling.
        memory: What the law must know at its next update.
    """

    torque: Array
    sliding_variable: Array
    coupled_error: Array
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
        """Compute the joint torque of one control cycle; `dt` [s] is the time since the last."""
