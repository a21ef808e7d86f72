"""Whether the states say what the robot does: the way of each joint beside the sum of its rates.

Over the last hundredths of a second, the way that a joint went and the integral of its rate must
agree. A position that does not change at all while the rate goes on, and a rate of exactly zero
while the position changes, are seen even sooner.
"""

from __future__ import annotations

import numpy as np

from parallel_robot_control.estimation import cycle_memory
from parallel_robot_control.safety import faults
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, every, inner, read_at, select, some, write_at

WINDOW = 0.06  # s, time constant with which ways are forgotten
ALIKE = 0.01  # of the tolerance, within which a way and a rate of one state agree
SHARE = 0.5  # of the tolerance, that a single state adds at most: one odd state is no proof
JUMP = 2.0  # tolerances: a single way so much longer than its rate says is a jump
LAG = 0.25  # share of the ways by which they may differ: rates may be filtered


@inner
def inconsistent(
    memory: int,
    tolerance: float,
    position: Array,
    velocity: Array,
    before: Array,
    comparable: bool,
    dt: float,
) -> int:
    """The fault of states whose positions and rates contradict each other, else NONE.

    Args:
        memory: Address of the memory of the cycle.
        tolerance: Difference that does not count [rad].
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        before: Angles of the state before [rad], shape (n,).
        comparable: Whether there was a state not long before, and rates are measured.
        dt: Time since then [s].
    """
    row, zero = cycle_memory.WAYS, np.zeros_like(position)
    went, told = position - before, dt * velocity
    in_doubt = read_at(memory, row, position)  # 0 while nothing is apart
    if comparable and in_doubt[0] == 0.0 and every(np.abs(went - told) <= ALIKE * tolerance):
        return faults.NONE
    if not comparable or in_doubt[0] == 0.0:
        for k in range(1, cycle_memory.OF_WAYS):
            write_at(memory, row + k, zero)
    write_at(memory, row, zero + select(comparable, 1.0, 0.0))
    if not comparable:
        return faults.NONE
    jumped = np.abs(went) > JUMP * tolerance + (1.0 + LAG) * np.abs(told)
    left, most = WINDOW / (WINDOW + dt), SHARE * tolerance
    went, told = clip(went, -most, most), clip(told, -most, most)
    told = select(told - told == 0.0, told, went)  # what is not finite is another fault
    apart = left * (read_at(memory, row + 1, position) + went - told)
    by_position = left * (read_at(memory, row + 2, position) + np.abs(went))
    by_rate = left * (read_at(memory, row + 3, position) + np.abs(told))
    still = select(went == 0.0, read_at(memory, row + 4, position) + told, zero)
    unsaid = select(told == 0.0, read_at(memory, row + 5, position) + went, zero)
    write_at(memory, row + 1, apart)
    write_at(memory, row + 2, by_position)
    write_at(memory, row + 3, by_rate)
    write_at(memory, row + 4, still)
    write_at(memory, row + 5, unsaid)
    wrong = np.abs(apart) > tolerance + LAG * (by_position + by_rate)
    wrong = wrong | (np.abs(unsaid) > tolerance)
    fault = select(some(wrong), faults.VELOCITIES_WRONG, faults.NONE)
    fault = select(some(np.abs(still) > tolerance), faults.POSITIONS_FROZEN, fault)
    fault = select(some(jumped), faults.POSITION_JUMP, fault)
    if every(np.abs(apart) + np.abs(still) + np.abs(unsaid) <= ALIKE * tolerance):
        write_at(memory, row, zero)
    return fault
