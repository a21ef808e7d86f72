"""How places and names look in pictures: labels, scales of errors, views of space."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from parallel_robot_control.laws import title
from parallel_robot_model.common.errors import UnknownNameError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.registry import RobotModel

# Names from a bag as they are written in pictures and reports.

MAX_LABEL_LENGTH = 40  # characters of a name, so that it leaves room for the curves


def label(name: str) -> str:
    """A name, printable and not too long."""
    return printable(name, MAX_LABEL_LENGTH)


def law_label(name: str) -> str:
    """A law as papers write it, printable and not too long."""
    return label(title(name))


def joint_label(name: str) -> str:
    """The name of a joint, with a space before its number: 'joint 1' for 'joint1'."""
    return re.sub(r'(?<=[^\W\d])(?=\d+$)', ' ', label(name))


# Whether errors are drawn with their sign, or as magnitudes on a logarithmic axis.

AUTO, LINEAR, LOG = SCALES = ('auto', 'linear', 'log')
FLAT = 1 / 30  # of the largest value: a curve that is mostly below it looks like zero


def logarithmic(scale: str, curves: Iterable[np.ndarray]) -> bool:
    """Decide on the axis of errors that are drawn together.

    Args:
        scale: One of SCALES; AUTO: logarithmic if on a linear axis a curve would look like zero.
        curves: Their values, in one unit; each shape (N,) with N > 0.

    Raises:
        UnknownNameError: there is no such scale.
    """
    check(scale)
    if scale != AUTO:
        return scale == LOG
    sizes = [np.abs(curve) for curve in curves]
    typical = [float(np.median(size)) for size in sizes if size.any()]
    return bool(typical) and min(typical) < FLAT * max(float(size.max()) for size in sizes)


def check(scale: str) -> None:
    """Refuse what is no scale.

    Raises:
        UnknownNameError: there is no such scale.
    """
    if scale not in SCALES:
        raise UnknownNameError('scale', str(scale), SCALES)


def add_scale_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the argument ``--scale``."""
    parser.add_argument(
        '--scale',
        choices=SCALES,
        default=AUTO,
        help='of errors; log: their magnitude; auto (default): log where the spread asks for it',
    )


# Views of a place in space: from above, from the front, from the side.

VIEWS = (('x', 'y', (0, 1)), ('x', 'z', (0, 2)), ('y', 'z', (1, 2)))  # across, up, both axes
MM = 1e3  # of a metre
TURN, TILT = -0.5, 0.35  # rad, about z and from above: as the page shows a robot at first


def views(figure: Any, place: Any) -> list[Any]:
    """Empty panels of the three views in a cell of a grid, true to scale.

    Args:
        figure: A figure of matplotlib.
        place: Cell of its grid.
    """
    grid = place.subgridspec(2, 2, wspace=0.45, hspace=0.28)
    panels = [figure.add_subplot(grid[divmod(k, 2)]) for k in range(len(VIEWS))]
    for axes, (across, up, _) in zip(panels, VIEWS, strict=True):
        axes.set(xlabel=f'{across} [mm]', ylabel=f'{up} [mm]')
        axes.set_aspect('equal', 'datalim')
    return panels


def add_path(panels: Sequence[Any], path: Array, **look: Any) -> None:
    """Draw a path, shape (N, 3 or more), in all views."""
    for axes, (_, _, shown) in zip(panels, VIEWS, strict=True):
        axes.plot(*(MM * path[:, shown].T), **look)


def add_lines(panels: Sequence[Any], parts: dict[str, Array], **look: Any) -> None:
    """Draw the lines of a robot in one posture, each part of shape (lines, 2, 3), in all views."""
    for axes, (_, _, shown) in zip(panels, VIEWS, strict=True):
        for ends in parts.values():
            axes.plot(*(MM * ends[..., shown].T), **look)


def oblique(points: Array) -> Array:
    """Points in space, shape (..., 3), as they are seen from one place: across, up [m]."""
    x, y, z = np.moveaxis(points, -1, 0)
    deep = np.cos(TURN) * y - np.sin(TURN) * x
    across = np.cos(TURN) * x + np.sin(TURN) * y
    return np.stack([across, np.cos(TILT) * z + np.sin(TILT) * deep], axis=-1)


def posture(robot: RobotModel, pose: Array, position: Array) -> dict[str, Array]:
    """Lines of a robot in one posture, see ``segments`` of the contract.

    Args:
        robot: The robot.
        pose: Its pose, shape (m,).
        position: Its actuated joints, shape (n,).
    """
    found = robot.module.segments(robot.parameters, pose[np.newaxis], position[np.newaxis])
    return {part: ends[0] for part, ends in found.items()}
