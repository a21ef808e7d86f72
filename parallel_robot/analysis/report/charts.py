"""The content of the paper's Figures 3 to 9 as curves, the same on paper and on the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import distances, rotation_errors
from parallel_robot.analysis.pictures import joint_style
from parallel_robot.analysis.report.looks import VIEWS, joint_label, logarithmic
from parallel_robot.analysis.report.runs import Run
from parallel_robot.analysis.thinned import FIRST, Series, extremes
from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_model.common.units import all_of

TIME = 't [s]'
PATH = 'Path of the end effector'
MOST = 12_000  # points of a path with gaps


class Curve(NamedTuple):
    """One curve, with as many points as can be seen."""

    label: str  # name in the legend
    style: str  # key of pictures.STYLES
    x: np.ndarray  # shape (N,)
    y: np.ndarray  # shape (N,)


class Panel(NamedTuple):
    """Curves over common axes."""

    title: str  # heading; may be empty
    quantity: str  # name of y
    unit: str  # unit of y
    curves: list[Curve]
    # whether curves are dashed; a path that repeats itself would fill its own gaps
    dashed: bool = True
    marks: tuple[float, ...] = ()  # times at which law or gains of a run changed [s]
    x_label: str = ''  # label of its x axis where it is another than that of the chart


class Chart(NamedTuple):
    """One figure."""

    number: int  # number of the paper's figure with this content
    name: str  # name for the file
    title: str  # heading
    note: str  # remark for the caption; may be empty
    x_label: str  # label of the x axis of all panels
    panels: list[Panel]  # panels, row by row
    widths: tuple[float, ...] = (1.0,)  # widths of the columns of panels, relative to each other
    magnitude: bool = False  # whether the curves are errors, which may be drawn as magnitudes
    equal: bool = False  # whether both axes have the same scale
    # whether the columns show different times; then the panels of a column have the same
    # limits, otherwise all panels have the same time
    spans: bool = False
    of_paper: bool = True  # whether the paper has a figure with this content, or one in its place

    def logarithmic(self, scale: str) -> bool:
        """Whether its errors are drawn as magnitudes, see :func:`looks.logarithmic`."""
        curves = [curve.y for panel in self.panels for curve in panel.curves]
        return self.magnitude and logarithmic(scale, curves)


def charts(runs: Sequence[Run]) -> list[Chart]:
    """Charts of the runs of one scenario, numbered as the paper's figures.

    Those of the path and of its errors are left out for a robot whose pose is not a place. In
    space, the path has three views, and the error is a distance, and an angle where the end
    effector turns.
    """
    errors = [_joint_errors(runs), _coupling_errors(runs)]
    place = place_of(runs)
    if not place:
        return [*(_marked(chart, runs) for chart in errors), _torques(runs)]
    if place == len('xyz'):
        errors = [*_errors_in_space(runs), *errors]
        path = _views(runs)
    else:
        x, y = runs[0].motion.poses.axes[:2]
        errors = [_path_error(runs, 4, 0, x), _path_error(runs, 5, 1, y), *errors]
        path = _path(runs)
    return [path, *(_marked(chart, runs) for chart in errors), _torques(runs)]


def place_of(runs: Sequence[Run]) -> int:
    """Number of the coordinates of a place that the poses of all runs have; 0 if they differ."""
    found = {run.motion.poses.axes[: run.motion.poses.place] for run in runs}
    return len(found.pop()) if len(found) == 1 else 0


def _marked(chart: Chart, runs: Sequence[Run]) -> Chart:
    """A chart over time with the marks of all runs."""
    marks = tuple(sorted({time for run in runs for time in run.marks}))
    return chart._replace(panels=[panel._replace(marks=marks) for panel in chart.panels])


def joint_error(run: Run) -> np.ndarray:
    """Errors reference - feedback [rad], shape (N, n)."""
    return run.motion.reference_position - run.motion.position


def _path(runs: Sequence[Run]) -> Chart:
    starts = np.unique([1e3 * run.motion.poses.actual[0, :2] for run in runs], axis=0)
    start = Curve('start', 'start', *starts.T)
    whole, (x, y) = [*_tracks(runs, np.inf), start], runs[0].motion.poses.axes[:2]
    panels = [Panel('', y, 'mm', whole, dashed=False)]
    if min(run.motion.time[-1] for run in runs) > 2.0 * FIRST:
        panels.append(Panel('first second', y, 'mm', [*_tracks(runs, FIRST), start]))
    widths = (1.0,) * len(panels)
    return Chart(_number(runs), 'path', PATH, '', f'{x} [mm]', panels, widths, equal=True)


def _views(runs: Sequence[Run]) -> Chart:
    panels = []
    for across, up, shown in VIEWS:
        starts = np.unique([1e3 * run.motion.poses.actual[0, shown] for run in runs], axis=0)
        curves = [*_tracks(runs, np.inf, shown), Curve('start', 'start', *starts.T)]
        panel = Panel(f'{across}, {up}', up, 'mm', curves, dashed=False)
        panels.append(panel._replace(x_label=f'{across} [mm]'))
    widths = (1.0,) * len(panels)
    return Chart(_number(runs), 'path', PATH, '', '', panels, widths, equal=True)


def _number(runs: Sequence[Run]) -> int:
    line = {run.log.config.get('trajectory.shape') for run in runs} == {'line'}
    return 9 if line else 3


def _tracks(runs: Sequence[Run], until: float, shown: tuple[int, int] = (0, 1)) -> list[Curve]:
    """Paths of references and end effectors, with the points where the errors are extreme."""
    references, paths = [], []
    for run in runs:
        time, poses = run.path
        rows = time <= until
        reference = 1e3 * poses.reference[rows][:, shown]
        actual = 1e3 * poses.actual[rows][:, shown]
        chosen = _corners(reference)
        references.append(Curve('reference', 'reference', *reference[chosen].T))
        chosen = _corners(reference - actual)
        paths.append(Curve(run.label, run.style, *actual[chosen].T))
    return references + paths


def _corners(points: np.ndarray) -> np.ndarray:
    """Rows of a line, shape (N, 2), at which it turns; of one with gaps, some, and the gaps."""
    gaps = np.flatnonzero(np.isnan(points[:, 0]))
    if gaps.size:
        return np.union1d(gaps, np.arange(0, len(points), -(-len(points) // MOST)))
    return np.union1d(*(extremes(column) for column in points.T))


def _path_error(runs: Sequence[Run], number: int, axis: int, name: str) -> Chart:
    poses = [run.motion.poses for run in runs]
    series = [
        Series(run.motion.time, 1e3 * (pose.reference - pose.actual)[:, axis : axis + 1])
        for run, pose in zip(runs, poses, strict=True)
    ]
    title = f'Error of the end effector in {name}'
    panel = Panel('', f'{name} error', 'mm', _curves(runs, series, 0))
    return Chart(number, f'{name}_error', title, '', TIME, [panel], magnitude=True)


def _errors_in_space(runs: Sequence[Run]) -> list[Chart]:
    poses = [run.motion.poses for run in runs]
    found = [
        ('place_error', 'Distance of the end effector from its reference', 'distance', 'mm',
         [1e3 * distances(pose) for pose in poses]),
    ]  # fmt: skip
    if all(pose.rotation_components for pose in poses):
        angles = [1e3 * rotation_errors(pose) for pose in poses]
        title = 'Angle of the end effector from its reference'
        found.append(('rotation_error', title, 'angle', 'mrad', angles))
    charts = []
    for number, (name, title, quantity, unit, columns) in enumerate(found, start=4):
        series = [
            Series(run.motion.time, values[:, np.newaxis])
            for run, values in zip(runs, columns, strict=True)
        ]
        panel = Panel('', quantity, unit, _curves(runs, series, 0))
        chart = Chart(number, name, title, '', TIME, [panel], magnitude=True)
        charts.append(chart._replace(of_paper=False))
    return charts


def _joint_errors(runs: Sequence[Run]) -> Chart:
    series = [Series(run.motion.time, 1e3 * joint_error(run)) for run in runs]
    panels = [
        Panel(name, 'error', _unit(runs, joint), _curves(runs, series, joint))
        for joint, name in enumerate(_joints(runs))
    ]
    return Chart(
        6, 'joint_errors', 'Errors of the actuated joints', '', TIME, panels, magnitude=True
    )


def _coupling_errors(runs: Sequence[Run]) -> Chart:
    synchronisation = [
        Series(run.motion.time, 1e3 * synchronisation_error(joint_error(run))) for run in runs
    ]
    with_coupling = [run for run in runs if run.cross_coupling is not None]
    coupling = [
        Series(run.cross_coupling.time, 1e3 * run.cross_coupling.values)
        for run in with_coupling
        if run.cross_coupling is not None
    ]
    panels = []
    for joint, name in enumerate(_joints(runs)):
        title, unit = f'{name}, ', _unit(runs, joint)
        curves = _curves(runs, synchronisation, joint)
        panels.append(Panel(title + 'synchronisation', 'error', unit, curves))
        if with_coupling:
            curves = _curves(with_coupling, coupling, joint)
            panels.append(Panel(title + 'cross-coupling', 'error', unit, curves))
    lacking = [run.label for run in runs if run.cross_coupling is None]
    note = f'No cross-coupling error is in the bag of {", ".join(lacking)}.' if lacking else ''
    title = 'Synchronisation and cross-coupling errors'
    widths = (1.0, 1.0) if with_coupling else (1.0,)
    return Chart(7, 'coupling_errors', title, note, TIME, panels, widths, magnitude=True)


def _torques(runs: Sequence[Run]) -> Chart:
    split = min(run.motion.time[-1] for run in runs) > 2.0 * FIRST
    panels = []
    for run in runs:
        units = run.motion.poses.units
        first = run.motion.time <= (FIRST if split else np.inf)
        parts = [('', first), (' afterwards', ~first)] if split else [('', first)]
        for when, rows in parts:
            series = [Series(run.motion.time[rows], run.motion.effort[rows])]
            curves = []
            for joint, name in enumerate(_joints(runs)):
                (curve,) = _curves([run], series, joint)
                curves.append(curve._replace(label=name, style=joint_style(joint)))
            times = run.motion.time[rows]
            marks = tuple(time for time in run.marks if times[0] <= time <= times[-1])
            name = units.label('torque')
            panels.append(Panel(run.label + when, name, units.of('N m'), curves, marks=marks))
    widths = (1.0, 2.5) if split else (1.0,)
    title = all_of(run.motion.poses.units for run in runs).label('Torques of the motors')
    return Chart(8, 'torques', title, '', TIME, panels, widths, spans=True)


def _unit(runs: Sequence[Run], joint: int) -> str:
    """Unit of the errors of a joint, for which they are multiplied by 1000."""
    return all_of(run.motion.poses.units.one(joint) for run in runs).of('mrad')


def _curves(runs: Sequence[Run], series: Sequence[Series], column: int) -> list[Curve]:
    curves = []
    for run, (time, values) in zip(runs, series, strict=True):
        chosen = extremes(values[:, column])
        curves.append(Curve(run.label, run.style, time[chosen], values[chosen, column]))
    return curves


def _joints(runs: Sequence[Run]) -> list[str]:
    return [joint_label(name) for name in runs[0].log.joints]
