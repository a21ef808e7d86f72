"""A table of joints in a file, CSV or Parquet, read as a bag that holds joint states alone."""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags import experiment, trust
from parallel_robot.bags.bag_reader import Bag, BagView
from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot_model.common.errors import InputError, first_line, optional, printable
from parallel_robot_model.common.units import NANOSECONDS, Array, JointUnits
from parallel_robot_model.configuration import points
from parallel_robot_model.configuration.points import ANGLE, LENGTH
from parallel_robot_model.messages.topics import JOINT_STATES
from parallel_robot_model.robots.registry import units_of

PARQUET = '.parquet'
SUFFIXES = ('.csv', '.txt', '.tsv', '.dat', PARQUET)
TIME, POSITION, VELOCITY, EFFORT, CURRENT = 't', 'q', 'dq', 'tau', 'i'
ALWAYS = TIME, POSITION, VELOCITY
PERIOD = 'period'  # key of the configuration
AUTO = 'auto'  # a torque constant that is to be found
WORDS = {each: each for each in (POSITION, VELOCITY, EFFORT, CURRENT)} | {
    'position': POSITION, 'velocity': VELOCITY, 'effort': EFFORT, 'torque': EFFORT,
    'current': CURRENT,
}  # fmt: skip
NAME = re.compile(rf'({"|".join(WORDS)})[_ ]?(.+)')
UNIT = re.compile(r'(.*?)\s*\[([^]]*)\]')
SPACED = re.compile(r'[^\s[]+(?:\s*\[[^]]*\])?')  # a name with its unit, between spaces
EXPORTED = {'position_rad': POSITION, 'velocity_rad_per_s': VELOCITY, 'effort_nm': EFFORT}
FORCE = {'N': 1.0, 'mN': 1e-3, 'kN': 1e3}
UNITS: dict[str, tuple[dict[str, float], ...]] = {  # of hinges, and of slides
    TIME: (points.TIME,) * 2,
    POSITION: (ANGLE, LENGTH),
    VELOCITY: tuple({f'{unit}/s': size for unit, size in of.items()} for of in (ANGLE, LENGTH)),
    EFFORT: ({f'{unit} m': size for unit, size in FORCE.items()}, FORCE),
    CURRENT: ({'A': 1.0, 'mA': 1e-3},) * 2,
}
EXAMPLE = 't [s], q1 [deg], q2 [deg], tau1 [N m], tau2 [N m]'
NO_TORQUES = (
    'torques are needed: columns as tau1 [N m], or currents as i1 [A] and --torque-constant '
    '[N m/A], the gear ratio in it'
)
EMPTY = ('', 'nan', 'na', 'null', 'none')
UNTOLD = 'no unit'
LATEST = 2**62 / NANOSECONDS  # s, about what stamps can hold
SHOWN = 120  # characters of names


class _Column(NamedTuple):
    """Where a column stands, and its unit."""

    place: int
    size: float  # of its unit
    told: bool  # whether the file tells that


_Columns = dict[tuple[str, int], _Column]  # by what they are, and of which joint


class _File(NamedTuple):
    """A table that was opened."""

    path: Path
    header: list[str]
    row: str  # what a row of it is called
    # numbers of some columns, shape (N, m), NaN where there is none, and where the rows stand
    numbers: Callable[[Sequence[int]], tuple[Array, Sequence[int]]]


def is_table(path: Path) -> bool:
    """Whether a path is that of a table, by its suffix."""
    return path.suffix.lower() in SUFFIXES and not path.is_dir()


