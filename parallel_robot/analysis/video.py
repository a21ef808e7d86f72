"""The frames of a video: what is shown of each run, and how it is drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import distances
from parallel_robot.analysis.pictures import STYLES, look_of
from parallel_robot.analysis.report.looks import label, oblique
from parallel_robot.analysis.report.page import box
from parallel_robot.analysis.report.report_files import RC
from parallel_robot.analysis.report.runs import Run
from parallel_robot.bags.output import without_mathematics
from parallel_robot.bags.run import recorded_robot
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.common.units import all_of
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.motions import Motion, Poses

# What a video shows of a run at each of its frames, as numbers.

MOST = 4  # runs side by side
SMALLEST = 1e-3  # m, size of a path
SEEN = 0.08  # of the path's size: the largest error of the second half, magnified


class Scene(NamedTuple):
    """One run as a video shows it; what is in space is seen obliquely."""

    run: Run
    now: Motion  # its samples at the frames, shape (F, ...)
    rows: np.ndarray  # row of its motion at each frame, shape (F,)
    path_rows: np.ndarray  # row of its path at each frame, shape (F,)
    # name of each part of the robot to the ends of its lines [m], shape (F, L, 2, 2)
    parts: dict[str, np.ndarray]
    # desired path of the end effector [m], NaN where it is left out, shape (P, 2)
    reference: np.ndarray
    actual: np.ndarray  # its path [m], likewise, shape (P, 2)
    path: np.ndarray  # its path with magnified errors [m], likewise, shape (P, 2)
    error: np.ndarray  # distances from the reference [m], shape (N,)


def frame_times(runs: Sequence[Run], rate: float, speed: float, most: int) -> np.ndarray:
    """Times of the frames, from the first run's begin to the last one's end [s], shape (F,).

    Args:
        runs: The runs.
        rate: Frames of a second of the video [Hz].
        speed: Seconds of the motion in a second of the video.
        most: How many they may be.

    Raises:
        InputError: they are more.
    """
    begin = max(0.0, min(float(run.motion.time[0]) for run in runs))
    end = max(float(run.motion.time[-1]) for run in runs)
    count = int((end - begin) * rate / speed) + 1
    if count > most:
        raise InputError(
            f'{end - begin:g} s of motion are {count} frames, more than {most} of such a file; '
            'raise --speed or lower --rate'
        )
    return np.minimum(begin + np.arange(count) * speed / rate, end)


def magnification(runs: Sequence[Run]) -> float:
    """How much to magnify the errors of all runs alike: 1, 2 or 5 times a power of ten.

    The largest of the second half of all runs then takes a small part of the picture. Not at all
    where one has no distance.
    """
    poses = [run.motion.poses for run in runs]
    if len({pose.place for pose in poses}) > 1 or not poses[0].place:
        return 1.0
    largest = max(float(distances(pose)[len(pose.actual) // 2 :].max()) for pose in poses)
    places = np.concatenate([pose.reference[:, : pose.place] for pose in poses])
    size = max(float(np.ptp(places, axis=0).max()), SMALLEST)
    return max(1.0, _round_below(SEEN * size / largest)) if largest > 0.0 else 1.0


def scene(run: Run, times: np.ndarray, magnified: float) -> Scene:
    """What a video shows of a run; one that is shorter stays at its end.

    Args:
        run: The run.
        times: Of the frames [s], shape (F,).
        magnified: By how much its errors are magnified.

    Raises:
        BagError: its robot is not known here.
        InputError: its pose is not a place.
    """
    unknown = recorded_robot.unknown(run.log.config)
    if unknown:
        raise BagError(f'{run.bag}: {unknown}')
    if not run.motion.poses.place:
        raise InputError(
            f'{run.bag}: the pose of its robot is not a place; there is no video of it'
        )
    now, robot = run.at(times), robot_of(run.log.config)
    parts = robot.module.segments(robot.parameters, now.poses.actual, now.position)
    rows, path_rows = (
        np.searchsorted(each.time, now.time, side='right') - 1 for each in (run.motion, run.path)
    )
    poses = run.path.poses
    if poses.in_space:
        parts = {part: oblique(ends) for part, ends in parts.items()}
    reference, actual, path = (enlarged(poses, factor) for factor in (0.0, 1.0, magnified))
    error = distances(run.motion.poses)
    return Scene(run, now, rows, path_rows, parts, reference, actual, path, error)


def enlarged(poses: Poses, magnified: float) -> np.ndarray:
    """Places of an end effector with magnified errors as a video shows them [m], shape (N, 2)."""
    reference = poses.reference[:, : poses.place]
    places = np.asarray(reference + magnified * (poses.actual[:, : poses.place] - reference))
    return oblique(places) if poses.in_space else places


def _round_below(value: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(digit * power for digit in (1.0, 2.0, 5.0) if digit * power <= value))


# The frames of a video: robot, path with magnified errors, error and torques of each run.

DOTS = 100  # per inch
COLUMN, WIDEST = 4.0, 12.8  # in, of one run, of all
LARGE = 9.0  # in, the width of a single run
SQUARE, STRIP = 2.7, 1.15  # in, heights of a picture of the plane, of a curve
PARTS = {'proximal': ('#5b6675', 5.0), 'distal': ('#9aa4b1', 3.5), 'platform': ('#1d2126', 2.0)}
OTHER = ('#5b6675', 4.0)
LEAST = 1e-2  # µm, the smallest distance that is drawn
LOOK: dict[Any, Any] = {**RC, 'font.family': 'sans-serif', 'lines.solid_capstyle': 'round'}
CURVE = {'lw': 1.1, 'animated': True}
DOT = {'marker': 'o', 'ls': '', 'animated': True}


def frames(scenes: Sequence[Scene], times: np.ndarray, magnified: float) -> Iterator[np.ndarray]:
    """Draw the frames one after the other.

    Args:
        scenes: The runs, side by side.
        times: Of the frames [s], shape (F,).
        magnified: By how much errors are magnified; for the title.

    Yields:
        Red, green and blue of each dot, of type uint8, shape (height, width, 3), both even.
    """
    import matplotlib as mpl  # slow to import: only when drawn
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    with mpl.rc_context(LOOK):
        layout = ConstrainedLayoutEngine(w_pad=0.08, h_pad=0.08)
        figure = Figure(figsize=size(len(scenes)), dpi=DOTS, layout=layout)
        canvas: Any = FigureCanvasAgg(figure)
        films = _films(figure, scenes, times, magnified)
        clock = figure.text(0.99, 0.985, '', ha='right', va='top', animated=True)
        canvas.draw()  # what stands still
        still = canvas.copy_from_bbox(figure.bbox)
        for k, time in enumerate(times):
            canvas.restore_region(still)
            clock.set_text(f't = {time:.2f} s')
            figure.draw_artist(clock)
            for film in films:
                film.draw(k)
            yield np.array(canvas.buffer_rgba())[:, :, :3]


def size(runs: int) -> tuple[float, float]:
    """Width and height of a video of some runs side by side [in], of an even number of dots."""
    if runs == 1:
        return LARGE, SQUARE + 2.0 * STRIP
    return min(COLUMN * runs, WIDEST), 2.0 * SQUARE + 2.0 * STRIP


def _films(
    figure: Any, scenes: Sequence[Scene], times: np.ndarray, magnified: float
) -> list[_Film]:
    """The panels: one run fills the figure, several have a column each with common scales."""
    if len(scenes) == 1:
        grid = figure.add_gridspec(2, 2, height_ratios=(SQUARE, 1.7 * STRIP))
        panels = [[figure.add_subplot(grid[k]) for k in range(4)]]
    else:
        ratios = (SQUARE, SQUARE, STRIP, STRIP)
        rows = figure.subplots(4, len(scenes), sharey='row', height_ratios=ratios, squeeze=False)
        panels = list(rows.T)
    films = [
        _Film(axes, scene, times, magnified) for axes, scene in zip(panels, scenes, strict=True)
    ]
    whole = [scene.parts[part].reshape(-1, 2) for scene in scenes for part in scene.parts]
    paths = np.concatenate([enlarged(scene.run.motion.poses, 0.0) for scene in scenes])
    most = max(1e6 * float(scene.error.max()) for scene in scenes)
    least = min(1e6 * float(np.percentile(scene.error, 1)) for scene in scenes)
    for robot, path, error, _ in panels:
        _square(robot, np.concatenate([*whole, paths]), 0.05)
        _square(path, paths, 0.3)
        error.set_ylim(max(LEAST, 0.5 * least), max(10.0 * LEAST, 2.0 * most))
    units = all_of(scene.run.motion.poses.units for scene in scenes)
    for axes, name in zip(
        panels[0][2:], ('|error| [µm]', units.label('torque [N m]')), strict=True
    ):
        axes.set_ylabel(name)
    return films


class _Film:
    """The panels of one run, and what moves in them."""

    def __init__(
        self, panels: Sequence[Any], scene: Scene, times: np.ndarray, magnified: float
    ) -> None:
        robot, path, error, torque = panels
        run = scene.run
        name = without_mathematics(run.label)
        style = STYLES[run.style].light
        faint = {'color': STYLES['reference'].light, 'lw': 2.5}
        for axes in (robot, path):
            axes.plot(*scene.reference.T, **faint)
            axes.axis('off')
        robot.set_title(f'{without_mathematics(label(run.log.scenario))}, {name}')
        path.set_title(f'path, errors times {magnified:g}' if magnified != 1.0 else 'path')
        error.set_yscale('log')
        for axes in (error, torque):
            if len(times) > 1:
                axes.set_xlim(times[0], times[-1])
            axes.set_xlabel('t [s]')
        self._scene = scene
        self._curves: list[tuple[Any, Any, Any, np.ndarray, np.ndarray, np.ndarray]] = []
        now, poses = scene.now, scene.now.poses
        ends = enlarged(poses, magnified)
        self._add(path, scene.path.T, scene.path_rows, ends.T, {'color': style})
        distance, last = (
            np.maximum(1e6 * each, LEAST) for each in (scene.error, distances(poses))
        )
        self._add_over_time(error, distance, last, {'color': style})
        looks = [look_of(k) for k in range(now.effort.shape[1])]
        for torques, end, look in zip(run.motion.effort.T, now.effort.T, looks, strict=True):
            torque.plot(run.motion.time, torques, alpha=0.0)  # for the scale
            self._add_over_time(torque, torques, end, look, 3.0)
        self._links = []
        for part, lines_of in scene.parts.items():
            colour, width = PARTS.get(part, OTHER)
            look = {'color': colour, 'lw': width, 'mec': 'white', 'marker': 'o', 'ms': width}
            lines = [
                robot.plot([], [], **look, animated=True)[0] for _ in range(lines_of.shape[1])
            ]
            self._links.append((robot, lines, lines_of))
        last = enlarged(poses, 1.0)
        self._add(robot, scene.actual.T, scene.path_rows, last.T, {'color': style})

    def _add_over_time(
        self,
        axes: Any,
        values: np.ndarray,
        last: np.ndarray,
        look: dict[str, Any],
        dot: float = 5.0,
    ) -> None:
        """Add a curve over time, shape (N,); `last`: its values at the frames, shape (F,)."""
        scene = self._scene
        points, ends = np.stack([scene.run.motion.time, values]), np.stack([scene.now.time, last])
        self._add(axes, points, scene.rows, ends, look, dot)

    def _add(
        self,
        axes: Any,
        points: np.ndarray,
        rows: np.ndarray,
        ends: np.ndarray,
        look: dict[str, Any],
        dot: float = 5.0,
    ) -> None:
        """Add a curve that grows with the frames, with a dot at its end.

        Args:
            axes: Its panel.
            points: The curve, shape (2, N).
            rows: Its last point at each frame, shape (F,).
            ends: Where the dot is at each frame, shape (2, F).
            look: Of the line.
            dot: Size of the dot.
        """
        (line,) = axes.plot([], [], **{**look, **CURVE})
        (end,) = axes.plot([], [], color=look['color'], ms=dot, **DOT)
        self._curves.append((axes, line, end, points, rows, ends))

    def draw(self, frame: int) -> None:
        """Draw what moves, at a frame."""
        for axes, lines, ends in self._links:
            for line, (x, y) in zip(lines, ends[frame].transpose(0, 2, 1), strict=True):
                line.set_data(x, y)
                axes.draw_artist(line)
        for axes, line, dot, points, rows, ends in self._curves:
            line.set_data(points[:, : rows[frame] + 1])
            dot.set_data(ends[:, frame : frame + 1])
            axes.draw_artist(line)
            axes.draw_artist(dot)


def _square(axes: Any, points: np.ndarray, margin: float) -> None:
    """Show points, shape (N, 2), with a margin, in equal scales."""
    x, y, width, height = box(points, margin)
    axes.set(xlim=(x, x + width), ylim=(y, y + height), aspect='equal')
