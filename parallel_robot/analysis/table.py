"""A bag as a table: one row for each state, units in the names of the columns."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from parallel_robot.analysis import recorded_motions
from parallel_robot.analysis.metrics import Poses
from parallel_robot.analysis.monitor import MonitorParameters
from parallel_robot.bags import output
from parallel_robot.bags.history import History
from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot.bags.output import tracked
from parallel_robot.bags.run import matching, recorded_robot
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_control.configuration import available
from parallel_robot_model.common.errors import (
    ParallelRobotError,
    UnknownNameError,
    WholeNeededError,
    optional,
)
from parallel_robot_model.configuration.fields import Field, joint_field, parameters
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.messages.topics import SLIDING_VARIABLE, Topic
from parallel_robot_model.robots.registry import module_of, robot_of, units_of
from parallel_robot_sim.configuration import members
from parallel_robot_sim.run_columns import Columns, JointColumns, of_joints, of_poses
from trajectory_gen.shapes import shapes

NEEDED = (SLIDING_VARIABLE,)  # topics that are to be read beside the run


class Table(NamedTuple):
    """A bag as a table."""

    columns: Columns  # name to numbers, shape (N,)
    warnings: tuple[str, ...]  # defects of the bag and what cannot be computed, one line each


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
        found = Poses(nothing, nothing, robot.place, robot.joint_units, robot.rotation_components)
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


# A table as a file: comma-separated values, or Apache Parquet.

FORMULA = ('=', '+', '-', '@', '\t', '\r')
TableColumns = Mapping[str, np.ndarray]


def check_table_file(path: Path) -> None:
    """Refuse a file of a table that exists, or whose suffix is of no format.

    Raises:
        InputError: with the reason.
    """
    if path.suffix not in FORMATS:
        raise UnknownNameError('table format', path.suffix, FORMATS)
    output.check_new(path, '--out')


def write_table(path: Path, parts: Iterable[TableColumns]) -> None:
    """Write a table into a file, which must not exist.

    Args:
        path: The file; it is there when all of the table is.
        parts: Tables whose rows follow each other, at least one, all with the same columns.

    Raises:
        InputError: it cannot be written there, or pyarrow is needed and not installed.
        RunError: the disk is full.
    """
    with output.growing(path) as stream:
        FORMATS[path.suffix](parts, stream)


def write_csv(parts: Iterable[TableColumns], stream: IO[bytes]) -> None:
    """Write comma-separated values; numbers in their shortest form that reads back the same."""
    text = io.TextIOWrapper(stream, newline='', write_through=True)
    writer = csv.writer(text, lineterminator='\n')
    first = next(parts := iter(parts))
    writer.writerow(map(harmless, first))
    rows = (
        row
        for part in itertools.chain([first], parts)
        for row in zip(*(each.tolist() for each in part.values()), strict=True)
    )
    writer.writerows(tracked(rows, None, 'rows'))
    text.detach()


def harmless(text: str) -> str:
    """Text for a cell, quoted if a spreadsheet would take it for a formula."""
    return f"'{text}" if text.startswith(FORMULA) else text


def _write_parquet(parts: Iterable[TableColumns], stream: IO[bytes]) -> None:
    """Write Apache Parquet, each part as a group of rows."""
    lacking = 'pyarrow is not installed; pip install pyarrow, or export to .csv'
    pyarrow, parquet = (optional(name, lacking) for name in ('pyarrow', 'pyarrow.parquet'))
    tables = (
        pyarrow.table({name: np.ascontiguousarray(column) for name, column in part.items()})
        for part in tracked(parts, None, 'parts')
    )
    first = next(tables)
    with parquet.ParquetWriter(stream, first.schema) as writer:
        for table in itertools.chain([first], tables):
            writer.write_table(table)


FORMATS: dict[str, Callable[[Iterable[TableColumns], IO[bytes]], None]] = {
    '.csv': write_csv,
    '.parquet': _write_parquet,
}


# Units and meanings of the keys of a configuration.


def fields_of(values: Mapping[str, Any]) -> dict[str, Field]:
    """Unit and meaning of the keys of a resolved configuration; those of the recorder need ROS."""
    loop = loop_of(values)
    motions = shapes(loop.custom_trajectories)
    known = members(module_of(loop), available(loop.custom_laws), motions)
    known += [(f'monitor.{each.key}', each) for each in parameters(MonitorParameters)]
    units = units_of(values)
    return {key: joint_field(key, parameter, units, motions) for key, parameter in known}
