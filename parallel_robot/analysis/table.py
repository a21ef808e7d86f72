"""A bag as a table: one row for each state, units in the names of the columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis import metrics, recorded_motions
from parallel_robot.analysis.metrics import Poses
from parallel_robot.bags import command_states, recorded_robot
from parallel_robot.bags.history import History
from parallel_robot.bags.recording import Recording
from parallel_robot.bags.run_log import RunLog
from parallel_robot_control.coupling import synchronisation_error
from parallel_robot_model.common.errors import ParallelRobotError, WholeNeededError
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
    return _InParts().next(recording)


def parts(recordings: Iterator[Recording]) -> Iterator[Table]:
    """Tables of windows that follow each other; together they are that of the bag.

    Args:
        recordings: The windows, with the topics of NEEDED.

    Raises:
        WholeNeededError: they are several, and the plant of the bag has to move once more.
    """
    found = _InParts()
    for recording in recordings:
        again = recorded_motions.moves_again(recording.log.config, recording.history)
        if again and next(recordings, None) is not None:
            raise WholeNeededError('all of a bag is needed where its plant moves once more')
        yield found.next(recording)


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


class _InParts:
    """Makes the tables of the parts of a run, all with the columns of the first one."""

    def __init__(self) -> None:
        self._motions = recorded_motions.InParts()
        self._names: tuple[str, ...] = ()
        self._end = -np.inf  # s, of the states with a reference so far
        self._over = False  # the rest has no poses

    def next(self, recording: Recording) -> Table:
        """The table of the next part."""
        log, past, extra = recording
        poses, warnings = self._poses(log, past)
        sliding = np.full(log.position.shape, np.nan)
        if SLIDING_VARIABLE in extra:
            found = extra[SLIDING_VARIABLE]
            row = command_states.by_state(log.stamps, found.stamps)
            sliding[row >= 0] = found.numbers['position'][row[row >= 0]]
        made = columns(log, poses, sliding)
        self._names = self._names or tuple(made)
        nothing = np.full(len(log.time), np.nan)
        made = {name: made.get(name, nothing) for name in self._names}
        return Table(made, log.warnings + warnings)

    def _poses(self, log: RunLog, past: History) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
        """Columns of the pose, named after its coordinates, and what is wrong with them.

        Those of a robot that moves in a plane are of its platform and hold its error. They are
        true where the plant is known; what is seen stands beside them where it is something else.
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
        nothing = np.empty((0, len(names)))
        found = Poses(nothing, nothing, robot.module.PLANAR)
        warnings: tuple[str, ...] = ()
        seen = None
        alone = not log.referenced.any() and self._end == -np.inf
        if alone:  # the pose needs no reference, so one that is there stands in for it
            every = np.ones_like(log.referenced)
            log = log._replace(reference_position=log.position, referenced=every)
        if log.referenced.any() and not self._over:
            try:
                part = self._motions.of(log, past)
                found = part.poses._replace(actual=part.pose)
                if part.motions.true is not None and part.motions.seen is not None:
                    seen = part.poses
                warnings = (f'the pose of the robot is {part.cut}',) if part.cut else ()
                known = ('', recorded_motions.UNKNOWN)
                warnings += (part.remark,) if part.remark not in known else ()
                self._over = bool(part.cut)
            except ParallelRobotError as error:
                warnings, self._over = (self._without_pose(error),), True
            self._end = self._end if alone else log.time[log.referenced][-1]
        prefix = 'platform' if found.planar else 'pose'
        actual, reference = (
            _spread(pose, log.referenced) for pose in (found.actual, found.reference)
        )
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

    def _without_pose(self, error: ParallelRobotError) -> str:
        """Why there is no pose from here on."""
        if not self._names:
            return f'no pose of the robot: {error}'
        return f'the pose of the robot is evaluated up to t = {self._end:.3f} s: {error}'


def _spread(rows: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Rows at the first places that are wanted, NaN elsewhere, one for each of `where`."""
    whole = np.full((len(where), rows.shape[1]), np.nan)
    whole[np.flatnonzero(where)[: len(rows)]] = rows
    return whole
