"""The arrays shared by the controller and its kernels: Python reads them between two calls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.cycle import CycleState
from parallel_robot_control.estimator import Estimated
from parallel_robot_control.safety import Last
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.compiler import vector
from parallel_robot_model.messages import layouts

NEVER = -1  # a stamp that no message has
FOREVER = 2**63 - 1  # ns
AGES = 4096  # answers for which the age of the state is kept

# Rows of Shared.vectors,
(
    POSITION, REFERENCE, TORQUE, OFFSET, EXCESS, HELD, TRACKED, RATE,  # of the cycle,
    VELOCITY, EFFORT,  # and as measured
) = range(10)  # fmt: skip
MEASURED = [POSITION, VELOCITY, EFFORT]
# of Shared.telemetry,
ERROR, ERROR_RATE, COUPLED, SLIDING = range(4)
# and of Shared.numbers.
(
    FAULT, TAKES_OVER, KNOWN, ACTED,  # of the cycle
    LAST, FROM, START, END,  # stamps: last answer, first to answer, start and end of the motion
    HEARD,  # time of the last answer on the monotonic clock; 0: none, or the end
    LOGGED, ANSWERS,  # counts: rows of the log, answers
    AGE,  # of the last state, from the measurement until the torque acts [ns]
    PHASE,  # of the identification of the delay, see lock_in.py
    CAUSE,  # fault whose cause was there at the last state
    ACTED_AT,  # stamp of the last state at which a limit acted
    UNTIL,  # stamp of the newest reference that counts
    POSE_LOST, BEGINS,  # of the cycle
    WAITS,  # whether the last reference was overdue
) = range(19)  # fmt: skip


class Shared(NamedTuple):
    """The arrays that Python and the kernels share.

    Attributes:
        pose: Pose of the last cycle, shape (m,).
        vectors: State of the cycle, one row a vector, shape (10, n).
        telemetry: Telemetry of the last answer, one row a vector, shape (4, n).
        numbers: Fault, stamps and counts, shape (19,).
        command: The command message of the last answer, serialised.
        torques: The torques in it [N m], shape (n,).
        log: Stamps of state and reference of each answer, and when its torque acts [ns],
            shape (AGES, 3).
        ages: Ages of the states when they were answered [ns], shape (AGES,).
    """

    pose: Array
    vectors: Array
    telemetry: Array
    numbers: NDArray[np.int64]
    command: NDArray[np.uint8]
    torques: Array
    log: NDArray[np.int64]
    ages: NDArray[np.int64]


def shared(state: CycleState) -> Shared:
    """Arrays before the first state, with the state of the cycle."""
    joints = len(state.held)
    command = layouts.float64_multi_array(joints).draft()
    made = Shared(
        np.array(state.pose),
        np.zeros((10, joints)),
        np.zeros((4, joints)),
        np.zeros(19, np.int64),
        command.bytes,
        command.fields['data'],
        np.zeros((AGES, 3), np.int64),
        np.zeros(AGES, np.int64),
    )
    made.numbers[[LAST, START, END]] = NEVER
    made.numbers[UNTIL] = FOREVER
    store(made, state)
    return made


def stored(arrays: Shared) -> CycleState:
    """The state of the cycle."""
    v, numbers = [vector(row) for row in arrays.vectors], arrays.numbers
    last = Last(
        v[POSITION],
        v[REFERENCE],
        v[TORQUE],
        v[OFFSET],
        bool(numbers[TAKES_OVER]),
        bool(numbers[KNOWN]),
    )
    estimated = Estimated(v[TRACKED], v[RATE])
    begins = int(numbers[BEGINS])
    fault = int(numbers[FAULT])
    lost = bool(numbers[POSE_LOST])
    return CycleState(
        vector(arrays.pose), last, v[EXCESS], v[HELD], fault, estimated, begins, lost
    )


def store(arrays: Shared, state: CycleState) -> None:
    """Replace the state of the cycle."""
    last = state.last
    arrays.pose[:] = state.pose
    arrays.vectors[:VELOCITY] = (
        last.position,
        last.reference,
        last.torque,
        last.offset,
        state.excess,
        state.held,
        *state.estimated,
    )
    arrays.numbers[[FAULT, TAKES_OVER, KNOWN]] = state.fault, last.takes_over, last.known
    arrays.numbers[[POSE_LOST, BEGINS]] = state.lost, state.begins
