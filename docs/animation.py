"""Draw the moving robot of the README.

Usage: python docs/animation.py docs/images/moving_robot.gif
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from parallel_robot_analysis.metrics import distances
from parallel_robot_analysis.report.animation import Postures, box, postures
from parallel_robot_analysis.report.palette import STYLES
from parallel_robot_analysis.report.paper_figures import RC
from parallel_robot_analysis.report.runs import Run, read_runs
from parallel_robot_sim import simulate
from parallel_robot_studies.notebook import save

SCENARIO = 'paper_circle'
LAWS = ('smc', 's_smc', 'nftsmc', 's_fotsmc')  # the paper's; the robot is drawn under the last
DURATION = 6.0  # s, once round the circle
RATE = 12.5  # Hz, of the frames
SIZE, DOTS = (8.2, 3.1), 100  # in, dots per inch
COLOURS = 128  # of all frames
PARTS = {'proximal': ('#5b6675', 5.0), 'distal': ('#9aa4b1', 3.5), 'platform': ('#1d2126', 2.0)}
LOOK: dict[Any, Any] = {**RC, 'font.family': 'sans-serif', 'lines.solid_capstyle': 'round'}

Show = Callable[[int], None]  # draws a frame


def record(folder: Path) -> list[Run]:
    """Run the laws into bags, and read them as a report does."""
    for law in LAWS:
        save(simulate(SCENARIO, law=law, duration=DURATION), folder / law)
    return read_runs([folder / law for law in LAWS])[SCENARIO]


def draw(runs: list[Run], file: Path) -> None:
    """Write robot, paths and errors of the runs as a moving picture."""
    moving = postures(runs, RATE)
    with mpl.rc_context(LOOK):
        figure = Figure(figsize=SIZE, dpi=DOTS, layout='constrained')
        canvas = FigureCanvasAgg(figure)
        left, middle, right = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.3))
        parts = (robot, left), (paths, middle), (errors, right)
        shows = [part(axes, moving, runs) for part, axes in parts]
        figure.legend(*right.get_legend_handles_labels(), loc='outside upper center', ncols=4)
        frames = []
        for frame in range(len(moving.time)):
            for show in shows:
                show(frame)
            canvas.draw()
            frames.append(Image.fromarray(np.array(canvas.buffer_rgba())).convert('RGB'))
    colours = frames[-1].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    first, *others = (one.quantize(palette=colours, dither=Image.Dither.NONE) for one in frames)
    first.save(file, save_all=True, append_images=others, duration=1e3 / RATE, loop=0)


def robot(axes: Any, moving: Postures, runs: list[Run]) -> Show:
    """The robot under the last of the laws, its end effector on its path."""
    frames = moving.frames[-1]
    axes.plot(*frames[:, :2].T, color=STYLES['reference'].light, lw=2.0)
    lines, start = [], 4
    for part, count in moving.parts:
        colour, width = PARTS[part]
        for first in range(start, start + 4 * count, 4):
            (line,) = axes.plot([], [], color=colour, lw=width, marker='o', ms=width, mec='white')
            lines.append((line, frames[:, first : first + 4]))
        start += 4 * count
    axes.set_title('the robot')
    square(axes, frames.reshape(-1, 2), 0.06)
    axes.axis('off')
    effector = growing(axes, runs[-1:], moving, [runs[-1].poses.actual[:, :2].T])

    def show(frame: int) -> None:
        effector(frame)
        for line, ends in lines:
            line.set_data(ends[frame, ::2], ends[frame, 1::2])

    return show


def paths(axes: Any, moving: Postures, runs: list[Run]) -> Show:
    """The paths of the end effector under all laws."""
    axes.plot(*moving.frames[0][:, :2].T, color=STYLES['reference'].light, lw=3.0)
    axes.set_title('path of its end effector')
    square(axes, np.concatenate(moving.frames)[:, :4].reshape(-1, 2), 0.06)
    axes.axis('off')
    return growing(axes, runs, moving, [run.poses.actual[:, :2].T for run in runs])


def errors(axes: Any, moving: Postures, runs: list[Run]) -> Show:
    """The distances of the end effector from the reference under all laws."""
    axes.set_yscale('log')
    axes.set(xlim=(0.0, DURATION), ylim=(1e-1, 2e4), xlabel='t [s]')
    axes.set_title('its distance from the reference [µm]')
    points = [np.stack([run.log.time, 1e6 * distances(run.poses)]) for run in runs]
    return growing(axes, runs, moving, points)


def growing(axes: Any, runs: list[Run], moving: Postures, points: list[np.ndarray]) -> Show:
    """Curves of the runs, each shape (2, N), up to the time of the frame, with a dot there."""
    drawn = []
    for run, xy in zip(runs, points, strict=True):
        colour = STYLES[run.style].light
        (line,) = axes.plot([], [], color=colour, lw=1.3, label=run.label)
        (dot,) = axes.plot([], [], 'o', color=colour, ms=4, clip_on=False)
        drawn.append((line, dot, xy, np.searchsorted(run.log.time, moving.time)))

    def show(frame: int) -> None:
        for line, dot, xy, rows in drawn:
            end = rows[frame] + 1
            line.set_data(xy[:, :end])
            dot.set_data(xy[:, end - 1 : end])

    return show


def square(axes: Any, points: np.ndarray, margin: float) -> None:
    """Show points, shape (N, 2), with a margin, in equal scales."""
    x, y, width, height = box(points, margin)
    axes.set(xlim=(x, x + width), ylim=(y, y + height), aspect='equal')


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as name:
        draw(record(Path(name)), Path(sys.argv[1]))
