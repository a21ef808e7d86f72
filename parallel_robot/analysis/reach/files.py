"""A region as a file: a picture, or its numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.reach.plane import Plane
from parallel_robot.analysis.reach.region import Region, region_of
from parallel_robot.analysis.reach.scenery import Scenery, plane_and_scenery
from parallel_robot.analysis.report import figures
from parallel_robot.bags import output
from parallel_robot_model.common.errors import UnknownNameError
from parallel_robot_model.common.units import Array
from parallel_robot_sim.configuration import Configuration

NUMBERS = '.json'
STEPS = 100  # of the grid of numbers


def check(path: Path) -> None:
    """Refuse a file that exists, cannot be made, or has another suffix.

    Raises:
        InputError: with the reason.
    """
    suffixes = (*figures.FORMATS, NUMBERS)
    if path.suffix not in suffixes:
        raise UnknownNameError('format of --workspace', path.suffix, suffixes)
    output.check_new(path, '--workspace')


def write(configuration: Configuration, plane: str, path: Path) -> str:
    """Write what of a plane the robot of a scenario reaches.

    Args:
        configuration: The scenario.
        plane: The plane, see :func:`reach.plane.named_plane`; empty: that of the motion.
        path: A new file, see :func:`check`.

    Returns:
        What was found, in a line.

    Raises:
        InputError: there is no such plane, or the robot does not reach its pose.
    """
    chosen, scenery = plane_and_scenery(configuration, plane)
    if path.suffix == NUMBERS:
        region = region_of(scenery.robot, chosen, STEPS)
        output.write_new(path, json.dumps(plain(region, scenery)).encode())
    else:
        from parallel_robot.analysis.reach.picture import figure_of  # it takes long to load

        region = region_of(scenery.robot, chosen)
        figures.save(figure_of(region, scenery), path)
    return _told(region)


def plain(region: Region, scenery: Scenery) -> dict[str, Any]:
    """A region as plain data; what is not reached is None."""
    plane, inside = region.plane, region.inside
    return {
        'scenario': scenery.values['scenario'],
        'robot': scenery.robot.name,
        'coordinates': [axis.name for axis in scenery.coordinates],
        'coordinate_units': [axis.unit for axis in scenery.coordinates],
        'plane': _plain_plane(plane),
        'first': region.first.tolist(),
        'second': region.second.tolist(),
        'reached': inside.tolist(),
        'margins': {
            margin.key: {
                'label': margin.label,
                'fault_below': scenery.values.get(f'safety.{margin.key}'),
                'values': _or_none(np.where(inside, margin.values, np.nan)),
            }
            for margin in region.reach.margins
        },
        'area': region.area,
        'complete': region.complete,
        'home': None if scenery.home is None else scenery.home.tolist(),
        'motion': scenery.path.tolist(),
    }


def _plain_plane(plane: Plane) -> dict[str, Any]:
    return {
        'pose': plane.pose.tolist(),
        'axes': [axis.name for axis in plane.axes],
        'units': [axis.unit for axis in plane.axes],
        'directions': [axis.direction.tolist() for axis in plane.axes],
    }


def _or_none(values: Array) -> list[list[float | None]]:
    return [[None if x != x else x for x in row] for row in values.tolist()]


def _told(region: Region) -> str:
    first, second = region.plane.axes
    ends = ', '.join(
        f'{axis.name} {low:.4g} to {high:.4g} {axis.unit}'
        for axis, (low, high) in zip(region.plane.axes, region.extent, strict=True)
    )
    unit = f'{first.unit}^2' if first.unit == second.unit else f'{first.unit} {second.unit}'
    more = '' if region.complete else '; it goes on beyond'
    return f'{ends}; area {region.area:.4g} {unit}{more}'
