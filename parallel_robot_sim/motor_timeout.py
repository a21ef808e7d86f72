"""What the motors do while no command comes: hold the last one, then take their safe action."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.safety.limiting import SafeAction, safe_torque
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, select, vector


class Patience(NamedTuple):
    """Samples without a command from which on the motors take their safe action, and that."""

    samples: int
    safe: SafeAction


class Waiting(NamedTuple):
    """What the motors know of the commands.

    Attributes:
        silent: Samples since the last command.
        held: Joint angles when the safe action began [rad], shape (n,).
        command: The last command [N m], shape (n,).
    """

    silent: int
    held: Array
    command: Array


def not_waiting(joints: int) -> Waiting:
    """Before the first command; `joints` is n."""
    zero = vector(np.zeros(joints))
    return Waiting(0, zero, zero)


@inner
def waited(
    patience: Any,
    before: Waiting,
    arrived: bool,
    command: Array,
    position: Array,
    velocity: Array,
) -> tuple[Array, Waiting]:
    """What the motors are asked for over one period [N m], shape (n,).

    Args:
        patience: See Patience.
        before: What the motors knew before the period.
        arrived: Whether a command has come for it.
        command: The newest one [N m], shape (n,).
        position: Joint angles [rad], shape (n,).
        velocity: Their rates [rad/s], shape (n,).
    """
    if arrived:
        return command, Waiting(0, before.held, command)
    silent = before.silent + 1
    held = select(silent == patience.samples, position, before.held)
    safe = safe_torque(patience.safe, held, position, velocity)
    asked = select(silent >= patience.samples, safe, command)
    return asked, Waiting(silent, held, command)
