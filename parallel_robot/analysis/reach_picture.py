"""A picture of what the tool reaches in the plane of its motion, with robot and home."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis import pictures
from parallel_robot.analysis.reach import Plane, Region, plane_of_motion, region_of
from parallel_robot.analysis.report.looks import label, posture
from parallel_robot.bags import output
from parallel_robot.bags.output import without_mathematics
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import REACHED, Coordinate, Margin
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.configuration import Configuration
from trajectory_gen import preflight
from trajectory_gen.trajectory import joints_at

# What is drawn with a region: the motion of its scenario, the robot, home.


class Scenery(NamedTuple):
    """What is drawn with a region."""

    title: str  # of the picture, and in a second line what is smaller
    robot: RobotModel
    coordinates: tuple[Coordinate, ...]  # of its pose
    home: Array | None  # pose where it is traced from, shape (m,); None where that does not matter
    path: Array  # poses of the motion, shape (N, m)
    # lines of the robot in the plane [m], shape (lines, 2, 2); of a robot in space none
    lines: Array
    values: Mapping[str, Any]  # the resolved configuration, which has the limits of the margins


def plane_and_scenery(configuration: Configuration) -> tuple[Plane, Scenery]:
    """The plane of a scenario's motion, and what is drawn with what is reached in it.

    Raises:
        InputError: the pose of the robot has no place.
    """
    trajectory, values = configuration.trajectory, configuration.values
    robot = trajectory.robot
    coordinates = robot.module.coordinates(robot.parameters)
    if not robot.place:
        names = ', '.join(axis.name for axis in coordinates)
        raise InputError(f'the pose of {robot.name} is no place: {names}; it has no workspace')
    path = trajectory.poses(preflight.grid(trajectory, configuration.loop.period)).pose
    home = robot.module.home(robot.parameters)
    plane = plane_of_motion(robot, path)._replace(pose=_reached(robot, path[0], home))
    title = _title(configuration.loop.scenario, plane, coordinates)
    return plane, Scenery(title, robot, coordinates, home, path, _lines(robot, plane), values)


def _reached(robot: RobotModel, *poses: Array | None) -> Array:
    """The first of some poses that the robot reaches; the last one where it reaches none."""
    known = [pose for pose in poses if pose is not None]
    reached = (
        pose for pose in known if joints_at(robot, pose[np.newaxis]).out_of_reach[0] == REACHED
    )
    return next(reached, known[-1])


def _lines(robot: RobotModel, plane: Plane) -> Array:
    """The robot at the pose of a plane in which it moves as a whole."""
    joints = joints_at(robot, plane.pose[np.newaxis])
    in_place = [np.flatnonzero(axis.direction).tolist() for axis in plane.axes] == [[0], [1]]
    if not (robot.planar and in_place) or joints.out_of_reach[0] != REACHED:
        return np.zeros((0, 2, 2))
    return np.concatenate(list(posture(robot, plane.pose, joints.position[0]).values()))


def _title(scenario: str, plane: Plane, coordinates: tuple[Coordinate, ...]) -> str:
    """The scenario, and those coordinates that are the same in all the plane."""
    used = sum(np.abs(axis.direction) for axis in plane.axes)
    fixed = [
        f'{axis.name} = {round(float(value), 9) + 0.0:.4g} {axis.unit}'
        for axis, value, share in zip(coordinates, plane.pose, np.asarray(used), strict=True)
        if share == 0.0
    ]
    return f'{label(scenario)}: reach of the tool\n' + (f'at {", ".join(fixed)}' if fixed else '')


# A region as a picture: its margins, limits and boundary, home, motion and robot.

COLOURS = ('#a8323e', '#e08a6d', '#f5e3c3', '#b4d3d6', '#4f8fb5', '#24487f')  # from zero on
DARK, PALE, GOLD, GROUND = '#1d2733', '#77828f', '#e6a01e', '#f1f2f5'
LEVELS = 12  # of a margin, at most
LIMITS = (('safety', 'a fault below', '-'), ('trajectory', 'no motion below', '--'))
MM = 1e3
LITTLE = 1e-6  # m and rad: less is in the plane
SMOOTH = 0.7  # steps of the grid
WIDTH, HIGHEST, BAR, TITLE = 5.2, 7.0, 1.3, 1.5  # in
PAD = 0.03  # around all, of its size


def figure_of(region: Region, scenery: Scenery) -> Any:
    """A region as a figure of matplotlib, one panel for each margin."""
    margins = region.reach.margins or (None,)
    first, second = region.plane.axes
    x, y = MM * region.first, MM * region.second
    wide, high = _limits(x, y, scenery)
    shape = np.ptp(high) / np.ptp(wide)
    height = min(WIDTH * shape, HIGHEST)
    size = (len(margins) * (height / shape + BAR), height + TITLE)
    figure = pictures.new(size)
    head, _, small = scenery.title.partition('\n')
    figure.suptitle(without_mathematics(head), fontweight='bold', fontsize=13)
    panels = figure.subplots(1, len(margins), squeeze=False, sharex=True, sharey=True)[0]
    for axes, margin in zip(panels, margins, strict=True):
        axes.set(xlabel=f'{first.name} [mm]', xlim=wide, ylim=high)
        axes.set_aspect('equal')
        axes.set_facecolor(GROUND)
        axes.spines[['top', 'right']].set_visible(False)
        if margin is None:
            axes.contourf(x, y, region.inside.astype(float), [0.5, 2.0], colors=[COLOURS[3]])
        else:
            _draw_margin(axes, x, y, margin, scenery.values)
        _draw_boundary(axes, x, y, region)
        _draw_inside(axes, region.plane, scenery)
    panels[0].set_ylabel(f'{second.name} [mm]')
    panels[0].set_title(without_mathematics(small), loc='left', fontsize=9, color=PALE)
    named: dict[str, Any] = {}
    for axes in panels:
        lines, names = axes.get_legend_handles_labels()
        named |= dict(zip(names, lines, strict=True))
    columns = max(2, int(size[0] / 2.6))
    figure.legend(
        named.values(),
        named.keys(),
        loc='outside lower center',
        ncols=columns,
        frameon=False,
        fontsize=9,
    )
    return figure


def _limits(
    x: Array, y: Array, scenery: Scenery
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of both axes: the region and the robot."""
    found = []
    for k, values in enumerate((x, y)):
        every = np.concatenate([values, MM * scenery.lines[..., k].ravel()])
        pad = PAD * np.ptp(every)
        found.append((float(every.min() - pad), float(every.max() + pad)))
    return found[0], found[1]


