"""A machine whose joints lie elsewhere than its file says; its loops are closed anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.mechanisms.closing import close
from parallel_robot_model.mechanisms.faults import FOUND
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.mechanisms.workspace import boxed

SHORTEST = 2.0**-6  # of the shift, that is closed at once


def shifted(mechanism: Mechanism, shift: Sequence[float]) -> Mechanism:
    """The machine with other origins of its joints.

    The actuated joints of home stay, the passive ones follow. Closures that are redundant in the
    file stay out of account.

    Args:
        mechanism: The machine.
        shift: By which each joint lies elsewhere, on the link before [m], 3 numbers a joint.

    Raises:
        RobotError: its loops do not close.
    """
    if not any(shift):
        return mechanism
    whole, home, done, step = np.reshape(shift, (-1, 3)), mechanism.home, 0.0, 1.0
    while done < 1.0:
        part = mechanism.origin + (done + step) * whole
        moved = mechanism._replace(origin=part, home=home)
        value, made = boxed(moved)
        if close(value, made, made.q.copy()) == FOUND:
            home, done = made.all.copy(), done + step
            continue
        step *= 0.5
        if step < SHORTEST:
            raise RobotError('shift: the loops of the machine cannot be closed near home')
    return moved._replace(home=home)
