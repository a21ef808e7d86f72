"""What a controller outside Python calls: one control cycle, its inputs and outputs in memory."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.approach import BACK
from parallel_robot_control.assembly import Control
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import CycleState, When, run_cycle, taking_over
from parallel_robot_model.compiler import (
    Boxed,
    KeptValue,
    Space,
    keep,
    kernel,
    present,
    propose,
    read_at,
    select,
    write_at,
)

# Rows of numbers for each joint,
POSITION, VELOCITY, EFFORT, REFERENCE, TORQUE, SLIDING_VARIABLE, COUPLED_ERROR = (
    0,
    1,
    2,
    3,
    6,
    7,
    8,
)
ROWS = 9  # the reference has three
# and numbers behind them.
AGE, EFFORT_KNOWN, JOINS, SAMPLE, FAULT, CAUSE, ACTED = range(7)
NUMBERS = 7


class LawInstance(NamedTuple):
    """A controller with its memory.

    Attributes:
        setup: Law, robot and limits, see :class:`ControlSetup`.
        state: State after the cycle before, a KeptValue.
        like: A state, for its type.
        values: Address of inputs and outputs: ROWS for each joint, then NUMBERS.
        period: Time between states [s].
    """

    setup: Any
    state: int
    like: CycleState
    values: int
    period: float


def law_instance(control: Control, period: float) -> Boxed:
    """A controller before its first state, boxed.

    Args:
        control: The controller; its law has an empty memory.
        period: Time between states [s].
    """
    control.law.memory.begin()
    joints = len(control.state.held)
    values = Space(ROWS * joints + NUMBERS)
    values.floats[ROWS * joints + FAULT] = control.state.fault
    return Boxed(
        LawInstance(control.setup, KeptValue(control.state), control.state, values, period)
    )


@kernel
def begin_law(instance: LawInstance) -> int:
    """Nothing: a law has no outputs before its first state."""
    return 0


@kernel
def answer_state(instance: LawInstance) -> int:
    """Compute the torque for the state in the inputs; 0."""
    values, row = instance.values, instance.like.held
    first = ROWS * len(row)
    state = present(instance.state, instance.like)
    desired = JointReference(
        read_at(values, REFERENCE, row),
        read_at(values, REFERENCE + 1, row),
        read_at(values, REFERENCE + 2, row),
    )
    known = read_at(values, first + EFFORT_KNOWN, 0.0) != 0.0
    effort = select(known, read_at(values, EFFORT, row), np.zeros_like(row) + np.nan)
    sample = int(read_at(values, first + SAMPLE, 0.0))
    if sample == 0 and read_at(values, first + JOINS, 0.0) != 0.0:  # see transitions.joining
        last = taking_over(state.last, effort)
        state = CycleState(
            state.pose,
            last,
            state.excess,
            state.held,
            state.fault,
            state.estimated,
            BACK,
            state.lost,
        )
    cycle = run_cycle(
        instance.setup,
        desired,
        read_at(values, POSITION, row),
        read_at(values, VELOCITY, row),
        effort,
        state,
        When(sample, read_at(values, first + AGE, 0.0), instance.period),
    )
    propose(instance.state, cycle.state, instance.like)
    keep(instance.state)
    write_at(values, TORQUE, cycle.torque)
    write_at(values, SLIDING_VARIABLE, cycle.sliding_variable)
    write_at(values, COUPLED_ERROR, cycle.coupled_error)
    write_at(values, first + SAMPLE, float(sample + 1))
    write_at(values, first + FAULT, float(cycle.state.fault))
    write_at(values, first + CAUSE, float(cycle.cause))
    write_at(values, first + ACTED, float(cycle.acted))
    return 0
