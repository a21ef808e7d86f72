"""The columns of a run as a table: one row for each state, units in the names of the columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_model.common.units import HINGES, Array, JointUnits
from parallel_robot_model.robots.contract import Coordinate, angles_between, rotation_components_of

Columns = dict[str, NDArray[Any]]


class JointColumns(NamedTuple):
    """What joints did, NaN where it is not known, each shape (N, n)."""

    position: Array  # [rad]
    velocity: Array  # [rad/s]
    effort: Array  # torque applied during the step that ended at the state [N m]
    reference_position: Array  # [rad]
    reference_velocity: Array  # [rad/s]
    reference_acceleration: Array  # [rad/s^2]
    command: Array  # torque that answered the state [N m]
    sliding_variable: Array  # in the unit of the law


def of_joints(
    time: Array,
    stamps: NDArray[np.int64],
    joints: Sequence[str],
    found: JointColumns,
    units: JointUnits = HINGES,
) -> Columns:
    """Time and joints as columns: name with unit to numbers, shape (N,).

    Args:
        time: Since the start [s], shape (N,).
        stamps: Stamps of the states [ns], shape (N,).
        joints: Names of the joints.
        found: What they did.
        units: Their units.
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
        f'{joint}_{units.one(k).key(quantity)}': numbers[:, k]
        for quantity, numbers in quantities.items()
        for k, joint in enumerate(joints)
    }


def of_poses(
    coordinates: Sequence[Coordinate],
    place: int,
    actual: Array,
    reference: Array,
    seen: Array | None = None,
) -> Columns:
    """Poses as columns, named after their coordinates.

    Those that begin with a place are of the platform, with its distance from the desired one, and
    in space with the angle by which it is turned from that.

    Args:
        coordinates: Names and units of the coordinates.
        place: Number of its coordinates that are the place of the end effector [m].
        actual: True poses where the plant is known, else those seen, shape (N, m).
        reference: Desired poses, shape (N, m).
        seen: Poses as sensors and nominal robot show them; None where `actual` are those.
    """
    prefix = 'platform' if place else 'pose'
    names = [f'{name}_{unit}' for name, unit in coordinates]
    columns = {f'{prefix}_{name}': actual[:, k] for k, name in enumerate(names)}
    columns |= {f'{prefix}_reference_{name}': reference[:, k] for k, name in enumerate(names)}
    if place:
        columns |= _errors('', actual, reference, place, coordinates)
    if seen is not None:
        columns |= {f'seen_{prefix}_{name}': seen[:, k] for k, name in enumerate(names)}
        if place:
            columns |= _errors('seen_', seen, reference, place, coordinates)
    return columns


def _errors(
    prefix: str, actual: Array, reference: Array, place: int, coordinates: Sequence[Coordinate]
) -> Columns:
    """Distance of two places [m], and angle between two poses in space [rad], shape (N,)."""
    distance = np.asarray(np.linalg.norm((actual - reference)[:, :place], axis=1))
    columns = {f'{prefix}platform_error_m': distance}
    if turns := rotation_components_of(coordinates):
        angle = angles_between(actual, reference, turns)
        columns[f'{prefix}platform_rotation_error_rad'] = angle
    return columns
