"""The state of the plant as messages; one row per state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.messages import cdr, layouts
from parallel_robot_model.messages.joint_layouts import passive_names
from parallel_robot_sim.closed_loop import ClosedLoopRun


def state_layout(joints: tuple[str, ...], passive: int) -> cdr.Layout:
    """sensor_msgs/JointState: the actuated joints first, then some passive ones."""
    names = joints
    if passive:
        names += passive_names(joints[:passive])
    return layouts.joint_state(names)


def state_messages(
    layout: cdr.Layout,
    stamps: Any,
    run: ClosedLoopRun,
    late: int = 0,
    further: NDArray[np.int64] | int = 0,
) -> np.ndarray:
    """Fill the layout of :func:`state_layout` with a run; passive joints have no effort.

    Args:
        layout: The layout.
        stamps: Of the states [ns], shape (N,).
        run: The run.
        late: Samples from the measurement of a state to its row in the run.
        further: Samples by which it comes later still, shape (N,); negative if only its stamp is
            ahead.
    """
    records = layout.records(run.steps, stamps)
    rows, n = slice(run.steps), run.position.shape[1]
    records['position'][:, :n] = run.position[rows]
    records['velocity'][:, :n] = run.velocity[rows]
    records['effort'][:, :n] = reported_effort(run.effort[rows], late)[
        np.arange(run.steps) - np.maximum(further, 0)
    ]
    if records['position'].shape[1] > n:
        records['position'][:, n:] = run.passive_position[rows]
        records['velocity'][:, n:] = run.passive_velocity[rows]
    return records


def reported_effort(effort: np.ndarray, late: int) -> np.ndarray:
    """Efforts in the rows of states that tell of an earlier time; zero before the first one.

    Args:
        effort: Torque applied during the step that ended at each sample [N m], shape (N, n).
        late: Samples from the measurement of a state to its row.
    """
    told = np.zeros_like(effort)
    told[late:] = effort[: max(len(effort) - late, 0)]
    return told