def _draw_margin(axes: Any, x: Array, y: Array, margin: Margin, values: Mapping[str, Any]) -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    largest = float(np.nanmax(margin.values))
    levels = MaxNLocator(LEVELS, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, largest)
    colours = LinearSegmentedColormap.from_list('margin', COLOURS)
    filled = axes.contourf(x, y, margin.values, levels, cmap=colours)
    axes.contour(x, y, margin.values, levels, colors='white', linewidths=0.35, alpha=0.7)
    place = axes.inset_axes([1.03, 0.0, 0.03, 1.0])
    bar = axes.figure.colorbar(filled, cax=place)
    bar.set_label(margin.label)
    bar.outline.set_visible(False)
    for group, meaning, dashes in LIMITS:
        limit = values.get(f'{group}.{margin.key}')
        if limit and limit < largest:
            look = {'linestyles': dashes, 'linewidths': 1.0}
            axes.contour(x, y, margin.values, [limit], colors=[DARK], **look)
            axes.plot([], [], color=DARK, ls=dashes, lw=1.0, label=meaning)
            place.axhline(limit, color=DARK, ls=dashes, lw=1.0)


def _draw_boundary(axes: Any, x: Array, y: Array, region: Region) -> None:
    """Cover what is beyond the travel, and draw where the region ends.

    Between poses inside and beyond the travel the boundary lies where no travel is left, else in
    the middle between those that are reached and those that are not.
    """
    from scipy.ndimage import gaussian_filter  # it takes long to load

    left = region.reach.travel_left
    step = 1.0
    if np.isfinite(left).any():
        step = np.nanmedian(np.abs(np.diff(np.where(np.isinf(left), np.nan, left))))
    level = np.where(np.isnan(left), -1.0, np.clip(left / step, -1.0, 1.0))
    level = gaussian_filter(level, SMOOTH, mode='nearest')
    axes.contourf(x, y, level, [-np.inf, 0.0], colors=[GROUND])
    axes.contour(x, y, level, [0.0], colors=[DARK], linewidths=1.4)


def _draw_inside(axes: Any, plane: Plane, scenery: Scenery) -> None:
    """Draw robot, motion and home."""
    from matplotlib.patheffects import Normal, Stroke

    for ends in scenery.lines:
        axes.plot(*(MM * ends.T), color=PALE, lw=3.0, alpha=0.6, solid_capstyle='round')
    path = MM * plane.coordinates(scenery.path)
    if np.ptp(path, axis=0).any():
        edge = [Stroke(linewidth=3.4, foreground='white'), Normal()]
        axes.plot(*path.T, color=DARK, lw=1.6, path_effects=edge, label='motion')
    pose, name, beside = path[0], 'start', ''
    if scenery.home is not None:
        pose, name = MM * plane.coordinates(scenery.home), 'home'
        beside = _beside(plane, scenery.home, scenery.coordinates)
    face = 'none' if beside else GOLD
    look = {'ls': '', 'marker': 'o', 'ms': 7, 'mfc': face, 'mec': DARK, 'mew': 1.2}
    axes.plot(*pose, **look, label=f'{name}{beside}')


def _beside(plane: Plane, pose: Array, coordinates: tuple[Coordinate, ...]) -> str:
    """How far a pose is from the plane, in words; nothing if it lies in it."""
    apart = [
        f'{axis.name} {value:+.3g} {axis.unit}'
        for axis, value in zip(coordinates, plane.beside(pose), strict=True)
        if abs(value) > LITTLE
    ]
    return f', from the plane {", ".join(apart)}' if apart else ''


def check_picture(path: Path) -> None:
    """Refuse a file that exists, cannot be made, or has another suffix.

    Raises:
        InputError: with the reason.
    """
    if path.suffix not in pictures.FORMATS:
        raise UnknownNameError('format of --workspace', path.suffix, pictures.FORMATS)
    output.check_new(path, '--workspace')


def write_picture(configuration: Configuration, path: Path) -> str:
    """Draw what the robot of a scenario reaches in the plane of its motion.

    Args:
        configuration: The scenario.
        path: A new file, see :func:`check_picture`.

    Returns:
        The region's extent and area, in a line.

    Raises:
        InputError: its pose has no place, or the robot does not reach the first one.
    """
    plane, scenery = plane_and_scenery(configuration)
    region = region_of(scenery.robot, plane)
    pictures.save(figure_of(region, scenery), path)
    return _described(region)


def _described(region: Region) -> str:
    ends = ', '.join(
        f'{axis.name} {low:.4g} to {high:.4g} m'
        for axis, (low, high) in zip(region.plane.axes, region.extent, strict=True)
    )
    more = '' if region.complete else '; it goes on beyond'
    return f'{ends}; area {region.area:.4g} m^2{more}'
