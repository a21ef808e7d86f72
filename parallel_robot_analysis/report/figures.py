"""Figures of one run."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from parallel_robot_analysis.metrics import Motion, Poses
from parallel_robot_analysis.report.labels import joint_label, label, law_label
from parallel_robot_bags import new_files
from parallel_robot_bags.printable_output import without_mathematics
from parallel_robot_bags.run_log import RunLog
from parallel_robot_base.errors import UnknownNameError
from parallel_robot_control.coupling import synchronisation_error

FORMATS = ('.png', '.pdf', '.svg')
COLOURS = ('#2952a3', '#d1495b', '#3a8f5c', '#e09f3e', '#7d4f9e', '#3fa7bd')
DASHES = ('-', '--')  # of as many joints as there are colours each
HEIGHT, ROW = 6.6, 1.6  # in, of a figure, of one row of many


class NamedMotion(Motion, Protocol):
    """What is drawn of a run: a run log, or anything with these names and arrays."""

    @property
    def scenario(self) -> str:
        """Name of the scenario."""

    @property
    def law(self) -> str:
        """Name of the law."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the actuated joints."""


def draw_run(log: NamedMotion, pose: Poses, path: str | Path) -> None:
    """Draw path, errors and torques of a run to a PNG or vector file.

    Args:
        log: The run.
        pose: Poses of the run.
        path: File to write, which must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format.
        OSError: the file exists or cannot be written; with its name.
    """
    save(figure_of_run(log, pose), path)


def figure_of_run(log: NamedMotion, pose: Poses) -> Any:
    """Path, errors and torques of a run as a figure of matplotlib.

    A robot that does not move in a plane has no path; its synchronisation errors are drawn.

    Args:
        log: The run.
        pose: Poses of the run.
    """
    figure = _figure(f'{label(log.scenario)}, {law_label(log.law)}')
    names = [without_mathematics(joint_label(name)) for name in log.joints]
    error = log.reference_position - log.position
    if pose.planar:
        grid = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0))
        _draw_path(figure.add_subplot(grid[:, 0]), pose)
        first = figure.add_subplot(grid[0, 1])
        offset = (pose.actual - pose.reference)[:, :2]
        _draw_magnitude(first, log.time, 1e6 * offset, ['x', 'y'])
        first.set(ylabel='|error| [µm]', title='End-effector error')
    else:
        grid = figure.add_gridspec(3, 1)
        first = figure.add_subplot(grid[0, 0])
        _draw_magnitude(first, log.time, 1e6 * synchronisation_error(error), names)
        first.set(ylabel='|error| [µrad]', title='Synchronisation errors')

    joints = figure.add_subplot(grid[1, -1], sharex=first)
    _draw_magnitude(joints, log.time, 1e6 * error, names)
    joints.set(ylabel='|error| [µrad]', title='Joint errors')

    torque = figure.add_subplot(grid[2, -1], sharex=first)
    for k, name in enumerate(names):
        torque.plot(log.time, log.effort[:, k], **_look(k), label=name)
    torque.set(xlabel='t [s]', ylabel='[N m]', title='Torques')

    for axes in (first, joints, torque):
        axes.legend(loc='upper right', ncols=3, fontsize='small')
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    return figure


def draw_torques(log: RunLog, torque: np.ndarray, law: str, path: str | Path) -> None:
    """Draw recorded commands and other torques for the same states, joint by joint.

    Args:
        log: The run.
        torque: The other torques [N m], shape (N, n).
        law: Law of the other torques.
        path: File to write, which must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format.
        OSError: the file exists or cannot be written; with its name.
    """
    count = len(log.joints)
    title = f'{label(log.scenario)}: torques on the same motion'
    figure = _figure(title, max(HEIGHT, ROW * count))
    rows = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    curves = zip(rows, log.joints, log.answer.T, torque.T, strict=True)
    for axes, joint, recorded, replayed in curves:
        name = f'recorded, {without_mathematics(law_label(log.law))}'
        axes.plot(log.time, recorded, color='0.6', lw=2.0, label=name)
        name = f'replayed, {without_mathematics(law_label(law))}'
        axes.plot(log.time, replayed, color=COLOURS[0], lw=0.8, label=name)
        axes.set(ylabel='[N m]', title=without_mathematics(joint_label(joint)))
        axes.grid(alpha=0.3)
    rows[0].legend(loc='upper right', ncols=2, fontsize='small')
    rows[-1].set(xlabel='t [s]')
    save(figure, path)


