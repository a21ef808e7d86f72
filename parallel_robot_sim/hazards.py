"""What hazards make of states, commands and motors, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.safety.limiting import safe_torque
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import internal, kernel, read_row, select, vector, write_row
from parallel_robot_model.configuration.hazards import KINDS, Hazard

# What the motors do while no command comes: hold the last one, then take their safe action.


class CommandState(NamedTuple):
    """What the motors know of the commands."""

    missed: int  # samples since the last command
    held: Array  # joint angles when the safe action began [rad], shape (n,)
    command: Array  # the last command [N m], shape (n,)


def no_command_yet(joints: int) -> CommandState:
    """Before the first command; `joints` is n."""
    zero = vector(np.zeros(joints))
    return CommandState(0, zero, zero)


@internal
def hold_or_time_out(
    setup: Any,
    before: CommandState,
    arrived: bool,
    command: Array,
    position: Array,
    velocity: Array,
) -> tuple[Array, CommandState]:
    """What the motors are asked for over one period [N m], shape (n,).

    Args:
        setup: The PlantSetup.
        before: What the motors knew before the period.
        arrived: Whether a command has come for it.
        command: The newest one [N m], shape (n,).
        position: Joint angles [rad], shape (n,).
        velocity: Their rates [rad/s], shape (n,).
    """
    if arrived:
        return command, CommandState(0, before.held, command)
    missed = before.missed + 1
    held = select(missed == setup.timeout_samples, position, before.held)
    safe = safe_torque(setup.safety, held, position, velocity)
    asked = select(missed >= setup.timeout_samples, safe, command)
    return asked, CommandState(missed, held, command)


(
    COMMANDS_LOST, MOTORS_OFF, MOTOR_DEAD, MOTORS_CLIPPED, BRAKES, STRANGER, STATES_LOST,
    STATES_FROZEN, ENCODER_FROZEN, ENCODER_JUMP, VELOCITY_ZERO, VELOCITY_NAN, STATES_LATE,
    STATES_AHEAD, REFERENCES_LOST, CONTROLLER_PAUSED, CONTROLLER_RESTARTED, PLANT_PAUSED,
    STATES_DROPPED, CLEAR_FAULT,
) = range(len(KINDS))  # fmt: skip
KIND, BEGIN, END, SIZE, PLACE, COLUMNS = range(6)  # of the table
KEPT = 3  # vectors of a sample that are kept: position, velocity, effort


class Hazards(NamedTuple):
    """Hazards as the kernels take them; of several at a time, the later ones act on top."""

    on: bool  # whether there are any; if not, none of the rest is looked at
    table: Array = np.zeros((0, COLUMNS))  # a row for each
    # rows of shape (n,): for each at its PLACE first a mask, 1 for the joints that it is about,
    # then what it keeps of the states
    memory: Array = np.zeros((0, 0))


def table_of(hazards: Sequence[Hazard], joints: Sequence[str], period: float) -> Hazards:
    """Make the table; `joints` are the names of all, `period` of the samples in s."""
    if not hazards:
        return Hazards(False)
    numbers, rows, masks, place = [*KINDS], [], {}, 0
    for hazard in hazards:
        begin, end = hazard.samples(period)
        rows.append([numbers.index(hazard.what), begin, end, hazard.size, place])
        masks[place] = [float(hazard.joint in ('', joint)) for joint in joints]
        late = hazard.what == 'states_late'
        if late:
            rows[-1][SIZE] = round(hazard.size / period)
        place += 1 + KEPT * (int(rows[-1][SIZE]) + 1 if late else 1)
    memory = np.zeros((place, len(joints)))
    for place, mask in masks.items():
        memory[place] = mask
    return Hazards(True, np.array(rows, np.float64), memory)


@internal
def _kind(hazards: Any, k: int, sample: int) -> int:
    """Kind of a hazard if it acts at a sample, else -1."""
    table = hazards.table
    return select(table[k, BEGIN] <= sample < table[k, END], int(table[k, KIND]), -1)


@internal
def _mask(hazards: Any, k: int, like: Array) -> Array:
    """1 for the joints that a hazard is about, else 0, of the type of `like`."""
    return read_row(hazards.memory, int(hazards.table[k, PLACE]), like)


@kernel
def told(
    hazards: Any, sample: int, position: Array, velocity: Array, effort: Array
) -> tuple[Array, Array, Array]:
    """What the state of a sample says, if there is one.

    Asked again, it is the same.

    Args:
        hazards: See Hazards.
        sample: Index of the sample.
        position: Angles that it would say without them [rad], shape (n,).
        velocity: Rates [rad/s], shape (n,).
        effort: Torques [N m], shape (n,).

    Returns:
        Angles, rates and torques.
    """
    for k in range(len(hazards.table)):
        kind, size = _kind(hazards, k, sample), hazards.table[k, SIZE]
        here, kept = _mask(hazards, k, position) > 0.0, int(hazards.table[k, PLACE]) + 1
        if kind == STATES_LATE:
            depth = int(size) + 1
            _keep(hazards, kept + KEPT * (sample % depth), position, velocity, effort)
            oldest = kept + KEPT * ((sample + 1) % depth)
            position = read_row(hazards.memory, oldest, position)
            velocity = read_row(hazards.memory, oldest + 1, velocity)
            effort = read_row(hazards.memory, oldest + 2, effort)
        elif kind in (STATES_FROZEN, ENCODER_FROZEN):
            if sample == hazards.table[k, BEGIN]:
                _keep(hazards, kept, position, velocity, effort)
            position = select(here, read_row(hazards.memory, kept, position), position)
            still = read_row(hazards.memory, kept + 1, velocity)
            still = select(kind == ENCODER_FROZEN, np.zeros_like(still), still)
            velocity = select(here, still, velocity)
        elif kind == ENCODER_JUMP:
            position = select(here, position + size, position)
        elif kind == VELOCITY_ZERO:
            velocity = select(here, 0.0, velocity)
        elif kind == VELOCITY_NAN:
            velocity = select(here, np.nan, velocity)
    return position, velocity, effort


@internal
def _keep(hazards: Any, place: int, position: Array, velocity: Array, effort: Array) -> None:
    write_row(hazards.memory, place, position)
    write_row(hazards.memory, place + 1, velocity)
    write_row(hazards.memory, place + 2, effort)


@internal
def commanded(
    hazards: Any, sample: int, arrived: bool, command: Array, before: CommandState
) -> tuple[bool, Array]:
    """Whether a command comes to the motors for a period, and which is the newest [N m].

    Args:
        hazards: See Hazards.
        sample: Index of the sample at which the period begins.
        arrived: Whether a command was sent for it.
        command: The newest one that was sent [N m], shape (n,).
        before: What the motors knew before.
    """
    for k in range(len(hazards.table)):
        kind = _kind(hazards, k, sample)
        mask = _mask(hazards, k, command)
        if kind in (COMMANDS_LOST, PLANT_PAUSED, CONTROLLER_PAUSED, CONTROLLER_RESTARTED):
            arrived, command = False, before.command
        elif kind == STRANGER:
            arrived, command = True, hazards.table[k, SIZE] * mask
    return arrived, command


@internal
def limited(hazards: Any, sample: int, limit: Array) -> Array:
    """Largest torque of the motors over a period [N m], shape (n,).

    Args:
        hazards: See Hazards.
        sample: Index of the sample at which the period begins.
        limit: The same without hazards [N m], shape (n,).
    """
    for k in range(len(hazards.table)):
        kind, size = _kind(hazards, k, sample), hazards.table[k, SIZE]
        mask = _mask(hazards, k, limit)
        if kind == MOTORS_CLIPPED:
            limit = select(limit < size, limit, size)
        elif kind in (MOTORS_OFF, MOTOR_DEAD, BRAKES):
            limit = select(mask > 0.0, 0.0, limit)
    return limit


@internal
def braked(hazards: Any, sample: int) -> bool:
    """Whether brakes hold the robot over the period after a sample."""
    braked = False
    for k in range(len(hazards.table)):
        braked = braked or _kind(hazards, k, sample) == BRAKES
    return braked
