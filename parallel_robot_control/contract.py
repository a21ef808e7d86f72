"""What a control law receives and returns: the interface between the laws and the rest.

Joint vectors and matrices come as the vectors of :mod:`parallel_robot_model.compiler`: they are
used as arrays are, element by element, but cannot be changed. A custom law that changes or slices
them, or makes arrays of its own, gets arrays instead.

A law is a module with what :class:`LawModule` has and, if need be, what :class:`Law` has defaults
for; it is written for n joints and knows nothing of the robot but its model. See
:mod:`parallel_robot_control.laws.s_fotsmc`.

The law runs inside :mod:`parallel_robot_control.cycle`, which limits the torque and after a fault
replaces it with a safe action. A law may demand any torque, but its integrals must not wind up
while less is applied: see :mod:`parallel_robot_control.terms`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from parallel_robot_model.common.units import Array, JointUnits
from parallel_robot_model.compiler import vector
from parallel_robot_model.robots.contract import Model


class JointReference(NamedTuple):
    """Desired joint motion at one time [rad, rad/s, rad/s^2], each shape (n,)."""

    position: Array
    velocity: Array
    acceleration: Array


class Feedback(NamedTuple):
    """Joint motion at one time, and what became of the last torque, each shape (n,).

    The motion is the measured one, or with a Kalman filter the one predicted for the moment at
    which the torque will act. The reference is that of the same moment; for a law that asks for
    the age of what was measured, that of the moment at which the torque will act.

    Attributes:
        position: Angles [rad].
        velocity: Rates [rad/s].
        excess: Torque of the last update beyond what the limits let through [N m]; mostly zero.
        disturbance: Torque against the motors that the model does not know [N m]: friction, loads,
            wrong masses; zero without a Kalman filter.
        place: A^T A, A the Jacobian of the place of the end effector by the joints, that of all
            joints where there is no place, shape (n, n); without meaning for a law that does not
            ask for it.
        age: From the measurement to the moment at which the torque acts [s], for a law whose
            ESTIMATOR is 'aged'; else 0.
    """

    position: Array
    velocity: Array
    excess: Array
    disturbance: Array
    place: Array = vector(())
    age: float = 0.0


class ControlOutput(NamedTuple):
    """Result of one update.

    Attributes:
        torque: Demanded torque [N m], shape (n,).
        sliding_variable: Sliding variable in the law's own unit, shape (n,).
        coupled_error: e_c, for monitoring [rad], shape (n,); e in a law without coupling.
        memory: State of the law for its next update.
    """

    torque: Array
    sliding_variable: Array
    coupled_error: Array
    memory: Any


class Foreign(Protocol):
    """What is outside: the ``foreign`` of a law whose update asks another process.

    Attributes:
        ESTIMATOR: The kind of estimator that it needs, once it has an initial memory.
        ready: Whether its process is there.
    """

    @property
    def ESTIMATOR(self) -> str: ...  # noqa: D102

    @property
    def ready(self) -> bool: ...  # noqa: D102

    def check_loop(self, period: float, units: JointUnits) -> None:
        """Refuse a period [s] or joints that are not the law's, by an InputError."""

    def choose(self, memory: Any, gains: Any) -> None:
        """Have gains for one who asks with an initial memory."""

    def start(self) -> None:
        """Have a process, whatever became of the one before; InputError without one."""

    def failure(self, gains: Any) -> str:
        """Why the last update gave no torque; empty if that is not known."""


class LawModule(Protocol):
    """What every law module has."""

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
        """Compute the joint torque of one control cycle.

        The arguments are the same in every law; its own docstring has the formula, the meaning
        of the sliding variable, and the source.

        Args:
            gains: The law's Gains.
            model: M and Q of the nominal robot at the feedback.
            reference: Desired joint motion [rad, rad/s, rad/s^2].
            feedback: Measured or predicted joint motion [rad, rad/s], disturbance [N m].
            memory: What the last update returned, at first of `initial_memory`.
            dt: Time since the last update [s].

        Returns:
            Torque [N m], sliding variable, coupled error [rad], memory for the next update.
        """


class Law(LawModule):
    """A law: what its module defines, and defaults for what it leaves out."""

    TITLE: str | None = None  # in pictures and reports, where it is not the name
    ESTIMATOR = 'none'  # the kind of estimator that it needs
    LEVELS = 0.0  # time over which this one is to find noise and disturbance [s]
    PLACE = False  # whether it needs the place in its feedback
    MODEL = True  # False if all of its torque corrects, see repetition.py
    foreign: Foreign | None = None

    @classmethod
    def of(cls, module: Any) -> Law:
        """The law of a module."""
        law = cls()
        vars(law).update(vars(module))
        return law

    def validate_gains(self, gains: Any) -> Sequence[str]:
        """Warnings of gains; raises InputError where the theory forbids them."""
        return ()

    def noise_warnings(self, gains: Any, noise: float, period: float) -> Sequence[str]:
        """Warnings for noisy rates [rad/s, rms] and a period [s], where that is known."""
        return ()
