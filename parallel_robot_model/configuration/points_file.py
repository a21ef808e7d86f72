"""Points of a motion in a CSV file, whose values take the place of its name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import points_table
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.configuration.plain_data import Place, Placed, locating
from parallel_robot_model.configuration.points_table import COLUMNS, UNITS, Table

FILE, TIMES, POINTS = 'waypoints.file', 'waypoints.times', 'waypoints.points'
SPACE, THINNED = 'waypoints.space', 'waypoints.thinned'
MAX_POINTS = 5000  # points of a motion: all of them are parameters of nodes, and go into a bag


def filled(values: Placed) -> Placed:
    """Values with those of the CSV that they name, if any, instead of its name.

    Its path counts from the file in which its name stands, or else from the current directory.
    What says how it is read, its columns and units, stands beside its name.

    Raises:
        InputError: it cannot be read, is no such file, or there are points beside it.
    """
    name = values.get(FILE, '')
    options = [key for key in (COLUMNS, UNITS) if values.get(key)]
    if name == '' and not options:
        return values
    place = values.places.get(FILE)
    with locating(values):
        if name == '':
            raise InputError(f'{options[0]} needs {FILE} beside it', options[0])
        if not isinstance(name, str):
            raise InputError(f'{FILE} must be text, not {name!r}', FILE)
        beside = next((key for key in (TIMES, POINTS) if values.get(key)), None)
        if beside:
            raise InputError(f'{FILE} and {beside} exclude each other', FILE)
        columns, units = (
            check(key, tuple[str, ...], Field('', ''), values.get(key, []))
            for key in (COLUMNS, UNITS)
        )
        try:
            path = Path(place.file if place else '').parent / Path(name).expanduser()
            table = points_table.read(path, columns, units)
        except (RuntimeError, InputError) as error:  # home of an unknown user
            key = getattr(error, 'key', '') or FILE
            raise InputError(f'{FILE}: {error}' if key == FILE else str(error), key) from None
    kept, thinned = _thinned(table, name)
    of_joints = points_table.is_joint(table.names[0])
    space = 'quaternions' if points_table.QUATERNION[0] in table.names else 'pose'
    entries: dict[str, Any] = {
        FILE: '',
        COLUMNS: [],
        UNITS: [],
        TIMES: table.times[kept].tolist(),
        POINTS: table.points[kept].ravel().tolist(),
        SPACE: 'joints' if of_joints else space,
        THINNED: thinned,
    }
    places = dict.fromkeys(entries, place) if place else {}
    places[POINTS] = (place or Place(str(path), 1))._replace(columns=table.names)
    return values | Placed(entries, places)


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
    unit = map(points_table.length_or_angle, table.names)
    told = (
        f'{axis} {distance:.2g} {of}'.strip()
        for axis, distance, of in zip(table.names, offset, unit, strict=True)
    )
    return kept, (
        f'{name} has {count} rows, of which one in {step} is followed; '
        f'the motion misses the others by at most {", ".join(told)}'
    )
