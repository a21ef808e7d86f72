"""Points of a motion from a table in a file."""

from __future__ import annotations

import csv
import itertools
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.configuration.plain_data import (
    LocatedDict,
    SourceLocation,
    with_location,
)

# Tables of points: a CSV of times and coordinates, in anybody's columns and units.

MAX_BYTES = 1 << 28  # bytes of a table
HEADER = 't, x, y, phi; t, x, y; t, x, y, z, rx, ry, rz; or t, q1, q2 and so on'
PLANE = ('x', 'y', 'phi')
PLACE, ROTATION_VECTOR = ('x', 'y', 'z'), ('rx', 'ry', 'rz')  # in space, and its rotation vector
QUATERNION = ('qx', 'qy', 'qz', 'qw')  # in place of that
ORDER = ('t', *PLACE, 'phi', *ROTATION_VECTOR, *QUATERNION)
ROUNDED = 1e-2  # by which the length of a quaternion may differ from 1
COLUMNS = 'waypoints.columns'
UNITS = 'waypoints.units'
SEPARATORS = ',;\t'
SHOWN = 200  # characters of a header
TIME = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9, 'min': 60.0}
LENGTH = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6, 'in': 0.0254}
ANGLE = {'rad': 1.0, 'mrad': 1e-3, 'deg': math.pi / 180.0, 'turn': 2.0 * math.pi}
KINDS: dict[str, dict[str, float]] = {'time': TIME, 'length': LENGTH, 'angle': ANGLE}


class Table(NamedTuple):
    """Times and points."""

    times: Array  # times [s], increasing, shape (N,)
    points: Array  # coordinates in m and rad, shape (N, m)
    # names of the coordinates: x, y, phi; some of x, y, z, rx, ry, rz; x, y, z and the
    # quaternion qx, qy, qz, qw; or q1, q2 and so on
    names: tuple[str, ...]


class Lines(NamedTuple):
    """Lines of a table."""

    number: int  # number of its first line
    header: list[str]  # that line, as text
    # the others, and that one, too, if it holds numbers, each with its number
    rows: Iterator[tuple[int, list[str]]]
    comma: bool  # whether it has commas in its numbers


def read_table(path: Path, columns: Sequence[str] = (), units: Sequence[str] = ()) -> Table:
    """Read a table. Commas, semicolons, tabs or spaces separate its columns.

    Lines with # are left out, and so are lines that repeat the line before.

    Args:
        path: The file. Its first line says what its columns are, see HEADER.
        columns: For other columns: which of them is what, such as ``t=time``, ``x=X [mm]``, or by
            its number, ``t=1``, for a table without a header.
        units: Units of its times, lengths and angles, such as ``ms``, ``mm``, ``deg``, where they
            are not s, m and rad.

    Raises:
        InputError: it cannot be read, a line is wrong, or an option does not fit.
    """
    scales = _scales(units)
    table: list[list[float]] = []
    try:
        lines = read_lines(path)
        names, places = _chosen(path, lines, columns)
        count = len(lines.header)
        for number, row in lines.rows:
            where = f'{path}, line {number}'
            if len(row) != count:
                raise InputError(f'{where} must hold {count} numbers, not {len(row)}')
            values = [_number(where, row[k], lines.comma) for k in places]
            if table and values == table[-1]:
                continue
            if table and values[0] <= table[-1][0]:
                what = f't = {values[0]:.10g} is not after {table[-1][0]:.10g}'
                raise InputError(f'{where}: {what}; times must increase')
            table.append(values)
    except csv.Error as error:
        raise InputError(f'{path}: {error}') from None
    if len(table) < 2:
        raise InputError(f'{path} must hold at least 2 points, not {len(table)}')
    numbers = np.array(table) * [scales.get(_kind(name, units), 1.0) for name in names]
    _check_quaternions(path, numbers, names)
    return Table(numbers[:, 0], numbers[:, 1:], names[1:])


