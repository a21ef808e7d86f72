"""A bag as a table: one row for each state, units in the names of the columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis import recorded_motions
from parallel_robot.analysis.metrics import Poses
from parallel_robot.bags.history import History
from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot.bags.run import matching, recorded_robot
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.errors import ParallelRobotError, WholeNeededError
from parallel_robot_model.messages.topics import SLIDING_VARIABLE, Topic
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.run_columns import Columns, JointColumns, of_joints, of_poses

NEEDED = (SLIDING_VARIABLE,)  # topics that are to be read beside the run


class Table(NamedTuple):
    """A bag as a table.

    Attributes:
        columns: Name to numbers, shape (N,).
        warnings: Defects of the bag and what cannot be computed, one line each.
    """

    columns: Columns
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


def sliding_variable(log: RunLog, extra: Mapping[Topic, Samples]) -> np.ndarray:
    """Sliding variable at each state in the unit of the law, NaN where it is not known.

    Args:
        log: The run.
        extra: What was read of the bag beside it, see :func:`recording.read`.

    Returns:
        Shape (N, n).
    """
    sliding = np.full(log.position.shape, np.nan)
    if SLIDING_VARIABLE in extra:
        found = extra[SLIDING_VARIABLE]
        row = matching.command_of_states(log.stamps, found.stamps)
        sliding[row >= 0] = found.numbers['position'][row[row >= 0]]
    return sliding


def columns(log: RunLog, sliding: np.ndarray) -> Columns:
    """Time and joints of a run as columns: name with unit to numbers, shape (N,).

    Args:
        log: The run.
        sliding: See :func:`sliding_variable`.
    """
    reference, rate, acceleration = (
        np.where(log.referenced[:, np.newaxis], each, np.nan)
        for each in (log.reference_position, log.reference_velocity, log.reference_acceleration)
    )
    effort = log.effort if log.has_efforts else np.full_like(log.effort, np.nan)
    found = JointColumns(
        log.position, log.velocity, effort, reference, rate, acceleration, log.answer, sliding
    )
    return of_joints(log.time, log.stamps, log.joints, found, log.units)


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
        made = columns(log, sliding_variable(log, extra)) | poses
        self._names = self._names or tuple(made)
        nothing = np.full(len(log.time), np.nan)
        made = {name: made.get(name, nothing) for name in self._names}
        return Table(made, log.warnings + warnings)

    def _poses(self, log: RunLog, past: History) -> tuple[Columns, tuple[str, ...]]:
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
        nothing = np.empty((0, len(coordinates)))
        found = Poses(nothing, nothing, robot.place, robot.joint_units, robot.turns)
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
        actual, reference = (
            _spread(pose, log.referenced) for pose in (found.actual, found.reference)
        )
        reference = np.full_like(reference, np.nan) if alone else reference
        shown = None if seen is None else _spread(seen.actual, log.referenced)
        return of_poses(coordinates, found.place, actual, reference, shown), warnings

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
