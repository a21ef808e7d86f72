"""Figures of a run."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot_analysis.metrics import Poses
from parallel_robot_bags import new_files
from parallel_robot_bags.printable_output import without_mathematics
from parallel_robot_bags.run_log import RunLog
from parallel_robot_base.errors import UnknownNameError
from parallel_robot_base.printable import printable

FORMATS = ('.png', '.pdf', '.svg')
LABEL = 40  # characters of a name
COLORS = ('#2952a3', '#d1495b', '#3a8f5c')


def draw_run(log: RunLog, pose: Poses, path: str | Path) -> None:
    """Draw path, errors and torques of a run to a PNG or vector file.

    Args:
        log: The run.
        pose: Its poses.
        path: File to write, which must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format.
        OSError: the file exists or cannot be written; with its name.
    """
    figure = _figure(f'{printable(log.scenario, LABEL)}, {printable(log.law, LABEL)}', path)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0))

    xy = figure.add_subplot(grid[:, 0])
    xy.plot(*(1e3 * pose.reference[:, :2].T), color='0.6', linewidth=2.5, label='reference')
    xy.plot(*(1e3 * pose.actual[:, :2].T), color=COLORS[0], linewidth=1.2, label='platform')
    xy.plot(*(1e3 * pose.actual[0, :2]), 'o', color=COLORS[1], label='start')
    xy.set(xlabel='x [mm]', ylabel='y [mm]', title='Path', aspect='equal')
    xy.margins(0.12)
    xy.legend(loc='upper right')

    error = 1e6 * np.abs((pose.actual - pose.reference)[:, :2])
    distance = figure.add_subplot(grid[0, 1])
    for axis, name, color in zip(error.T, 'xy', COLORS, strict=False):
        distance.semilogy(log.time, np.maximum(axis, 1e-4), color=color, lw=0.8, label=name)
    distance.set(ylabel='|error| [µm]', title='Platform error', ylim=(1e-3, None))

    joints = figure.add_subplot(grid[1, 1], sharex=distance)
    error = 1e6 * np.abs(log.reference_position - log.position)
    for column, name, color in zip(error.T, log.joints, COLORS, strict=True):
        joints.semilogy(
            log.time, np.maximum(column, 1e-4), color=color, lw=0.8, label=_label(name)
        )
    joints.set(ylabel='|error| [µrad]', title='Joint errors', ylim=(1e-3, None))

    torque = figure.add_subplot(grid[2, 1], sharex=distance)
    for column, name, color in zip(log.effort.T, log.joints, COLORS, strict=True):
        torque.plot(log.time, column, color=color, lw=0.8, label=_label(name))
    torque.set(xlabel='t [s]', ylabel='[N m]', title='Torques')

    for axes in (distance, joints, torque):
        axes.legend(loc='upper right', ncols=3, fontsize='small')
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    _save(figure, path)


def draw_torques(log: RunLog, torque: np.ndarray, law: str, path: str | Path) -> None:
    """Draw recorded commands and other torques for the same states, joint by joint.

    Args:
        log: The run.
        torque: The other torques [N m], shape (N, n).
        law: What they are of.
        path: File to write, which must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format.
        OSError: the file exists or cannot be written; with its name.
    """
    figure = _figure(f'{printable(log.scenario, LABEL)}: torques on the same motion', path)
    rows = figure.subplots(len(log.joints), 1, sharex=True)
    curves = zip(rows, log.joints, log.answer.T, torque.T, strict=True)
    for axes, joint, recorded, replayed in curves:
        label = f'recorded, {_label(log.law)}'
        axes.plot(log.time, recorded, color='0.6', lw=2.0, label=label)
        label = f'replayed, {_label(law)}'
        axes.plot(log.time, replayed, color=COLORS[0], lw=0.8, label=label)
        axes.set(ylabel='[N m]', title=_label(joint))
        axes.grid(alpha=0.3)
    rows[0].legend(loc='upper right', ncols=2, fontsize='small')
    rows[-1].set(xlabel='t [s]')
    _save(figure, path)


def _label(name: str) -> str:
    """A name in a picture, where a long one would leave no place for the curves."""
    return without_mathematics(printable(name, LABEL))


def _save(figure: Any, path: str | Path) -> None:
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


def _figure(title: str, path: str | Path) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import: only when drawn
    from matplotlib.figure import Figure

    check_format(path)
    figure = Figure(figsize=(11.0, 6.6), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(without_mathematics(title), fontweight='bold')
    return figure
