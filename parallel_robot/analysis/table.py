"""A bag as a table: one row for each state, units in the names of the columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis import metrics, recorded_motions
from parallel_robot.analysis.metrics import Poses
from parallel_robot.bags import command_states, recorded_robot
from parallel_robot.bags.history import History
from parallel_robot.bags.recording import Recording
from parallel_robot.bags.run_log import RunLog
from parallel_robot_control.coupling import synchronisation_error
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.messages.topics import SLIDING_VARIABLE
from parallel_robot_model.robots.configuration import robot_of

NEEDED = (SLIDING_VARIABLE,)  # topics that are to be read beside the run


class Table(NamedTuple):
    """A bag as a table.

    Attributes:
        columns: Name to numbers, shape (N,).
        warnings: Defects of the bag and what cannot be computed, one line each.
    """

    columns: dict[str, np.ndarray]
    warnings: tuple[str, ...]


def of(recording: Recording) -> Table:
    """The table of a bag that was read with the topics of NEEDED."""
    log, past, extra = recording
    poses, warnings = _poses(log, past)
    sliding = np.full(log.position.shape, np.nan)
    if SLIDING_VARIABLE in extra:
        found = extra[SLIDING_VARIABLE]
        row = command_states.by_state(log.stamps, found.stamps)
        sliding[row >= 0] = found.numbers['position'][row[row >= 0]]
    return Table(columns(log, poses, sliding), log.warnings + warnings)


def columns(
    log: RunLog, poses: Mapping[str, np.ndarray], sliding_variable: np.ndarray
) -> dict[str, np.ndarray]:
    """A run as columns: name with unit to numbers, shape (N,).

    Args:
        log: The run.
        poses: Columns of the pose.
        sliding_variable: Sliding variable in the unit of the law, NaN where it is not known,
            shape (N, n).
    """
    reference, rate, acceleration = (
        np.where(log.referenced[:, np.newaxis], each, np.nan)
        for each in (log.reference_position, log.reference_velocity, log.reference_acceleration)
    )
    quantities = {
        'position_rad': log.position,
        'velocity_rad_per_s': log.velocity,
        'effort_nm': log.effort if log.has_efforts else np.full_like(log.effort, np.nan),
        'reference_position_rad': reference,
        'reference_velocity_rad_per_s': rate,
        'reference_acceleration_rad_per_s2': acceleration,
        'command_nm': log.answer,
        'synchronisation_error_rad': synchronisation_error(reference - log.position),
        'sliding_variable': sliding_variable,
    }
    return (
        {'time_s': log.time, 'stamp_ns': log.stamps}
        | {
            f'{joint}_{quantity}': numbers[:, k]
            for quantity, numbers in quantities.items()
            for k, joint in enumerate(log.joints)
        }
        | dict(poses)
    )


def _poses(log: RunLog, past: History) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Columns of the pose, named after its coordinates, and what is wrong with them.

    Those of a robot that moves in a plane are of its platform and hold its error. They are true
    where the plant is known; what is seen stands beside them where it is something else.
    """
    unknown = recorded_robot.unknown(log.config)
    if unknown:
        return {}, (unknown,)
    try:
        robot = robot_of(log.config)
    except ParallelRobotError as error:
        return {}, (f'no pose of the robot: {error}',)
    coordinates = robot.module.coordinates(robot.parameters)
    names = [f'{name}_{unit}' for name, unit in coordinates]
    warnings: tuple[str, ...] = ()
    seen = None
    alone = not log.referenced.any()
    if alone:  # the pose needs no reference, so one that is there stands in for it
        every = np.ones_like(log.referenced)
        log = log._replace(reference_position=log.position, referenced=every)
    try:
        part = recorded_motions.of_bag(log, past)
        found = part.poses._replace(actual=part.pose)
        if part.motions.true is not None and part.motions.seen is not None:
            seen = part.poses
        warnings = (f'the pose of the robot is {part.cut}',) if part.cut else ()
        warnings += (part.remark,) if part.remark not in ('', recorded_motions.UNKNOWN) else ()
    except ParallelRobotError as error:
        nothing = np.empty((0, len(names)))
        found = Poses(nothing, nothing, robot.module.PLANAR)
        warnings = (f'no pose of the robot: {error}',)
    prefix = 'platform' if found.planar else 'pose'
    actual, reference = (_spread(pose, log.referenced) for pose in (found.actual, found.reference))
    reference = np.full_like(reference, np.nan) if alone else reference
    columns = {f'{prefix}_{name}': actual[:, k] for k, name in enumerate(names)}
    columns |= {f'{prefix}_reference_{name}': reference[:, k] for k, name in enumerate(names)}
    if found.planar:
        columns['platform_error_m'] = metrics.distances(Poses(actual, reference))
    if seen is not None:
        actual = _spread(seen.actual, log.referenced)
        columns |= {f'seen_{prefix}_{name}': actual[:, k] for k, name in enumerate(names)}
        if seen.planar:
            columns['seen_platform_error_m'] = metrics.distances(Poses(actual, reference))
    return columns, warnings


def _spread(rows: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Rows at the first places that are wanted, NaN elsewhere, one for each of `where`."""
    whole = np.full((len(where), rows.shape[1]), np.nan)
    whole[np.flatnonzero(where)[: len(rows)]] = rows
    return whole