def read_lines(path: Path) -> Lines:
    """The lines of a table without those that are empty or begin with #.

    Raises:
        InputError: it cannot be read, or is empty.
    """
    text = yaml_file.text(path, MAX_BYTES)
    numbered = ((k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip())
    used = ((k, line) for k, line in numbered if not line.lstrip().startswith('#'))
    number, first = next(used, (1, ''))
    if not first:
        raise InputError(f'{path} is empty')
    separator = max(SEPARATORS, key=lambda mark: (first.count(mark) > 0, mark != ','))
    spaced = separator not in first
    comma = separator != ',' and ',' in text

    def cells(line: str) -> list[str]:
        if spaced:
            return line.split()
        found = [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
        return found[:-1] if found[-1:] == [''] else found  # some end with a separator

    header = cells(first)
    rows: Iterator[tuple[int, list[str]]] = ((k, cells(line)) for k, line in used)
    if header and all(read_number(cell, comma) is not None for cell in header):
        rows = itertools.chain([(number, header)], rows)
    return Lines(number, header, rows, comma)


def _chosen(path: Path, lines: Lines, columns: Sequence[str]) -> tuple[tuple[str, ...], list[int]]:
    """Names of time and coordinates, and where in a line they stand."""
    header = lines.header
    shown = printable(', '.join(header), SHOWN)
    if not columns:
        names = [name.lower() for name in header]
        if not _are_names(names):
            hint = f'; {COLUMNS} says which column is what, such as [t=1, x=2, y=3]'
            where = f'{path}, line {lines.number}'
            raise InputError(f'{where}: the header must be {HEADER}, not {shown!r}{hint}')
        return tuple(names), list(range(len(names)))
    pairs = dict(entry.split('=', 1) for entry in columns if '=' in entry)
    if len(pairs) != len(columns) or not _are_names(sorted(pairs, key=_order)):
        raise InputError(
            f'{COLUMNS} must name t and coordinates, each once, such as [t=time, x=X, y=Y], '
            f'not {list(columns)}',
            COLUMNS,
        )
    names = sorted(pairs, key=_order)
    return tuple(names), [
        _column_index(path, header, pairs[name].strip(), shown) for name in names
    ]


def _column_index(path: Path, header: list[str], column: str, shown: str) -> int:
    """Where in a line a column stands, which is given by its name or its number from 1."""
    same = [k for k, name in enumerate(header) if name == column]
    if len(same) == 1:
        return same[0]
    if column.isdecimal() and 1 <= int(column) <= len(header):
        return int(column) - 1
    what = 'has two columns' if same else 'has no column'
    raise InputError(f'{path} {what} {column!r}, only {shown!r}', COLUMNS)


def _order(name: str) -> tuple[int, int | str]:
    """Time first, then coordinates as a pose has them, or joints by their numbers."""
    if name in ORDER:
        return (0, ORDER.index(name))
    return (1, int(name[1:])) if re.fullmatch(r'q[1-9]\d*', name) else (2, name)


def _are_names(names: list[str]) -> bool:
    if len(names) < 2 or names[0] != 't':
        return False
    own, space = tuple(names[1:]), (*PLACE, *ROTATION_VECTOR)
    joints = tuple(f'q{k}' for k in range(1, len(names)))
    some = tuple(name for name in space if name in own)
    return own in (joints, PLANE, some, (*PLACE, *QUATERNION))


def is_joint(name: str) -> bool:
    """Whether a coordinate is that of a joint: q1, q2 and so on."""
    return name[0] == 'q' and name[1:].isdecimal()


def length_or_angle(name: str) -> str:
    """Unit of a coordinate of a pose: m, rad, or none for those of a quaternion."""
    return 'm' if name in PLACE else '' if name in QUATERNION else 'rad'


def _check_quaternions(path: Path, numbers: Array, names: Sequence[str]) -> None:
    """Refuse quaternions that are no rotations."""
    if QUATERNION[0] not in names:
        return
    lengths = np.linalg.norm(numbers[:, -len(QUATERNION) :], axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > ROUNDED)
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f'{path}: the quaternion at t = {numbers[k, 0]:.10g} must have length 1, '
            f'not {lengths[k]:.4g}'
        )


def _kind(name: str, units: Sequence[str]) -> str:
    """What a column is; joints are angles where no unit of an angle, but one of a length, is."""
    if name == 't':
        return 'time'
    slides = any(unit in LENGTH for unit in units) and not any(unit in ANGLE for unit in units)
    if name in QUATERNION:
        return 'number'
    return 'length' if name in PLACE or (is_joint(name) and slides) else 'angle'


def _scales(units: Sequence[str]) -> dict[str, float]:
    """What a number of each kind is multiplied with."""
    scales: dict[str, float] = {}
    for unit in units:
        kind = next((kind for kind, sizes in KINDS.items() if unit in sizes), None)
        if kind is None:
            every = ', '.join(name for sizes in KINDS.values() for name in sizes)
            raise InputError(f'{UNITS}: unknown unit {unit!r} (known: {every})', UNITS)
        if kind in scales:
            raise InputError(f'{UNITS} must name one unit of {kind}, not {list(units)}', UNITS)
        scales[kind] = KINDS[kind][unit]
    return dict.fromkeys(KINDS, 1.0) | scales


def read_number(text: str, comma: bool) -> float | None:
    """A number, also one that is not finite; None if it is none."""
    try:
        return float(text.replace(',', '.') if comma else text)
    except ValueError:
        return None


def _number(where: str, text: str, comma: bool) -> float:
    """A finite number."""
    value = read_number(text, comma)
    if value is None or not math.isfinite(value) or '_' in text:
        shown = printable(text.strip(), yaml_file.STRING)
        raise InputError(f'{where}: {shown!r} is not a finite number')
    return value


# Points of a motion in a CSV file, whose values take the place of its name.

POINTS_FILE, TIMES, POINTS = 'waypoints.file', 'waypoints.times', 'waypoints.points'
SPACE, THINNED = 'waypoints.space', 'waypoints.thinned'
MAX_POINTS = 5000  # points of a motion: all of them are parameters of nodes, and go into a bag


def with_points(values: LocatedDict) -> LocatedDict:
    """Values with those of the CSV that they name, if any, instead of its name.

    Its path counts from the file in which its name stands, or else from the current directory.
    What says how it is read, its columns and units, stands beside its name.

    Raises:
        InputError: it cannot be read, is no such file, or there are points beside it.
    """
    name = values.get(POINTS_FILE, '')
    options = [key for key in (COLUMNS, UNITS) if values.get(key)]
    if name == '' and not options:
        return values
    place = values.locations.get(POINTS_FILE)
    with with_location(values):
        if name == '':
            raise InputError(f'{options[0]} needs {POINTS_FILE} beside it', options[0])
        if not isinstance(name, str):
            raise InputError(f'{POINTS_FILE} must be text, not {name!r}', POINTS_FILE)
        beside = next((key for key in (TIMES, POINTS) if values.get(key)), None)
        if beside:
            raise InputError(f'{POINTS_FILE} and {beside} exclude each other', POINTS_FILE)
        columns, units = (
            check(key, tuple[str, ...], Field('', ''), values.get(key, []))
            for key in (COLUMNS, UNITS)
        )
        try:
            path = Path(place.file if place else '').parent / Path(name).expanduser()
            table = read_table(path, columns, units)
        except (RuntimeError, InputError) as error:  # home of an unknown user
            key = getattr(error, 'key', '') or POINTS_FILE
            raise InputError(
                f'{POINTS_FILE}: {error}' if key == POINTS_FILE else str(error), key
            ) from None
    kept, thinned = _thinned(table, name)
    of_joints = is_joint(table.names[0])
    space = 'quaternions' if QUATERNION[0] in table.names else 'pose'
    entries: dict[str, Any] = {
        POINTS_FILE: '',
        COLUMNS: [],
        UNITS: [],
        TIMES: table.times[kept].tolist(),
        POINTS: table.points[kept].ravel().tolist(),
        SPACE: 'joints' if of_joints else space,
        THINNED: thinned,
    }
    places = dict.fromkeys(entries, place) if place else {}
    places[POINTS] = (place or SourceLocation(str(path), 1))._replace(columns=table.names)
    return values | LocatedDict(entries, places)


def _thinned(table: Table, name: str) -> tuple[NDArray[np.int64], str]:
    """Indices of the rows that are kept, at most MAX_POINTS, and what is said of the others."""
    count = len(table.times)
    if count <= MAX_POINTS:
        return np.arange(count), ''
    from scipy.interpolate import make_interp_spline  # it takes long to load

    step = -(-(count - 1) // (MAX_POINTS - 1))
    kept = np.unique([*range(0, count, step), count - 1])
    curve = make_interp_spline(table.times[kept], table.points[kept], k=5)
    offset = np.abs(curve(table.times) - table.points).max(axis=0)
    unit = map(length_or_angle, table.names)
    deviations = (
        f'{axis} {distance:.2g} {of}'.strip()
        for axis, distance, of in zip(table.names, offset, unit, strict=True)
    )
    return kept, (
        f'{name} has {count} rows, of which one in {step} is followed; '
        f'the motion misses the others by at most {", ".join(deviations)}'
    )
