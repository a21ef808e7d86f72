"""Figures of one run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from parallel_robot.analysis import pictures
from parallel_robot.analysis.metrics import distances, rotation_errors
from parallel_robot.analysis.pictures import COLOURS, look_of, run_look, save, slots
from parallel_robot.analysis.report.looks import (
    AUTO,
    add_lines,
    add_path,
    joint_label,
    label,
    law_label,
    logarithmic,
    posture,
    views,
)
from parallel_robot.bags.output import without_mathematics
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_model.common.units import HINGES, JointUnits, all_of
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.motions import Motion, Poses

if TYPE_CHECKING:
    from parallel_robot_sim.scenario_run import Run

LEAST = 1e-4  # µm and µrad, of magnitudes on a logarithmic axis, which begins ten times higher
LARGEST = 'Largest '  # of all joints
DISTANCE = 'distance'
COLUMNS, FEW = 6, 4  # of a legend, and names of which each has its line
NOT_IN_FOREIGN = 'none in a bag of somebody else; --figure FILE draws one'
BROAD = {'color': '0.6', 'lw': 2.0}  # of what is measured
HEIGHT, ROW = 6.6, 1.6  # in, of a figure, of one row of many
MARGINS = {'left': 0.075, 'right': 0.99, 'bottom': 0.085, 'top': 0.89, 'wspace': 0.22}


def draw_run(
    run: RunLog | Run,
    motion: Motion,
    path: str | Path,
    scale: str = AUTO,
    marks: Sequence[float] = (),
    track: Poses | None = None,
) -> None:
    """Draw path, errors and torques of a run to a PNG or vector file.

    Args:
        run: The run.
        motion: Its motion.
        path: File to write, which must not exist; its suffix chooses the format.
        scale: Of errors, see looks.SCALES.
        marks: Times at which something changed [s].
        track: Poses of its path; None: those of the motion.

    Raises:
        InputError: the suffix is of no picture format, or the file cannot be written.
    """
    save(figure_of_run(run, motion, scale, marks, track), path)


def figure_of_run(
    run: RunLog | Run,
    motion: Motion,
    scale: str = AUTO,
    marks: Sequence[float] = (),
    track: Poses | None = None,
) -> Any:
    """Path, errors and torques of a run as a figure of matplotlib.

    In space, the path is drawn in three views, with the robot at the start, and the error is a
    distance, and an angle where the end effector turns. A robot whose pose is not a place has no
    path; its synchronisation errors are drawn.

    Args:
        run: The run.
        motion: Its motion.
        scale: Of errors, see looks.SCALES.
        marks: Times at which something changed [s].
        track: Poses of its path; None: those of the motion.
    """
    pose, units = motion.poses, motion.poses.units
    figure, path, over_time = panels(
        f'{label(run.scenario)}, {law_label(run.law)}',
        pose.place,
        turns=bool(pose.rotation_components),
    )
    first, *turn, joints, torque = over_time
    names = [without_mathematics(joint_label(name)) for name in run.joints]
    looks = [look_of(k) for k in range(len(names))]
    error = motion.reference_position - motion.position
    if pose.in_space:
        _draw_robot(path, run, motion)
        _draw_paths(path, [track or pose], looks, 'end effector')
        curves = _curves(motion.time, 1e6 * distances(pose)[:, np.newaxis], looks, [DISTANCE])
        _draw_errors(first, curves, 'µm', scale, 'End-effector error', sign=False)
        for axes in turn:
            angle = 1e3 * rotation_errors(pose)[:, np.newaxis]
            curves = _curves(motion.time, angle, looks, ['angle'])
            _draw_errors(axes, curves, 'mrad', scale, 'End-effector rotation error', sign=False)
    elif pose.place:
        _draw_paths(path, [track or pose], looks, 'end effector')
        offset = (pose.reference - pose.actual)[:, :2]
        curves = _curves(motion.time, 1e6 * offset, looks, [*pose.axes])
        _draw_errors(first, curves, 'µm', scale, 'End-effector error')
    else:
        curves = _curves(motion.time, 1e6 * synchronisation_error(error), looks, names)
        _draw_errors(first, curves, units.of('µrad'), scale, 'Synchronisation errors')
    curves = _curves(motion.time, 1e6 * error, looks, names)
    _draw_errors(joints, curves, units.of('µrad'), scale, 'Joint errors')
    _draw_curves(torque, _curves(motion.time, motion.effort, looks, names))
    torque.set(xlabel='t [s]', ylabel=units.label('torque [N m]'))
    torque.set_title(units.label('Torques'), loc='left')
    for axes in over_time:
        for time in marks:
            axes.axvline(time, color='0.4', linestyle=':', lw=1.0)
        add_legend(axes)
    return figure


def figure_of_runs(runs: Mapping[str, tuple[RunLog | Run, Motion]], scale: str = AUTO) -> Any:
    """Several runs over one another as a figure of matplotlib, one curve each in a panel.

    Of the joints, the largest magnitude at each time is drawn. Without a path if the pose of a
    robot is not a place.

    Args:
        runs: Name to a run and its motion, up to as many as looks.RUNS.
        scale: Of errors, see looks.SCALES.
    """
    named, motions = zip(*runs.values(), strict=True)
    poses = [motion.poses for motion in motions]
    units = all_of(pose.units for pose in poses)
    small = units.of('µrad')
    same = len({pose.axes[: pose.place] for pose in poses}) == 1
    place = poses[0].place if same else 0
    turns = bool(place) and all(pose.rotation_components for pose in poses)
    title = ', '.join(dict.fromkeys(label(run.scenario) for run in named))
    figure, path, (first, *turn, joints, torque) = panels(title, place, fitted=True, turns=turns)
    names = [without_mathematics(label(name)) for name in runs]
    looks = [{**run_look(slot), 'lw': 1.0} for slot in slots([run.law for run in named])]

    def curves(columns: Iterable[np.ndarray]) -> list[Curve]:
        """One curve for each run: the largest magnitude of its columns, shape (N, k)."""
        return [
            Curve(motion.time, np.abs(values).max(axis=1), look, name)
            for motion, values, look, name in zip(motions, columns, looks, names, strict=True)
        ]

    errors = [1e6 * (motion.reference_position - motion.position) for motion in motions]
    if place == len('xyz'):
        _draw_robot(path, named[0], motions[0])
    if place:
        _draw_paths(path, poses, looks)
        distance = curves(1e6 * distances(pose)[:, np.newaxis] for pose in poses)
        _draw_errors(first, distance, 'µm', scale, 'End-effector error', sign=False)
        for axes in turn:
            angles = curves(1e3 * rotation_errors(pose)[:, np.newaxis] for pose in poses)
            _draw_errors(axes, angles, 'mrad', scale, 'End-effector rotation error', sign=False)
    else:
        synchronisation = curves(map(synchronisation_error, errors))
        _draw_errors(
            first, synchronisation, small, scale, LARGEST + 'synchronisation error', sign=False
        )
    _draw_errors(joints, curves(errors), small, scale, LARGEST + 'joint error', sign=False)
    _draw_curves(torque, curves(motion.effort for motion in motions))
    torque.set(xlabel='t [s]', ylabel=units.label('|torque| [N m]'))
    torque.set_title(units.label(f'{LARGEST}torque'), loc='left')
    figure.legend(*torque.get_legend_handles_labels(), loc='outside lower center', ncols=COLUMNS)
    return figure


def draw_torques(log: RunLog, torque: np.ndarray, law: str, path: str | Path) -> None:
    """Draw recorded commands and other torques for the same states, joint by joint.

    Args:
        log: The run.
        torque: The other torques [N m], shape (N, n).
        law: Law of the other torques.
        path: File to write, which must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format, or the file cannot be written.
    """
    recorded, replayed = (without_mathematics(law_label(each)) for each in (log.law, law))
    curves = {
        f'recorded, {recorded}': (log.answer, BROAD),
        f'replayed, {replayed}': (torque, {'color': COLOURS[0], 'lw': 0.8}),
    }
    title = f'{label(log.scenario)}: {log.units.label("torques")} on the same motion'
    save(_joint_by_joint(title, log.time, log.joints, curves, log.units), path)


def figure_of_prediction(
    time: np.ndarray,
    joints: Sequence[str],
    measured: np.ndarray,
    predicted: np.ndarray,
    units: JointUnits = HINGES,
    held_out: float | None = None,
) -> Any:
    """Measured and predicted torques, joint by joint, as a figure of matplotlib.

    Args:
        time: Times [s], shape (T,).
        joints: Names of the joints.
        measured: Measured torques [N m], shape (T, n).
        predicted: Predicted torques [N m], shape (T, n).
        units: Those of the joints.
        held_out: Time from which on they were not fitted [s]; None: none.
    """
    curves = {
        'measured': (measured, BROAD),
        'predicted': (predicted, {'color': COLOURS[0], 'lw': 0.8}),
        'difference': (measured - predicted, {'color': COLOURS[1], 'lw': 0.8}),
    }
    title = f'{units.label("Torques")} by the identified robot'
    shaded = None if held_out is None else (held_out, float(time[-1]))
    return _joint_by_joint(title, time, joints, curves, units, shaded)


def _joint_by_joint(
    title: str,
    time: np.ndarray,
    joints: Sequence[str],
    curves: Mapping[str, tuple[np.ndarray, dict[str, Any]]],
    units: JointUnits,
    held_out: tuple[float, float] | None = None,
) -> Any:
    """Torques [N m], name to values, shape (T, n), and look, one panel for each joint."""
    figure = _figure(title, max(HEIGHT, ROW * len(joints)))
    rows = figure.subplots(len(joints), 1, sharex=True, squeeze=False)[:, 0]
    for k, (axes, joint) in enumerate(zip(rows, joints, strict=True)):
        for name, (values, look) in curves.items():
            axes.plot(time, values[:, k], label=name, **look)
        if held_out:
            axes.axvspan(*held_out, color='0.93', zorder=0, label='held out')
        unit = units.one(k).label('[N m]')
        axes.set(ylabel=unit, title=without_mathematics(joint_label(joint)))
        axes.grid(alpha=0.3)
    rows[0].legend(loc='upper right', ncols=len(curves) + 1, fontsize='small')
    rows[-1].set(xlabel='t [s]')
    return figure


def draw_motion(
    time: np.ndarray,
    joints: Sequence[str],
    position: np.ndarray,
    torque: np.ndarray,
    path: str | Path,
    units: JointUnits = HINGES,
) -> None:
    """Draw the joints [rad] and torques [N m] of a motion without a reference, each shape (T, n).

    The others as of :func:`draw_run` and :func:`figure_of_prediction`.
    """
    figure = _figure('Motion without a reference', 2.0 * ROW)
    rows = figure.subplots(2, 1, sharex=True)
    labels = units.label('joints [rad]'), units.label('torques [N m]')
    for axes, values, name in zip(rows, (position, torque), labels, strict=True):
        for k, (joint, curve) in enumerate(zip(joints, values.T, strict=True)):
            axes.plot(time, curve, label=without_mathematics(joint_label(joint)), **look_of(k))
        axes.set(ylabel=name)
        axes.grid(alpha=0.3)
        add_legend(axes)
    rows[-1].set(xlabel='t [s]')
    save(figure, path)


class Curve(NamedTuple):
    """One curve: times, values, both shape (N,), arguments of its line, name."""

    time: np.ndarray
    values: np.ndarray
    look: dict[str, Any]
    name: str


def panels(
    title: str, place: int, fitted: bool = False, turns: bool = False
) -> tuple[Any, list[Any], list[Any]]:
    """A figure, the panels of the path, and three panels over time.

    Args:
        title: Of the figure.
        place: Number of the coordinates of a place: 2, there is one panel of the path; 3, there
            are three views of it; 0, there is none.
        fitted: Whether the panels leave the room that their surroundings need, a legend below
            for example. It takes as long as to draw the figure.
        turns: Whether there is one more panel over time, the second.
    """
    figure = _figure(title, fitted=fitted)
    rows = 4 if turns else 3
    margins = {} if fitted else {**MARGINS, 'hspace': 0.55 if turns else 0.4}
    columns = 2 if place else 1
    ratios = (1.1, 1.0)[-columns:]
    grid = figure.add_gridspec(rows, columns, width_ratios=ratios, **margins)
    path = []
    if place == len('xyz'):
        path = views(figure, grid[:, 0])
    elif place:
        path = [figure.add_subplot(grid[:, 0])]
    first = figure.add_subplot(grid[0, -1])
    others = [figure.add_subplot(grid[k, -1], sharex=first) for k in range(1, rows)]
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    return figure, path, [first, *others]


def _curves(
    time: np.ndarray, values: np.ndarray, looks: list[dict[str, Any]], names: list[str]
) -> list[Curve]:
    """One curve for each column of the values, shape (N, k)."""
    return [Curve(time, *one) for one in zip(values.T, looks, names, strict=False)]


def _draw_robot(panels: Sequence[Any], run: RunLog | Run, motion: Motion) -> None:
    """Draw the robot in space where a motion begins."""
    lines = posture(robot_of(run.values), motion.poses.actual[0], motion.position[0])
    add_lines(panels, lines, color='0.8', lw=1.5)


def _draw_paths(
    panels: Sequence[Any], poses: Sequence[Poses], looks: list[dict[str, Any]], name: str = ''
) -> None:
    space = poses[0].in_space

    def draw(points: np.ndarray, **look: Any) -> None:
        if space:
            add_path(panels, points, **look)
        else:
            panels[0].plot(*(1e3 * points[:, :2].T), **look)

    for k, pose in enumerate(poses):
        draw(pose.reference, color='0.6', linewidth=2.5, label='' if k else 'reference')
    for pose, look in zip(poses, looks, strict=False):
        draw(pose.actual, **{**look, 'lw': 1.2}, label=name)
    starts = np.unique([pose.actual[0, : 3 if space else 2] for pose in poses], axis=0)
    size = {'ms': 4} if space else {}
    draw(starts, color=COLOURS[1], marker='o', linestyle='', label='start', **size)
    panels[0].set_title('Path')
    if space:
        handles = panels[-1].get_legend_handles_labels()
        side = {'loc': 'center left', 'bbox_to_anchor': (1.25, 0.5), 'frameon': False}
        panels[-1].legend(*handles, **side)
        return
    x, y = (f'{axis} [mm]' for axis in poses[0].axes[:2])
    panels[0].set(xlabel=x, ylabel=y, aspect='equal')
    panels[0].margins(0.12)
    panels[0].legend(loc='upper right')


def _draw_errors(
    axes: Any, curves: list[Curve], unit: str, scale: str, title: str, sign: bool = True
) -> None:
    """Draw errors, with their sign unless the axis is logarithmic or they have none."""
    log = logarithmic(scale, [curve.values for curve in curves])
    if log:
        curves = [c._replace(values=np.maximum(np.abs(c.values), LEAST)) for c in curves]
    _draw_curves(axes, curves)
    if log:
        axes.set_yscale('log')
        axes.set_ylim(max(axes.get_ylim()[0], 10 * LEAST), None)
    axes.set_ylabel(f'|error| [{unit}]' if log or not sign else f'error [{unit}]')
    axes.set_title(title, loc='left')


def _draw_curves(axes: Any, curves: list[Curve]) -> None:
    for curve in curves:
        axes.plot(curve.time, curve.values, **curve.look, label=curve.name)


def add_legend(axes: Any) -> None:
    """Add a legend above the curves, beside the title; many names have colours, not lines."""
    many = FEW < len(axes.get_legend_handles_labels()[0]) <= len(COLOURS)
    narrow = {'handlelength': 0.0, 'handletextpad': 0.0, 'labelcolor': 'linecolor'} if many else {}
    axes.legend(
        loc='lower right',
        bbox_to_anchor=(1.0, 1.0),
        borderpad=0.2,
        columnspacing=1.2,
        fontsize='small',
        frameon=False,
        ncols=COLUMNS,
        **{'handlelength': 1.6, 'handletextpad': 0.5, **narrow},
    )


def _figure(title: str, height: float = HEIGHT, fitted: bool = True) -> Any:
    return pictures.new((11.0, height), title, 'constrained' if fitted else None)
