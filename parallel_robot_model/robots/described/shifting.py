"""A machine whose joints lie elsewhere than its file says; its loops are closed anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.mechanisms.closing import close
from parallel_robot_model.mechanisms.faults import FOUND
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.mechanisms.workspace import boxed


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
    moved = mechanism._replace(origin=mechanism.origin + np.reshape(shift, (-1, 3)))
    value, made = boxed(moved)
    if close(value, made, made.q.copy()) != FOUND:
        raise RobotError('shift: the loops of the machine cannot be closed near home')
    return moved._replace(home=made.all.copy())
