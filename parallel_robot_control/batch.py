"""Many control cycles as one compiled loop, over states and references known in advance."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import cycle_of
from parallel_robot_control.reference_buffer import reference_row
from parallel_robot_control.safety.limiting import When
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, read_row, write_row


class States(NamedTuple):
    """States of the robot, one row each."""

    position: Array  # measured angles [rad], shape (N, n)
    velocity: Array  # measured rates [rad/s], shape (N, n)
    effort: Array  # torque applied before each [N m], NaN where it is not known, shape (N, n)
    dt: Array  # time since the previous state [s], shape (N,)
    sample: NDArray[np.int64]  # index of the sample from which on the torque acts, shape (N,)
    age: Array  # from the measurement to that sample [s], shape (N,)

    def part(self, rows: slice) -> States:
        """Some of them."""
        whole: tuple[Any, ...] = self
        return States(*(row[rows] for row in whole))


class Batch(NamedTuple):
    """Answers to the first states."""

    torque: Array  # commanded torque [N m], shape (answered, n)
    answered: int  # number of states answered before the first unexpected torque


def answer(
    control: Any,
    references: JointReference,
    states: States,
    expected: Array,
) -> Batch:
    """Answer states until a torque is not the expected one; that state, too, is remembered.

    Args:
        control: The ControlSetup, boxed.
        references: Desired joint motion when the torques act, each shape (N, n).
        states: See States.
        expected: Expected torques [N m], shape (N, n); NaN where any torque is accepted.
    """
    result: Batch = answers(cycle_of(control), control, references, states, expected)
    return result


@kernel
def answers(
    run_cycle: Any,
    control: Any,
    references: JointReference,
    states: States,
    expected: Array,
) -> Batch:
    """The answers of :func:`answer`, with the cycle as FunctionValue."""
    count = len(states.dt)
    torque, row = np.empty((count, expected.shape[1])), control.memory.state.fault_position
    for k in range(count):
        reference = reference_row(references, k, row)
        position, velocity = read_row(states.position, k, row), read_row(states.velocity, k, row)
        when = When(states.sample[k], states.age[k], states.dt[k])
        effort = read_row(states.effort, k, row)
        cycle = run_cycle(control, reference, position, velocity, effort, when)
        write_row(torque, k, cycle.torque)
        for i in range(expected.shape[1]):
            if torque[k, i] != expected[k, i] and not np.isnan(expected[k, i]):
                return Batch(torque[:k].copy(), k)
    return Batch(torque, count)
