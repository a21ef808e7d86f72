"""How curves and places look: colours, dashes, names, axes, views."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.laws import LAWS, title
from parallel_robot_model.common.errors import UnknownNameError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.registry import RobotModel

# Colours and dashes of curves, distinct for the colour-blind and in grey.


class Style(NamedTuple):
    """How a curve looks."""

    light: str  # colour on white paper
    dark: str  # colour on a dark screen
    # lengths of dash, gap, ... in units of the line width; empty for a solid line
    dash: tuple[float, ...] = ()
    width: float = 1.0  # width of the line [pt]
    marker: bool = False  # whether points are drawn instead of a line


RUNS = (
    Style('#e69f00', '#f0b429', (2.0, 1.2)),  # the paper's laws first, in the order of LAWS
    Style('#009e73', '#2bc49a', (6.0, 1.5, 1.5, 1.5)),
    Style('#aa3377', '#e27bb1', (5.0, 2.0)),
    Style('#004488', '#7fb0f5'),
    Style('#56b4e9', '#56b4e9', (8.0, 1.5)),
    Style('#7a4a1e', '#c8945f', (3.0, 1.0)),
    Style('#999933', '#c9c95c', (6.0, 1.2, 1.2, 1.2, 1.2, 1.2)),
    Style('#555555', '#b5b5b5', (1.2, 1.2)),
)
JOINT_COLOURS = (
    ('#333333', '#e6e6e6'),
    ('#4477aa', '#6ea6df'),
    ('#ee99aa', '#ee99aa'),
    ('#882255', '#d0669a'),
    ('#228866', '#5cc9a5'),
    ('#ccaa33', '#ddcc66'),
)
JOINT_DASHES: tuple[tuple[float, ...], ...] = ((), (5.0, 1.5), (6.0, 1.5, 1.5, 1.5), (1.5, 1.2))
JOINTS = 12  # styles, from the first again beyond them
STYLES = {
    **{f'run{slot}': style for slot, style in enumerate(RUNS)},
    **{  # each three of one dash differ in lightness
        f'joint{k}': Style(*JOINT_COLOURS[k % 6], JOINT_DASHES[k // 3], width=0.7)
        for k in range(JOINTS)
    },
    'reference': Style('#c4c4c4', '#5c6370', width=3.0),
    'start': Style('#333333', '#e6e6e6', marker=True),
}


def joint_style(joint: int) -> str:
    """Key in STYLES for a joint, by its 0-based index."""
    return f'joint{joint % JOINTS}'


def slots(laws: list[str]) -> list[int]:
    """Choose a style for each run by its law; the next free one where two runs share a law.

    Args:
        laws: Laws of at most len(RUNS) runs.

    Returns:
        Indices into RUNS, all different.
    """
    known = list(LAWS)
    free = list(range(len(RUNS)))
    chosen = []
    for law in laws:
        wanted = known.index(law) % len(RUNS) if law in known else 0
        slot = min(free, key=lambda candidate: (candidate - wanted) % len(RUNS))
        free.remove(slot)
        chosen.append(slot)
    return chosen


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
