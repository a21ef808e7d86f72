"""What the kernels take of a described machine: its arrays, and a memory of its own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed
from parallel_robot_model.mechanisms import closing
from parallel_robot_model.mechanisms.margins import margins
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.mechanisms.workspace import boxed, workspace

ROWS = 6  # vectors that are handed over between kernels


class Constants(NamedTuple):
    """A mechanism, and where its kernels write.

    Attributes:
        mechanism: The machine, a boxed Mechanism.
        workspace: Its posture, from which the next one is looked for, a boxed Workspace.
        judged: The same for postures that are only judged, which lie ahead of the others.
        rows: Vectors that are handed over, shape (ROWS, n).
        matrices: M and Q, shape (2, n, n).
        travel: Lower and upper ends of travel [rad or m], shape (2, n).
        home: Margins at home, see :func:`margins`, shape (2,).
    """

    mechanism: Any
    workspace: Any
    judged: Any
    rows: Array
    matrices: Array
    travel: Array
    home: Array


def constants(
    mechanism: Mechanism, lower: tuple[float, ...], upper: tuple[float, ...]
) -> Constants:
    """A machine at home, with a new memory."""
    n = len(mechanism.actuated)
    machine, made = boxed(mechanism)
    closing.close(machine, made, made.q.copy())
    return Constants(
        machine,
        made,
        Boxed(workspace(mechanism)),
        np.zeros((ROWS, n)),
        np.zeros((2, n, n)),
        np.array([lower, upper], np.float64),
        np.array(margins(machine, made), np.float64),
    )
