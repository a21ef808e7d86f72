"""The state of the plant as messages; one row a state."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_base import cdr


def state_layout(joints: tuple[str, ...], passive: bool) -> cdr.Layout:
    """sensor_msgs/JointState: the actuated joints first, then, if wanted, the passive ones."""
    names = joints
    if passive:
        names += tuple(f'{joint}_passive' for joint in joints)
    return cdr.joint_state(names)


def state_messages(
    layout: cdr.Layout,
    stamps: Any,
    theta: np.ndarray,
    theta_dot: np.ndarray,
    psi: np.ndarray,
    psi_dot: np.ndarray,
    effort: np.ndarray,
) -> np.ndarray:
    """Fill the layout of :func:`state_layout`; all shape (N, n); passive joints have no effort."""
    records = layout.records(len(theta), stamps)
    n = theta.shape[1]
    records['position'][:, :n] = theta
    records['velocity'][:, :n] = theta_dot
    records['effort'][:, :n] = effort
    if records['position'].shape[1] > n:
        records['position'][:, n:] = psi
        records['velocity'][:, n:] = psi_dot
    return records
