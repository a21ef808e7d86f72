"""Measured poses in a CSV file."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot.bags.limits import SortedRows
from parallel_robot.studies.calibration.tracker import TURNS
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import NANOSECONDS, Array

TIME, STAMP = 't', 'stamp'
AT_ONCE = 1 << 16  # numbers that are kept at once
SHOWN = 200  # characters of a line that are shown
QUATERNION = ('qx', 'qy', 'qz', 'qw')
LENGTH = 0.01  # by which that of a quaternion may differ from 1
MISSING = ('', 'nan')  # what stands where a tracker saw nothing


class TrackerFile(NamedTuple):
    """Poses of a file.

    Attributes:
        time: When they were measured [s], since the start of the bag, shape (N,).
        columns: Numbers of the coordinates that it has, k of them.
        pose: The coordinates in the units of the robot, shape (N, k).
        unused: Names of other columns.
        missing: Number of lines without a pose.
        total: Number of the others.
    """

    time: Array
    columns: tuple[int, ...]
    pose: Array
    unused: tuple[str, ...]
    missing: int
    total: int


def read(
    path: Path,
    coordinates: Sequence[str],
    start: int,
    home: Rotation | None = None,
    most: int | None = None,
) -> TrackerFile:
    """Read a file with a header: ``t`` [s] or ``stamp`` [ns], and coordinates of the pose.

    Args:
        path: The file.
        coordinates: Names of the coordinates of the robot.
        start: Stamp of t = 0 [ns].
        home: Attitude from which its rotation vector counts, which the QUATERNION of the end
            effector may tell in its place; None: it has none.
        most: How many poses are wanted, evenly; None: all.

    Raises:
        InputError: it cannot be read, a line is wrong, or there is no room to keep the poses.
    """
    try:
        with path.open(encoding='utf-8-sig', newline='') as stream:
            lines = csv.reader(stream)
            header = [name.strip() for name in next(lines, [])]
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
                    _keep(kept, rows, len(columns))
                    rows = array('d')
            _keep(kept, rows, len(columns))
    except OSError as error:
        raise InputError(f'cannot read {path}: {error.strerror}') from None
    except UnicodeDecodeError:
        raise InputError(f'{path} is not text in UTF-8') from None
    except csv.Error as error:
        raise InputError(f'{path}: {error}') from None
    if not kept.count:
        raise InputError(f'{path} holds no pose')
    times, pose = kept.evenly(most)
    unused = tuple(name for name in header if name not in (time, *columns))
    if home and QUATERNION[0] in columns:
        at = columns.index(QUATERNION[0])
        turned = Rotation.from_quat(pose[:, at:]) * home.inv()
        pose = np.column_stack([pose[:, :at], turned.as_rotvec()])
        columns = [*columns[:at], *TURNS]
    found = tuple(coordinates.index(name) for name in columns)
    return TrackerFile(times, found, pose, unused, missing, kept.count)


def _keep(kept: SortedRows, rows: array[float], width: int) -> None:
    """Keep rows of a time and so many coordinates."""
    table = np.frombuffer(rows, np.float64).reshape(-1, 1 + width)
    kept.add(table[:, 0], table[:, 1:])


def _columns(
    path: Path, header: Sequence[str], coordinates: Sequence[str]
) -> tuple[str, list[str]]:
    """Name of the column of times, and those of the coordinates that are there.

    Raises:
        InputError: one of both is missing, or a name stands there twice.
    """
    times = [name for name in (TIME, STAMP) if name in header]
    known = [name for name in coordinates if name in header]
    if len(times) != 1 or not known or any(header.count(name) > 1 for name in [*times, *known]):
        shown = printable(', '.join(header), SHOWN)
        what = f'{TIME} [s] or {STAMP} [ns], then some of {", ".join(coordinates)}'
        raise InputError(f'{path}, line 1: the header must name {what}, not {shown!r}')
    return times[0], known


def _check_rotation(path: Path, columns: Sequence[str]) -> None:
    """Refuse a part of a quaternion, and a quaternion beside a rotation vector.

    Raises:
        InputError: there is one.
    """
    parts = [name for name in columns if name in QUATERNION]
    other = [name for name in columns if name in TURNS]
    if parts and (len(parts) < len(QUATERNION) or other):
        what = f'a rotation is all of {", ".join(QUATERNION)}, or some of {", ".join(TURNS)}'
        raise InputError(f'{path}, line 1: {what}, not {", ".join([*parts, *other])}')


def _check_length(where: str, columns: Sequence[str], cells: Sequence[float]) -> None:
    """Refuse a quaternion that is no rotation.

    Raises:
        InputError: its length is not 1.
    """
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
        what = f'{STAMP} {printable(text, SHOWN)!r} is not a whole number of nanoseconds'
        raise InputError(f'{where}: {what}') from None


def _number(where: str, text: str) -> float:
    """A finite number.

    Raises:
        InputError: it is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f'{where}: {printable(text, SHOWN)!r} is not a finite number')
    return value
