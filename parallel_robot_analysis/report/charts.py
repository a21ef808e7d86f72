"""What the paper's Figures 3 to 9 show, as curves: on paper and on the page the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_analysis.report.decimation import extremes
from parallel_robot_analysis.report.runs import Run, Series
from parallel_robot_control.coupling import synchronisation_error

TIME = 't [s]'
FIRST = 1.0  # s, in which the torques are far larger than after it


class Curve(NamedTuple):
    """One curve, with as many points as are worth drawing.

    Attributes:
        label: Name in the legend.
        style: Key of palette.STYLES.
        x: Shape (N,).
        y: Shape (N,).
    """

    label: str
    style: str
    x: np.ndarray
    y: np.ndarray


class Panel(NamedTuple):
    """Curves over common axes.

    Attributes:
        title: Heading; may be empty.
        quantity: What y is.
        unit: Of y.
        curves: The curves.
        dashed: Whether dashes tell the curves apart; the gaps of one that runs over itself close.
    """

    title: str
    quantity: str
    unit: str
    curves: list[Curve]
    dashed: bool = True


class Chart(NamedTuple):
    """One figure.

    Attributes:
        number: Of the paper's figure with this content.
        name: For the file.
        title: Heading.
        note: What else the reader must know; may be empty.
        x_label: Of all panels.
        panels: Row by row.
        widths: Of the columns of panels, relative to each other.
        magnitude: Whether the curves are errors that are worth a logarithmic axis too.
        equal: Whether both axes have the same scale.
        spans: Whether the columns show different times; then the panels of a column have the same
            limits, otherwise all panels have the same time.
    """

    number: int
    name: str
    title: str
    note: str
    x_label: str
    panels: list[Panel]
    widths: tuple[float, ...] = (1.0,)
    magnitude: bool = False
    equal: bool = False
    spans: bool = False


def charts(runs: Sequence[Run]) -> list[Chart]:
    """Charts of the runs of one scenario, numbered as the paper's figures."""
    return [
        _path(runs),
        _platform_error(runs, 4, 0, 'x'),
        _platform_error(runs, 5, 1, 'y'),
        _joint_errors(runs),
        _coupling_errors(runs),
        _torques(runs),
    ]


def joint_error(run: Run) -> np.ndarray:
    """Errors reference - feedback [rad], shape (N, n)."""
    return run.log.reference_position - run.log.position


def platform_error(run: Run) -> np.ndarray:
    """Errors reference - feedback of the platform [m, m, rad], shape (N, 3)."""
    return run.poses.reference - run.poses.actual


def _path(runs: Sequence[Run]) -> Chart:
    starts = np.unique([1e3 * run.poses.actual[0, :2] for run in runs], axis=0)
    start = Curve('start', 'start', *starts.T)
    whole = [*_tracks(runs, np.inf), start]
    panels = [Panel('', 'y', 'mm', whole, dashed=False)]
    if min(run.log.time[-1] for run in runs) > 2.0 * FIRST:
        panels.append(Panel('first second', 'y', 'mm', [*_tracks(runs, FIRST), start]))
    line = {run.log.config.get('trajectory.shape') for run in runs} == {'line'}
    widths = (1.0,) * len(panels)
    number = 9 if line else 3
    return Chart(number, 'path', 'Path of the platform', '', 'x [mm]', panels, widths, equal=True)


def _tracks(runs: Sequence[Run], until: float) -> list[Curve]:
    """Paths of references and platforms; the points with the extreme errors are among theirs."""
    references, platforms = [], []
    for run in runs:
        rows = run.log.time <= until
        reference = 1e3 * run.poses.reference[rows, :2]
        actual = 1e3 * run.poses.actual[rows, :2]
        chosen = np.union1d(*(extremes(column) for column in reference.T))
        references.append(Curve('reference', 'reference', *reference[chosen].T))
        chosen = np.union1d(*(extremes(column) for column in (reference - actual).T))
        platforms.append(Curve(run.label, run.style, *actual[chosen].T))
    return references + platforms


def _platform_error(runs: Sequence[Run], number: int, axis: int, name: str) -> Chart:
    series = [Series(run.log.time, 1e3 * platform_error(run)[:, axis, np.newaxis]) for run in runs]
    title = f'Error of the platform in {name}'
    panel = Panel('', f'{name} error', 'mm', _curves(runs, series, 0))
    return Chart(number, f'{name}_error', title, '', TIME, [panel], magnitude=True)


def _joint_errors(runs: Sequence[Run]) -> Chart:
    series = [Series(run.log.time, 1e3 * joint_error(run)) for run in runs]
    panels = [
        Panel(f'joint {joint + 1}', 'error', 'mrad', _curves(runs, series, joint))
        for joint in range(_joints(runs))
    ]
    return Chart(
        6, 'joint_errors', 'Errors of the actuated joints', '', TIME, panels, magnitude=True
    )


def _coupling_errors(runs: Sequence[Run]) -> Chart:
    synchronisation = [
        Series(run.log.time, 1e3 * synchronisation_error(joint_error(run))) for run in runs
    ]
    with_coupling = [run for run in runs if run.cross_coupling is not None]
    coupling = [
        Series(run.cross_coupling.time, 1e3 * run.cross_coupling.values)
        for run in with_coupling
        if run.cross_coupling is not None
    ]
    panels = []
    for joint in range(_joints(runs)):
        title = f'joint {joint + 1}, '
        curves = _curves(runs, synchronisation, joint)
        panels.append(Panel(title + 'synchronisation', 'error', 'mrad', curves))
        if with_coupling:
            curves = _curves(with_coupling, coupling, joint)
            panels.append(Panel(title + 'cross-coupling', 'error', 'mrad', curves))
    lacking = [run.label for run in runs if run.cross_coupling is None]
    note = f'No cross-coupling error is in the bag of {", ".join(lacking)}.' if lacking else ''
    title = 'Synchronisation and cross-coupling errors'
    widths = (1.0, 1.0) if with_coupling else (1.0,)
    return Chart(7, 'coupling_errors', title, note, TIME, panels, widths, magnitude=True)


def _torques(runs: Sequence[Run]) -> Chart:
    split = min(run.log.time[-1] for run in runs) > 2.0 * FIRST
    panels = []
    for run in runs:
        first = run.log.time <= (FIRST if split else np.inf)
        parts = [('', first), (' afterwards', ~first)] if split else [('', first)]
        for when, rows in parts:
            series = [Series(run.log.time[rows], run.log.effort[rows])]
            curves = []
            for joint in range(_joints(runs)):
                (curve,) = _curves([run], series, joint)
                curves.append(curve._replace(label=f'joint {joint + 1}', style=f'joint{joint}'))
            panels.append(Panel(run.label + when, 'torque', 'N m', curves))
    widths = (1.0, 2.5) if split else (1.0,)
    return Chart(8, 'torques', 'Torques of the motors', '', TIME, panels, widths, spans=True)


def _curves(runs: Sequence[Run], series: Sequence[Series], column: int) -> list[Curve]:
    curves = []
    for run, (time, values) in zip(runs, series, strict=True):
        chosen = extremes(values[:, column])
        curves.append(Curve(run.label, run.style, time[chosen], values[chosen, column]))
    return curves


def _joints(runs: Sequence[Run]) -> int:
    return len(runs[0].log.joints)