def read(path: Path, view: BagView) -> Bag[list[Samples]]:
    """Read times, positions, and torques or currents of the joints of a robot.

    Args:
        path: The file. Its header is such as EXAMPLE, with numbers of the joints or their names,
            or what ``export`` writes. One without times has rows at the period of the view.
        view: Of which robot it is, and the torque constants of its motors: where one is to be
            found, its currents stand in the place of torques.

    Raises:
        InputError: it cannot be read, or its columns are not those of the robot.
    """
    values, loop, _ = experiment.configuration(path, {}, {}, view)
    joints = loop.joints
    known = np.array([1.0 if each is None else each for each in view.torque_constant])
    constant = np.ones_like(known) if None in view.torque_constant else known
    file = (_parquet if path.suffix.lower() == PARQUET else _text)(path)
    columns = _columns(file, joints, units_of(values), PERIOD in view.values)
    if constant.size and (CURRENT, 0) not in columns:
        raise InputError(f'{path}: --torque-constant needs currents, columns as i1 [A]')
    usable = np.isfinite(known).all() and known.all()
    if constant.size not in (0, 1, len(joints)) or not usable:
        what = f'one finite number but 0, or {AUTO}, or one for each of {len(joints)} joints'
        given = ', '.join(AUTO if each is None else f'{each:g}' for each in view.torque_constant)
        raise InputError(f'--torque-constant must be {what}, not {given}')
    motor = CURRENT if constant.size else EFFORT
    used = {which: columns[which] for which in sorted(columns) if which[0] in (*ALWAYS, motor)}
    numbers, rows = file.numbers([each.place for each in used.values()])
    numbers = numbers * [each.size for each in used.values()]
    of = np.array([kind for kind, _ in used])
    time, position, effort, velocity = (
        numbers[:, of == kind] for kind in (TIME, POSITION, motor, VELOCITY)
    )
    if not time.size:
        time = loop.period * np.arange(float(len(numbers)))[:, np.newaxis]
    if not np.isfinite(effort).any():  # a column for torques that were not measured
        effort = effort[:, :0]
    needed = np.hstack([time, position, effort])
    whole = np.asarray(np.isfinite(needed).all(axis=1))
    new = np.append([True], (np.diff(needed, axis=0) != 0.0).any(axis=1))
    kept = np.flatnonzero(whole & new)
    if len(kept) < 2:
        shown = printable(', '.join(file.header[each.place] for each in used.values()), SHOWN)
        raise InputError(f'{path}: fewer than two {file.row}s have numbers: {shown}')
    stamps = _stamps(file, time[kept, 0], np.asarray(rows)[kept])
    fields, told = {'position': position[kept]}, []
    if effort.size:
        fields['effort'] = effort[kept] * (constant if constant.size else 1.0)
    if velocity.size and np.isfinite(velocity[kept]).all():
        fields['velocity'] = velocity[kept]
    if not whole.all():
        lacking = f'{(~whole).sum()} of {len(whole)} {file.row}s lack a number'
        told.append(f'{lacking}: they are left out, like states that were lost')
    told += _doubts(file, used)
    name = f'{view.namespace or ""}/{JOINT_STATES.name}'
    return Bag(
        {name: [[Samples(joints, stamps, stamps, fields)]]},
        metadata={},
        warnings=tuple(f'{path}: {line}' for line in told),
        notes={},
        sources={key: {} for key in trust.KINDS},
        channels={name: JOINT_STATES.type},
        encodings={},
    )


def _text(path: Path) -> _File:
    """A table in a text."""
    lines = points.read_lines(path)
    header = lines.header
    if any(cell.startswith('[') for cell in header):  # spaces separate, and stand before units
        header = SPACED.findall(' '.join(header))

    def numbers(places: Sequence[int]) -> tuple[Array, Sequence[int]]:
        found, rows = array('d'), array('q')
        try:
            for row, cells in lines.rows:
                if len(cells) != len(header):
                    what = f'{len(header)} numbers, not {len(cells)}'
                    raise InputError(f'{path}, line {row} must hold {what}')
                for cell in (cells[k] for k in places):
                    number = points.read_number(cell, lines.comma)
                    if number is None and cell.lower() not in EMPTY:
                        shown = printable(cell, SHOWN)
                        raise InputError(f'{path}, line {row}: {shown!r} is not a number')
                    found.append(math.nan if number is None else number)
                rows.append(row)
        except csv.Error as error:
            raise InputError(f'{path}: {error}') from None
        return np.reshape(np.array(found), (-1, len(places))), rows

    return _File(path, header, 'line', numbers)


def _parquet(path: Path) -> _File:
    """A table in Apache Parquet."""
    lacking = 'pyarrow is not installed; pip install pyarrow, or give a .csv'
    pyarrow, parquet = (optional(name, lacking) for name in ('pyarrow', 'pyarrow.parquet'))
    if not path.is_file():
        raise InputError(f'{path} does not exist')
    try:
        table = parquet.read_table(path)
    except (OSError, pyarrow.ArrowException) as error:
        raise InputError(f'{path} cannot be read: {first_line(error)}') from None
    dated = [pyarrow.types.is_timestamp(kind) for kind in table.schema.types]
    header = [
        f'{field.name} [{field.type.unit}]' if date else field.name
        for field, date in zip(table.schema, dated, strict=True)
    ]

    def numbers(places: Sequence[int]) -> tuple[Array, Sequence[int]]:
        columns = []
        for k in places:
            column = table.column(k).cast('int64') if dated[k] else table.column(k)
            try:
                columns.append(np.asarray(column.to_numpy(), float))
            except (TypeError, ValueError):
                raise InputError(f'{path}: {printable(header[k])} holds no numbers') from None
        return np.column_stack(columns), range(1, table.num_rows + 1)

    return _File(path, header, 'row', numbers)


