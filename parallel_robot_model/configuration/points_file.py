"""Points of a motion in a CSV file, whose values take the place of its name."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path
from typing import Any

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.placed import Place, Placed, locating

FILE, TIMES, POINTS = 'waypoints.file', 'waypoints.times', 'waypoints.points'
MOST = 5000  # points of a motion: all of them are parameters of nodes, and go into a bag
HEADER = 't, x, y, phi; t, x, y; or t, q1, q2 and so on'


def filled(values: Placed) -> Placed:
    """Values with those of the CSV that they name, if any, instead of its name.

    Its path counts from the file in which its name stands, or else from the current directory.

    Raises:
        InputError: it cannot be read, is no such file, or there are points beside it.
    """
    name = values.get(FILE, '')
    if name == '':
        return values
    place = values.places.get(FILE)
    with locating(values):
        if not isinstance(name, str):
            raise InputError(f'{FILE} must be text, not {name!r}', FILE)
        beside = next((key for key in (TIMES, POINTS) if values.get(key)), None)
        if beside:
            raise InputError(f'{FILE} and {beside} exclude each other', FILE)
        try:
            path = Path(place.file if place else '').parent / Path(name).expanduser()
            times, points, columns = read(path)
        except (RuntimeError, InputError) as error:  # home of an unknown user
            raise InputError(f'{FILE}: {error}', FILE) from None
    found = {FILE: '', TIMES: times, POINTS: points}
    places = dict.fromkeys(found, place) if place else {}
    places[POINTS] = (place or Place(str(path), 1))._replace(columns=columns)
    return values | Placed(found, places)


def read(path: Path) -> tuple[list[float], list[float], tuple[str, ...]]:
    """Read times [s], points, one after another, in the units of the robot, and their columns.

    Args:
        path: A CSV with a header: HEADER.

    Raises:
        InputError: it cannot be read, or a line is wrong.
    """
    lines = csv.reader(yaml_file.text(path).splitlines())
    times: list[float] = []
    points: list[float] = []
    try:
        header = [name.strip().lower() for name in next(lines, [])]
        if not _is_header(header):
            shown = printable(', '.join(header), yaml_file.STRING)
            raise InputError(f'{path}, line 1: the header must be {HEADER}, not {shown!r}')
        for line in lines:
            if not ''.join(line).strip():
                continue
            where = f'{path}, line {lines.line_num}'
            if len(line) != len(header):
                raise InputError(f'{where} must hold {len(header)} numbers, not {len(line)}')
            numbers = [_number(where, text) for text in line]
            if times and numbers[0] <= times[-1]:
                what = f't = {numbers[0]:.10g} is not after {times[-1]:.10g}'
                raise InputError(f'{where}: {what}; times must increase')
            if len(times) == MOST:
                raise InputError(f'{path} has more than {MOST} points')
            times.append(numbers[0])
            points += numbers[1:]
    except csv.Error as error:
        raise InputError(f'{path}, line {lines.line_num}: {error}') from None
    if len(times) < 2:
        raise InputError(f'{path} must hold at least 2 points, not {len(times)}')
    return times, points, tuple(header[1:])


def _is_header(names: list[str]) -> bool:
    axes = [f'q{k}' for k in range(1, len(names))]
    return names in (['t', 'x', 'y', 'phi'], ['t', 'x', 'y']) or (
        len(names) > 1 and names == ['t', *axes]
    )


def _number(where: str, text: str) -> float:
    """A finite number.

    Raises:
        InputError: it is none.
    """
    try:
        value: Any = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or re.search('_', text):
        shown = printable(text.strip(), yaml_file.STRING)
        raise InputError(f'{where}: {shown!r} is not a finite number')
    return float(value)