def draw_prediction(
    time: np.ndarray,
    joints: Sequence[str],
    measured: np.ndarray,
    predicted: np.ndarray,
    path: str | Path,
) -> None:
    """Draw measured and predicted torques, joint by joint.

    Args:
        time: Times [s], shape (T,).
        joints: Names of the joints.
        measured: Measured torques [N m], shape (T, n).
        predicted: Predicted torques [N m], shape (T, n).
        path: File to write, which must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format.
        OSError: the file exists or cannot be written; with its name.
    """
    count = len(joints)
    figure = _figure('Torques by the identified robot', max(HEIGHT, ROW * count))
    rows = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axes, joint, before, after in zip(rows, joints, measured.T, predicted.T, strict=True):
        axes.plot(time, before, color='0.6', lw=2.0, label='measured')
        axes.plot(time, after, color=COLOURS[0], lw=0.8, label='predicted')
        axes.plot(time, before - after, color=COLOURS[1], lw=0.8, label='difference')
        axes.set(ylabel='[N m]', title=without_mathematics(joint_label(joint)))
        axes.grid(alpha=0.3)
    rows[0].legend(loc='upper right', ncols=3, fontsize='small')
    rows[-1].set(xlabel='t [s]')
    save(figure, path)


def _draw_path(axes: Any, pose: Poses) -> None:
    axes.plot(*(1e3 * pose.reference[:, :2].T), color='0.6', linewidth=2.5, label='reference')
    axes.plot(*(1e3 * pose.actual[:, :2].T), color=COLOURS[0], lw=1.2, label='end effector')
    axes.plot(*(1e3 * pose.actual[0, :2]), 'o', color=COLOURS[1], label='start')
    axes.set(xlabel='x [mm]', ylabel='y [mm]', title='Path', aspect='equal')
    axes.margins(0.12)
    axes.legend(loc='upper right')


def _draw_magnitude(axes: Any, time: np.ndarray, errors: np.ndarray, names: list[str]) -> None:
    """Draw the magnitude of errors, shape (N, columns), on a logarithmic axis."""
    for k, name in enumerate(names):
        axes.semilogy(time, np.maximum(np.abs(errors[:, k]), 1e-4), **_look(k), label=name)
    axes.set_ylim(1e-3, None)


def _look(column: int) -> dict[str, Any]:
    """Colour and dashes of one of several curves, by its 0-based index."""
    dashes = DASHES[column // len(COLOURS) % len(DASHES)]
    return {'color': COLOURS[column % len(COLOURS)], 'linestyle': dashes, 'lw': 0.8}


def save(figure: Any, path: str | Path) -> None:
    """Write a figure to a file that must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format.
        OSError: the file exists or cannot be written; with its name.
    """
    check_format(path)
    content = io.BytesIO()
    figure.savefig(content, format=Path(path).suffix[1:], dpi=130)
    new_files.write(Path(path), content.getbuffer())


def check_format(path: str | Path) -> None:
    """Refuse a file whose suffix is of no picture format.

    Raises:
        UnknownNameError: with the formats.
    """
    suffix = Path(path).suffix
    if suffix not in FORMATS:
        raise UnknownNameError('picture format', suffix, FORMATS)


def _figure(title: str, height: float = HEIGHT) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import: only when drawn
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, height), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(without_mathematics(title), fontweight='bold')
    return figure
