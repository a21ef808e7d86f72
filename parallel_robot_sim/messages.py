"""The state of the plant as messages; one row per state."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.messages import cdr, layouts
from parallel_robot_model.messages.layouts import passive_names
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
    effort: np.ndarray,
) -> np.ndarray:
    """Fill the layout of :func:`state_layout` with a run; passive joints have no effort.

    Args:
        layout: The layout.
        stamps: Of the states [ns], shape (N,).
        run: The run.
        effort: What its states tell of the efforts [N m], shape (N, n).
    """
    records = layout.records(run.steps, stamps)
    rows, n = slice(run.steps), run.position.shape[1]
    records['position'][:, :n] = run.position[rows]
    records['velocity'][:, :n] = run.velocity[rows]
    records['effort'][:, :n] = effort
    if records['position'].shape[1] > n:
        records['position'][:, n:] = run.passive_position[rows]
        records['velocity'][:, n:] = run.passive_velocity[rows]
    return records


class ReportedEffort:
    """Efforts in the rows of states that tell of an earlier time; zero before the first one."""

    def __init__(self, late: int) -> None:
        """Prepare; `late`: samples from the measurement of a state to its row."""
        self._late = late
        self._before: np.ndarray | None = None  # the last efforts

    def of(self, effort: np.ndarray) -> np.ndarray:
        """What the next states of a run tell.

        Args:
            effort: Torque applied during the step that ended at each sample [N m], shape (N, n).
        """
        before = effort[:0] if self._before is None else self._before
        known = np.vstack([before, effort])
        self._before = known[max(len(known) - self._late, 0) :]
        told = np.zeros_like(known)
        told[self._late :] = known[: max(len(known) - self._late, 0)]
        return told[len(before) :]
