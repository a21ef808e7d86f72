"""The arrays shared by the controller and its kernels: Python reads them between two calls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array
from parallel_robot_model.messages import layouts

NEVER = -1  # a stamp that no message has
FOREVER = 2**63 - 1  # ns
AGES = 4096  # answers for which the age of the state is kept

# Rows of Shared.telemetry
ERROR, ERROR_RATE, COUPLED, SLIDING = range(4)
# and of Shared.numbers.
(
    ACTED,  # bits of the limits that acted
    LAST, FROM, START, END,  # stamps: last answer, first to answer, start and end of the motion
    HEARD,  # time of the last answer on the monotonic clock; 0: none, or the end
    LOGGED, ANSWERS,  # counts: rows of the log, answers
    AGE,  # of the last state, from the measurement until the torque acts [ns]
    PHASE,  # of the identification of the delay, see lock_in.py
    CAUSE,  # fault whose cause was there at the last state
    ACTED_AT,  # stamp of the last state at which a limit acted
    UNTIL,  # stamp of the newest reference that counts
    WAITS,  # whether the last reference was overdue
) = range(14)  # fmt: skip


class Shared(NamedTuple):
    """The arrays that Python and the kernels share.

    Attributes:
        measured: Position, velocity and effort of the last state, shape (3, n).
        telemetry: Telemetry of the last answer, one row a vector, shape (4, n).
        numbers: Limits, stamps and counts, shape (14,).
        command: The command message of the last answer, serialised.
        torques: The torques in it [N m], shape (n,).
        log: Stamps of state and reference of each answer, and when its torque acts [ns],
            shape (AGES, 3).
        commanded: Torques of each answer in the log [N m], shape (AGES, n).
        ages: Ages of the states when they were answered [ns], shape (AGES,).
    """

    measured: Array
    telemetry: Array
    numbers: NDArray[np.int64]
    command: NDArray[np.uint8]
    torques: Array
    log: NDArray[np.int64]
    commanded: Array
    ages: NDArray[np.int64]


def shared(joints: int) -> Shared:
    """Arrays before the first state."""
    command = layouts.float64_multi_array(joints).draft()
    made = Shared(
        np.zeros((3, joints)),
        np.zeros((4, joints)),
        np.zeros(14, np.int64),
        command.bytes,
        command.fields['data'],
        np.zeros((AGES, 3), np.int64),
        np.zeros((AGES, joints)),
        np.zeros(AGES, np.int64),
    )
    made.numbers[[LAST, START, END]] = NEVER
    made.numbers[UNTIL] = FOREVER
    return made
