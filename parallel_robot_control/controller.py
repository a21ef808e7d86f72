"""The controller without ROS: references and states in by stamp, torques out."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.cycle import CYCLE_TEXT, run_cycle
from parallel_robot_control.laws import prepare
from parallel_robot_control.messages import Telemetry
from parallel_robot_interface import config
from parallel_robot_interface.cdr import NANOSECONDS
from parallel_robot_interface.errors import InputError
from parallel_robot_interface.fields import Field
from parallel_robot_interface.loop import LoopParameters
from parallel_robot_model.kinematics import FOUND
from parallel_robot_model.parameters import RobotParameters, validate
from trajectory_gen.trajectory import Trajectory

LOST = 0.25  # s, after which a state that comes again was not a copy in the queue
LONGEST = NANOSECONDS // 20  # ns, over which a reference is extrapolated
RESTART = NANOSECONDS // 2  # a jump of the stamps by more than this is a new run of the plant


class ControllerParameters(NamedTuple):
    """What the controller needs beside robot and law."""

    guess: Annotated[
        tuple[float, ...],
        Field('m, m, rad', 'pose from which the first forward kinematics starts'),
    ]


def first_guess(values: Mapping[str, Any]) -> list[float]:
    """The parameter ``controller.guess``, or the first pose of the scenario's trajectory.

    Raises:
        InputError: the parameter is not a pose.
    """
    given = list(config.group(values, ControllerParameters, 'controller').guess)
    if len(given) not in (0, 3):
        raise InputError(f'controller.guess must be empty or [x, y, phi], not {given}')
    return given or Trajectory.of(values).sample(0.0).pose[0].tolist()


class Sample(NamedTuple):
    """Answer to one state: the torque [N m], shape (n,), and what there is to tell of it."""

    torque: np.ndarray
    telemetry: Telemetry


class Controller:
    """Computes the torque of each state from the reference at the state's own stamp.

    Attributes:
        law: The active law.
        counts: How often something unusual happened, by its description.
        waiting: Whether the last state still has no answer for want of a reference.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Prepare robot, law and first guess from a resolved configuration.

        Raises:
            InputError: a value is wrong.
        """
        self._loop = config.group(values, LoopParameters, '')
        self._robot = validate(config.group(values, RobotParameters, 'robot'))
        self._guess = np.array(first_guess(values))
        self.law = prepare(self._loop.law, values)
        self.counts: Counter[str] = Counter()
        self._references: deque[tuple[int, JointReference]] = deque(maxlen=10_000)
        self._pending: tuple[int, Feedback] | None = None
        self._sample: Sample | None = None  # answer to the last state
        self._answered_at = 0.0
        self._last: int | None = None
        self._pose = self._guess
        self._integral = np.zeros(3)
        self._memory = self.law.memory
        zero = np.zeros(3)
        self._cycle(JointReference(zero, zero, zero), Feedback(zero, zero), self._loop.period)

    @property
    def waiting(self) -> bool:
        """Whether the last state still has no answer for want of a reference."""
        return self._pending is not None

    def add_reference(self, stamp: int, reference: JointReference) -> Sample | None:
        """Take a reference sample; answer a state that waited for it.

        Args:
            stamp: [ns].
            reference: Desired joint motion at the stamp.
        """
        if self._references and stamp <= self._references[-1][0]:
            if not self._loop.lockstep and self._references[-1][0] - stamp < RESTART:
                self.counts['reference stamps that repeat or go back'] += 1
                return None
            self._references.clear()
        self._references.append((stamp, reference))
        if self._pending is not None:
            return self._answer(*self._pending)
        return None

    def add_state(self, stamp: int, feedback: Feedback) -> Sample | None:
        """Take a state; answer it when there is a reference for it.

        Args:
            stamp: [ns].
            feedback: Measured joint motion at the stamp.
        """
        if self._last is not None and not 0 < stamp - self._last < RESTART:
            if self._loop.lockstep and stamp == self._last:
                lost = time.monotonic() - self._answered_at > LOST
                return self._sample if lost else None  # the plant asks again
            if not self._loop.lockstep and abs(stamp - self._last) < RESTART:
                self.counts['state stamps that repeat or go back'] += 1
                return None
            self.counts['new runs of the plant'] += 1
            self._reset()
        return self._answer(stamp, feedback)

    def _answer(self, stamp: int, feedback: Feedback) -> Sample | None:
        reference = self._reference_at(stamp)
        self._pending = None
        if reference is None:
            self._pending = (stamp, feedback) if self._loop.lockstep else None
            return None
        dt = self._loop.period if self._last is None else (stamp - self._last) / NANOSECONDS
        self._last = stamp
        integral = self._integral
        cycle = self._cycle(reference, feedback, dt)
        if cycle.status == FOUND:
            self._pose, self._integral, self._memory = cycle.pose, cycle.integral, cycle.memory
        else:
            self.counts[CYCLE_TEXT[cycle.status]] += 1
        telemetry = Telemetry(
            (reference.position - feedback.position)[np.newaxis],
            (reference.velocity - feedback.velocity)[np.newaxis],
            integral[np.newaxis],
            cycle.sliding_variable[np.newaxis],
            self.law.coupling_gain,
        )
        self._sample = Sample(cycle.torque, telemetry)
        self._answered_at = time.monotonic()
        return self._sample

    def _reference_at(self, stamp: int) -> JointReference | None:
        """Newest reference not after `stamp`, extrapolated to it with its own derivatives.

        When it is older than LONGEST its position is held: a motion that has ended does not go on.

        In lockstep the sample of exactly this stamp, or a later one, must have come: what the
        answer is then does not depend on which message was faster.
        """
        references = self._references
        if self._loop.lockstep and not (references and references[-1][0] >= stamp):
            return None
        while len(references) > 1 and references[1][0] <= stamp:
            references.popleft()
        if not references or references[0][0] > stamp:
            return None
        known, reference = references[0]
        if known == stamp:
            return reference
        if stamp - known > LONGEST:
            self.counts['states without a fresh reference: the last one is held'] += 1
            still = np.zeros(len(reference.position))
            return JointReference(reference.position, still, still)
        dt = (stamp - known) / NANOSECONDS
        return JointReference(
            reference.position + dt * reference.velocity + 0.5 * dt**2 * reference.acceleration,
            reference.velocity + dt * reference.acceleration,
            reference.acceleration,
        )

    def _cycle(self, reference: JointReference, feedback: Feedback, dt: float) -> Any:
        return run_cycle(
            self.law.update,
            self.law.gains,
            self._robot,
            reference,
            feedback,
            self._pose,
            self._integral,
            self._memory,
            dt,
        )

    def _reset(self) -> None:
        self._pose = self._guess
        self._integral = np.zeros(3)
        self._memory = self.law.memory
        self._last = None
        self._pending = None
