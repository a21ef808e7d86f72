"""The columns of a run as a table: one row for each state, units in the names of the columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.coupling import synchronisation_error
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.robots.contract import Coordinate

Columns = dict[str, NDArray[Any]]


class JointColumns(NamedTuple):
    """What joints did, NaN where it is not known, each shape (N, n).

    Attributes:
        position: [rad].
        velocity: [rad/s].
        effort: Torque applied during the step that ended at the state [N m].
        reference_position: [rad].
        reference_velocity: [rad/s].
        reference_acceleration: [rad/s^2].
        command: Torque that answered the state [N m].
        sliding_variable: In the unit of the law.
    """

    position: Array
    velocity: Array
    effort: Array
    reference_position: Array
    reference_velocity: Array
    reference_acceleration: Array
    command: Array
    sliding_variable: Array


def of_joints(
    time: Array, stamps: NDArray[np.int64], joints: Sequence[str], found: JointColumns
) -> Columns:
    """Time and joints as columns: name with unit to numbers, shape (N,).

    Args:
        time: Since the start [s], shape (N,).
        stamps: Stamps of the states [ns], shape (N,).
        joints: Names of the joints.
        found: What they did.
    """
    quantities = {
        'position_rad': found.position,
        'velocity_rad_per_s': found.velocity,
        'effort_nm': found.effort,
        'reference_position_rad': found.reference_position,
        'reference_velocity_rad_per_s': found.reference_velocity,
        'reference_acceleration_rad_per_s2': found.reference_acceleration,
        'command_nm': found.command,
        'synchronisation_error_rad': synchronisation_error(
            found.reference_position - found.position
        ),
        'sliding_variable': found.sliding_variable,
    }
    return {'time_s': time, 'stamp_ns': stamps} | {
        f'{joint}_{quantity}': numbers[:, k]
        for quantity, numbers in quantities.items()
        for k, joint in enumerate(joints)
    }


def of_poses(
    coordinates: Sequence[Coordinate],
    planar: bool,
    actual: Array,
    reference: Array,
    seen: Array | None = None,
) -> Columns:
    """Poses as columns, named after their coordinates.

    Those of a robot that moves in a plane are of its platform, with its distance from the desired
    one.

    Args:
        coordinates: Names and units of the coordinates.
        planar: Whether a pose begins with x and y [m] in a plane.
        actual: True poses where the plant is known, else those seen, shape (N, m).
        reference: Desired poses, shape (N, m).
        seen: Poses as sensors and nominal robot show them; None where `actual` are those.
    """
    prefix = 'platform' if planar else 'pose'
    names = [f'{name}_{unit}' for name, unit in coordinates]
    columns = {f'{prefix}_{name}': actual[:, k] for k, name in enumerate(names)}
    columns |= {f'{prefix}_reference_{name}': reference[:, k] for k, name in enumerate(names)}
    if planar:
        columns['platform_error_m'] = _distance(actual, reference)
    if seen is not None:
        columns |= {f'seen_{prefix}_{name}': seen[:, k] for k, name in enumerate(names)}
        if planar:
            columns['seen_platform_error_m'] = _distance(seen, reference)
    return columns


def _distance(actual: Array, reference: Array) -> Array:
    """Distance in the plane [m], shape (N,)."""
    return np.asarray(np.linalg.norm((actual - reference)[:, :2], axis=1))
