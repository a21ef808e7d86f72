"""Measured poses: from a file or a bag, and the states of a run near them."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot.bags import bag_reader
from parallel_robot.bags.bag_reader import Messages
from parallel_robot.bags.limits import SortedRows
from parallel_robot.bags.messages.message_arrays import FIRST
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.studies.calibration.pose_model import JointTrack, MeasuredPoses
from parallel_robot.studies.calibration.tracker import TURNS
from parallel_robot_model.common.errors import BagError, InputError, printable
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel

# Measured poses in a CSV file.

TIME, STAMP = 't', 'stamp'
AT_ONCE = 1 << 16  # numbers that are kept at once
SHOWN_OF_LINE = 200  # characters of a line that are shown
QUATERNION = ('qx', 'qy', 'qz', 'qw')
LENGTH = 0.01  # by which that of a quaternion may differ from 1
UNITS = {TIME: ('[s]',), STAMP: ('[ns]',)}  # that a header may tell; of coordinates m and rad
MISSING = ('', 'nan')  # what stands where a tracker saw nothing


def read_file(
    path: Path,
    coordinates: Sequence[str],
    start: int,
    home: Rotation | None = None,
    most: int | None = None,
) -> tuple[MeasuredPoses, int, list[str]]:
    """Read a file with a header: ``t`` [s] or ``stamp`` [ns], and coordinates of the pose.

    Args:
        path: The file.
        coordinates: Names of the coordinates of the robot.
        start: Stamp of t = 0 [ns].
        home: Attitude from which its rotation vector counts, which the QUATERNION of the end
            effector may tell in its place; None: it has none.
        most: How many poses are wanted, evenly; None: all.

    Returns:
        The poses, how many there are in the file, and what was not used, one line each.
    """
    try:
        with path.open(encoding='utf-8-sig', newline='') as stream:
            lines = csv.reader(stream)
            header = [_bare(name.strip()) for name in next(lines, [])]
            named = [*coordinates, *(QUATERNION if home else ())]
            time, columns = _columns(path, header, named)
            _check_rotation(path, columns)
            kept, rows, missing = SortedRows('the poses'), array('d'), 0
            for line in lines:
                if not ''.join(line).strip():
                    continue
                where = f'{path}, line {lines.line_num}'
                if len(line) != len(header):
                    raise InputError(f'{where} must hold {len(header)} values, not {len(line)}')
                cells = [line[header.index(name)].strip() for name in columns]
                if any(cell.lower() in MISSING for cell in cells):
                    missing += 1
                    continue
                rows.append(_time(where, time, line[header.index(time)].strip(), start))
                rows.extend(numbers := [_number(where, cell) for cell in cells])
                _check_length(where, columns, numbers)
                if len(rows) > AT_ONCE:
                    kept.add(*_table(rows, len(columns)))
                    rows = array('d')
            kept.add(*_table(rows, len(columns)))
    except OSError as error:
        raise InputError(f'cannot read {path}: {error.strerror}') from None
    except UnicodeDecodeError:
        raise InputError(f'{path} is not text in UTF-8') from None
    except csv.Error as error:
        raise InputError(f'{path}: {error}') from None
    if not kept.count:
        raise InputError(f'{path} holds no pose')
    times, pose = kept.evenly(most)
    unused = ', '.join(name for name in header if name not in (time, *columns))
    remarks = [f'{path}: not used: the columns {printable(unused, 80)}'] if unused else []
    if missing:
        remarks.append(f'{path}: not used: {missing} lines without a pose')
    if home and QUATERNION[0] in columns:
        at = columns.index(QUATERNION[0])
        turned = Rotation.from_quat(pose[:, at:]) * home.inv()
        pose = np.column_stack([pose[:, :at], turned.as_rotvec()])
        columns = [*columns[:at], *TURNS]
    found = tuple(coordinates.index(name) for name in columns)
    return MeasuredPoses(times, found, pose), kept.count, remarks


def _table(rows: array[float], width: int) -> tuple[Array, Array]:
    """Times, and as many coordinates of each."""
    table = np.frombuffer(rows, np.float64).reshape(-1, 1 + width)
    return table[:, 0], table[:, 1:]


def _bare(name: str) -> str:
    """A name without its unit, if that is the one in which it counts."""
    bare, _, unit = name.rpartition(' ')
    return bare if unit in UNITS.get(bare, ('[m]', '[rad]')) else name


def _columns(
    path: Path, header: Sequence[str], coordinates: Sequence[str]
) -> tuple[str, list[str]]:
    """Name of the column of times, and those of the coordinates that are there."""
    times = [name for name in (TIME, STAMP) if name in header]
    known = [name for name in coordinates if name in header]
    twice = any(header.count(name) > 1 for name in [*times, *known])
    parts = [name.partition(' [') for name in header]
    other = any(mark and name in (TIME, STAMP, *coordinates) for name, mark, _ in parts)
    if len(times) != 1 or not known or twice or other:
        shown = printable(', '.join(header), SHOWN_OF_LINE)
        what = f'{TIME} [s] or {STAMP} [ns], then some of {", ".join(coordinates)} in m and rad'
        raise InputError(f'{path}, line 1: the header must name {what}, not {shown!r}')
    return times[0], known


def _check_rotation(path: Path, columns: Sequence[str]) -> None:
    """Refuse a part of a quaternion, and one beside a rotation vector."""
    parts = [name for name in columns if name in QUATERNION]
    other = [name for name in columns if name in TURNS]
    if parts and (len(parts) < len(QUATERNION) or other):
        what = f'a rotation is all of {", ".join(QUATERNION)}, or some of {", ".join(TURNS)}'
        raise InputError(f'{path}, line 1: {what}, not {", ".join([*parts, *other])}')


def _check_length(where: str, columns: Sequence[str], cells: Sequence[float]) -> None:
    """Refuse a quaternion that is no rotation."""
    parts = [cell for name, cell in zip(columns, cells, strict=True) if name in QUATERNION]
    if parts and abs(math.hypot(*parts) - 1.0) > LENGTH:
        raise InputError(
            f'{where}: the quaternion must be of length 1, not {math.hypot(*parts):g}'
        )


def _time(where: str, column: str, text: str, start: int) -> float:
    """Time of a line since t = 0 [s]."""
    if column == TIME:
        return _number(where, text)
    try:
        return (int(text) - start) / NANOSECONDS
    except ValueError:
        what = f'{STAMP} {printable(text, SHOWN_OF_LINE)!r} is not a whole number of nanoseconds'
        raise InputError(f'{where}: {what}') from None


def _number(where: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f'{where}: {printable(text, SHOWN_OF_LINE)!r} is not a finite number')
    return value


# States of a run near the times at which poses were measured, from its windows.

KEPT = 1_000_000  # states that are kept; of a run with more, those near the poses


def margin(duration: float, states: int, poses: int) -> float:
    """How far from a pose states are kept [s], so that of all poses there are at most KEPT.

    `duration` is the length of the run [s], `states` about how many it has.
    """
    if states <= KEPT or not poses:
        return np.inf
    return 0.5 * KEPT / poses * duration / states


class NearStates:
    """Collects states near some times, with the poses that the nominal robot has there."""

    def __init__(
        self, robot: RobotModel, guess: Array, zero: Array, time: Array, margin: float
    ) -> None:
        """Begin without states.

        Args:
            robot: The nominal robot.
            guess: Pose near its first one, shape (m,).
            zero: Zero angles that are known [rad], shape (n,).
            time: Increasing times of the poses [s], shape (N,).
            margin: How far from them states are kept [s].
        """
        self._robot, self._guess, self._zero = robot, guess, zero
        self._time, self._margin = time, margin
        self._count, self._newest = 0, FIRST
        self._parts: list[tuple[Array, Array, Array]] = []
        # first: time of the first state [s]; NaN before it came; last: that of the last one
        self.first = self.last = np.nan
        # time between the states before and after each pose [s]; NaN where there are
        # none, shape (N,)
        self.around = np.full(len(time), np.nan)
        self.period = 0.0  # time between two states [s]; 0 where there are no two

    def add(self, log: RunLog) -> None:
        """Take the next window."""
        newest = np.maximum.accumulate(np.append(self._newest, log.stamps))
        newer = log.stamps > newest[:-1]  # each stamp once
        self._newest = int(newest[-1])
        time, position = log.time[newer], log.position[newer]
        if not len(time):
            return
        pose = poses_of(self._robot, position - self._zero, self._guess, first=self._count)
        self._guess, self._count = pose[-1], self._count + len(time)
        begins = np.isnan(self.first)
        states = time if begins else np.append(self.last, time)
        steps = np.diff(states)
        if len(steps):
            self.period = self.period or float(np.median(steps))
            after = np.searchsorted(states, self._time)
            inside = (after > 0) & (after < len(states))
            inside |= begins & (self._time == states[0])
            self.around[inside] = steps[np.maximum(after[inside], 1) - 1]
        self.first, self.last = (time[0] if begins else self.first), time[-1]
        low = np.searchsorted(self._time, time - self._margin, side='left')
        high = np.searchsorted(self._time, time + self._margin, side='right')
        near = high > low
        self._parts.append((time[near], position[near], pose[near]))

    def track(self) -> tuple[JointTrack, Array]:
        """The states that were kept, and the nominal poses there, shape (M, m)."""
        time, position, pose = (np.concatenate(each) for each in zip(*self._parts, strict=True))
        return JointTrack(time, position), pose


# Poses that something else than the suite measured, as a tracker or a camera, in a bag.

TEXTS = {  # type to the number of its texts before the pose
    'geometry_msgs/msg/PoseStamped': 1,
    'geometry_msgs/msg/PoseWithCovarianceStamped': 1,
    'geometry_msgs/msg/TransformStamped': 2,
}
OURS = (topics.POSE.name, topics.POSE_REFERENCE.name)  # computed, not measured
FARTHEST = 1e6  # m, of a pose
HEAD = 4  # bytes of the encapsulation
FEW = 5  # topics that a message names
SHOWN_OF_TEXT = 60  # characters of a name


class StampedPoses(NamedTuple):
    """Poses in space."""

    stamps: np.ndarray  # of their headers [ns], shape (N,)
    place: Array  # x, y, z [m], shape (N, 3)
    turned: Array  # quaternions x, y, z, w of any length but zero, shape (N, 4)
    missing: int  # number of messages whose numbers are none, as where a tracker saw nothing
    total: int  # number of the others

    @property
    def phi(self) -> Array:
        """Angles about z [rad], shape (N,)."""
        x, y, z, w = self.turned.T
        return np.asarray(np.arctan2(2.0 * (w * z + x * y), w**2 + x**2 - y**2 - z**2))


def read_topic(bag: Path, name: str | None = None, most: int | None = None) -> StampedPoses:
    """Read measured poses in the order of their stamps.

    Args:
        bag: Directory of the bag, or its MCAP file.
        name: Name of their topic; None: the only one that there is.
        most: How many poses are wanted, evenly; None: all.
    """
    found = bag_reader.read(bag, (), lambda *_: None)  # the names of topics alone
    there = {
        topic: kind
        for topic, kind in found.channels.items()
        if kind in TEXTS and topic.rpartition('/')[2] not in OURS
    }
    listed = ', '.join(
        f'{printable(topic, SHOWN_OF_TEXT)} ({there[topic]})' for topic in [*there][:FEW]
    )
    if name is None and len(there) != 1:
        if there:
            raise BagError(
                f'{bag} has several topics of poses, {listed}: --pose-topic chooses one'
            )
        kinds = ', '.join(TEXTS)
        raise BagError(
            f'{bag} has no topic of measured poses ({kinds}): --poses FILE.csv has them'
        )
    wanted = f'/{name.lstrip("/")}' if name else next(iter(there))
    if wanted not in there:
        kind, has = found.channels.get(wanted), f'; it has {listed}' if there else ''
        why = 'is not there'
        if wanted.rpartition('/')[2] in OURS:
            why = 'is computed from the joints, not measured'
        elif kind is not None:
            why = f'is of {printable(kind, SHOWN_OF_TEXT)}, not of poses'
        raise BagError(f'{bag}: --pose-topic {printable(wanted, SHOWN_OF_TEXT)} {why}{has}')
    topic = Topic(wanted.lstrip('/'), there[wanted])
    kept, missing = SortedRows('the poses'), 0

    def keep(_: Topic, messages: Messages) -> None:
        nonlocal missing
        stamps, pose = _decoded(bag, topic, messages)
        seen = (np.abs(pose) <= FARTHEST).all(axis=1) & (pose[:, 3:] != 0.0).any(axis=1)  # nor NaN
        missing += int((~seen).sum())
        kept.add(stamps[seen], pose[seen])

    bag_reader.read(bag, [topic], keep, held=False)
    if not kept.count and not missing:
        raise BagError(f'{bag} has no messages on {printable(wanted, SHOWN_OF_TEXT)}')
    if not kept.count:
        raise BagError(f'{bag}: no message on {printable(wanted, SHOWN_OF_TEXT)} holds a pose')
    stamps, pose = kept.evenly(most)
    return StampedPoses(stamps, pose[:, :3], pose[:, 3:], missing, kept.count)


def _decoded(bag: Path, topic: Topic, messages: Messages) -> tuple[np.ndarray, Array]:
    """Stamps and poses of messages of one length; the texts in them may differ."""
    raw, count = messages.payloads, len(messages.payloads)
    stamps, poses = np.empty(count, np.int64), np.empty((count, 7))
    try:
        little = raw[:, 1] & 1 == 1
        for order, rows in (('<', np.flatnonzero(little)), ('>', np.flatnonzero(~little))):
            body, place = raw[rows, HEAD:], np.full(len(rows), 8)
            for _ in range(TEXTS[topic.type]):
                place += -place % 4
                place += 4 + _numbers(body, place, 1, f'{order}u4')[:, 0].astype(np.int64)
            place += -place % 8
            poses[rows] = _numbers(body, place, 7, f'{order}f8')
            seconds, rest = _numbers(body, np.zeros_like(place), 2, f'{order}u4').T
            stamps[rows] = seconds.astype(np.int64) * NANOSECONDS + rest
    except IndexError:
        raise BagError(f'{bag}: {topic.name} is not understood: a message is broken') from None
    return stamps, poses


def _numbers(raw: np.ndarray, place: np.ndarray, count: int, kind: str) -> np.ndarray:
    """Numbers that stand in each row from a place on, shape (N, count)."""
    columns = place[:, np.newaxis] + np.arange(count * np.dtype(kind).itemsize)
    return raw[np.arange(len(raw))[:, np.newaxis], columns].view(kind)
