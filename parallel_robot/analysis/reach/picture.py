"""A region as a picture: its margins, limits and boundary, home, motion and robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot.analysis.reach.plane import Axis, Plane
from parallel_robot.analysis.reach.region import Region
from parallel_robot.analysis.reach.scenery import Scenery
from parallel_robot.bags.output import without_mathematics
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import Coordinate, Margin

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
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import: only when drawn
    from matplotlib.figure import Figure

    margins = region.reach.margins or (None,)
    first, second = region.plane.axes
    x, y = _scale(first) * region.first, _scale(second) * region.second
    wide, high = _limits(x, y, scenery)
    equal = first.unit == second.unit
    shape = np.ptp(high) / np.ptp(wide) if equal else 0.8
    height = min(WIDTH * shape, HIGHEST)
    size = (len(margins) * (height / shape + BAR), height + TITLE)
    figure = Figure(size, layout='constrained')
    FigureCanvasAgg(figure)
    head, _, small = scenery.title.partition('\n')
    figure.suptitle(without_mathematics(head), fontweight='bold', fontsize=13)
    panels = figure.subplots(1, len(margins), squeeze=False, sharex=True, sharey=True)[0]
    for axes, margin in zip(panels, margins, strict=True):
        axes.set(xlabel=_named(first), xlim=wide, ylim=high)
        axes.set_aspect('equal' if equal else 'auto')
        axes.set_facecolor(GROUND)
        axes.spines[['top', 'right']].set_visible(False)
        if margin is None:
            axes.contourf(x, y, region.inside.astype(float), [0.5, 2.0], colors=[COLOURS[3]])
        else:
            _draw_margin(axes, x, y, margin, scenery.values)
        _draw_boundary(axes, x, y, region)
        _draw_inside(axes, region.plane, scenery)
    panels[0].set_ylabel(_named(second))
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

    left = region.reach.left
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

    scales = np.array([_scale(axis) for axis in plane.axes])
    for ends in scenery.lines:
        axes.plot(*(MM * ends.T), color=PALE, lw=3.0, alpha=0.6, solid_capstyle='round')
    path = scales * plane.coordinates(scenery.path)
    if np.ptp(path, axis=0).any():
        edge = [Stroke(linewidth=3.4, foreground='white'), Normal()]
        axes.plot(*path.T, color=DARK, lw=1.6, path_effects=edge, label='motion')
    pose, name, beside = path[0], 'start', ''
    if scenery.home is not None:
        pose, name = scales * plane.coordinates(scenery.home), 'home'
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


def _scale(axis: Axis) -> float:
    return MM if axis.unit == 'm' else 1.0


def _named(axis: Axis) -> str:
    return f'{axis.name} [{"mm" if axis.unit == "m" else axis.unit}]'