def _columns(file: _File, joints: Sequence[str], units: JointUnits, regular: bool) -> _Columns:
    """The columns of times, where rows are not `regular`, and of joints; others are left out.

    Raises:
        InputError: they are not those of the robot.
    """
    found: _Columns = {}
    meanings = _meanings(file, joints, units)
    for place, (name, meant) in enumerate(zip(file.header, meanings, strict=True)):
        if meant is None:
            continue
        kind, joint, unit = meant
        where = f'{file.path}: the column {printable(name, SHOWN)}'
        if not 0 <= joint < len(joints):
            what = f'the robot has {len(joints)} joints, {", ".join(joints)}'
            raise InputError(f'{where}: {what}; --scenario chooses another robot')
        if (kind, joint) in found:
            twin = printable(file.header[found[kind, joint].place], SHOWN)
            raise InputError(f'{where} and {twin} are both {kind} of {joints[joint]}')
        slides = bool(units.slides and units.slides[joint])
        known = UNITS[kind][slides]
        size = {_bare(each): size for each, size in known.items()}.get(_bare(unit or ''))
        if unit and size is None:
            what = 'a time' if kind == TIME else f'{kind} of a {"slide" if slides else "hinge"}'
            raise InputError(f'{where}: the unit of {what} must be one of {", ".join(known)}')
        found[kind, joint] = _Column(place, size or 1.0, unit is not None)
    if not any(kind == POSITION for kind, _ in found):
        shown = printable(', '.join(file.header), SHOWN)
        what = f'the header must be such as {EXAMPLE}, or with {joints[0]} for 1, not {shown!r}'
        raise InputError(f'{file.path}: {what}')
    if (TIME, 0) not in found and not regular:
        what = 'a column of times as t [s], or --set period=S, the time from row to row,'
        raise InputError(f'{file.path}: {what} is needed')
    for kind in {kind for kind, _ in found} - {TIME}:
        lacking = [name for k, name in enumerate(joints) if (kind, k) not in found]
        if lacking:
            what = f'there is no column {kind} of {", ".join(lacking)}'
            raise InputError(f'{file.path}: {what}; --scenario chooses another robot')
    return found


def _meanings(
    file: _File, joints: Sequence[str], units: JointUnits
) -> Iterator[tuple[str, int, str | None] | None]:
    """Kind, joint and unit of each column; None where it is of something else.

    The unit is None where the file does not tell it, and empty where it is that of ``export``.
    """
    exported = {
        f'{joint}_{units.one(k).key(quantity)}': (kind, k, '')
        for k, joint in enumerate(joints)
        for quantity, kind in EXPORTED.items()
    } | {'time_s': (TIME, 0, '')}
    bare = [UNIT.sub(r'\1', name) for name in file.header]
    parts = [NAME.fullmatch(name) for name in bare]
    from_zero = {part[1] for part in parts if part and part[2] == '0'}
    for name, word, part in zip(file.header, bare, parts, strict=True):
        told = UNIT.fullmatch(name)
        unit = told[2] if told else None
        if name in exported or word in ('t', 'time'):
            yield exported.get(name, (TIME, 0, unit))
        elif part and part[2] in joints:
            yield WORDS[part[1]], joints.index(part[2]), unit
        elif part and part[2].isdecimal():
            yield WORDS[part[1]], int(part[2]) - (part[1] not in from_zero), unit
        else:
            yield None


def _bare(unit: str) -> str:
    """A unit without what stands between its parts."""
    return re.sub(r'[\s*.·]', '', unit)


def _stamps(file: _File, time: Array, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Stamps [ns] of times [s], shape (N,), which stand in some rows.

    Raises:
        InputError: they do not increase, or no stamp holds them.
    """
    if not np.abs(time[[0, -1]]).max() < LATEST:
        raise InputError(f'{file.path}: t reaches {time[-1]:.4g} s; if that is ns, write t [ns]')
    early = np.flatnonzero(np.diff(time) <= 0.0)
    if early.size:
        k = int(early[0]) + 1
        what = f't = {time[k]:.15g} is not after {time[k - 1]:.15g}; times must increase'
        raise InputError(f'{file.path}, {file.row} {rows[k]}: {what}')
    first = max(1, round(time[0] * NANOSECONDS))
    return first + np.rint((time - time[0]) * NANOSECONDS).astype(np.int64)


def _doubts(file: _File, used: _Columns) -> Iterator[str]:
    """What was taken of a table that it does not say, and what was not used, one line each."""
    silent = [file.header[each.place] for each in used.values() if not each.told]
    if silent:
        shown = printable(', '.join(silent), SHOWN)
        taken = 's, rad, N m and A, of slides m and N; a header as q1 [deg], t [ms] says another'
        yield f'{UNTOLD} of {shown}: taken to be {taken}'
    places = {each.place for each in used.values()}
    others = [name for place, name in enumerate(file.header) if place not in places]
    if others:
        yield f'not used: the columns {printable(", ".join(others), SHOWN)}'
