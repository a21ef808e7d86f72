"""A motion before it runs: its path with the robot, and its joints against their limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from parallel_robot.analysis.pictures import COLOURS, look_of
from parallel_robot.analysis.report.figures import add_legend, panels
from parallel_robot.analysis.report.looks import add_lines, add_path, joint_label, label, posture
from parallel_robot.bags.output import without_mathematics
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.fastest import speed_limit, torque_limits, torques
from trajectory_gen import preflight
from trajectory_gen.trajectory import Reference

ROBOTS = 4  # postures of the robot along the path
CLOSE = 2.0  # a limit is drawn where the motion comes as close to it, as a factor


def figure_of_motion(configuration: Configuration) -> Any:
    """Path, joint speeds and the torques that they take, as a figure of matplotlib.

    In space, the path is drawn in three views; a robot whose pose is not a place has none.
    Torques are those of the nominal robot with friction. A limit that is more than twice as large
    as all there is is not drawn but named.

    Args:
        configuration: The experiment; its motion may be one that the robot cannot perform.
    """
    trajectory, loop = configuration.trajectory, configuration.loop
    robot = trajectory.robot
    units = robot.joint_units
    times = preflight.grid(trajectory, loop.period)
    reference = trajectory.sample(times)
    figure, path, (first, second, third) = panels(
        f'{label(loop.scenario)}: planned motion', robot.place
    )
    if robot.place == len('xyz'):
        _draw_in_space(path, robot, reference)
    elif robot.place:
        _draw_in_plane(path[0], robot, reference)
    with np.errstate(invalid='ignore'):  # where the robot does not reach
        torque = np.sum(torques(configuration, reference), axis=0)
    least, greatest = torque_limits(configuration)
    rows_of = (
        (first, reference.position, None, units.label('position [rad]'), 'Joint positions'),
        (
            second,
            reference.velocity,
            speed_limit(configuration),
            units.label('speed [rad/s]'),
            'Joint speeds',
        ),
        (
            third,
            torque,
            np.maximum(-least, greatest),
            units.label('torque [N m]'),
            units.label('Torques'),
        ),
    )
    for axes, values, limits, quantity, title in rows_of:
        for k, (joint, column) in enumerate(zip(loop.joints, values.T, strict=True)):
            name = without_mathematics(joint_label(joint))
            axes.plot(times, column, **look_of(k), label=name)
        if limits is not None:
            title += _drawn(axes, values, limits)
        axes.set(ylabel=quantity)
        axes.set_title(title, loc='left')
        add_legend(axes)
    third.set(xlabel='t [s]')
    return figure


def _postures(robot: RobotModel, reference: Reference) -> Iterator[tuple[Any, dict[str, Any]]]:
    """The robot at times along its path, the start last: its lines, and how they look."""
    rows = np.linspace(0, len(reference.pose) - 1, ROBOTS, endpoint=False).astype(int)
    for k in np.unique(rows)[::-1]:
        look = {'color': '0.35' if k == 0 else '0.85', 'lw': 2.0 if k == 0 else 1.0}
        yield posture(robot, reference.pose[k], reference.position[k]), look


def _draw_in_plane(path: Any, robot: RobotModel, reference: Reference) -> None:
    x, y = 1e3 * reference.pose[:, :2].T
    for parts, look in _postures(robot, reference):
        for ends in parts.values():
            path.plot(*(1e3 * ends).T, **look)
    path.plot(x, y, color=COLOURS[0], lw=1.6, label='path')
    path.plot(x[0], y[0], 'o', color=COLOURS[1], label='start')
    across, up = (f'{axis} [mm]' for axis in robot.axes)
    path.set(xlabel=across, ylabel=up, title='Path and robot', aspect='equal')
    path.legend(loc='upper right')


def _draw_in_space(views: Sequence[Any], robot: RobotModel, reference: Reference) -> None:
    for parts, look in _postures(robot, reference):
        add_lines(views, parts, **look)
    add_path(views, reference.pose, color=COLOURS[0], lw=1.6, label='path')
    start = {'color': COLOURS[1], 'marker': 'o', 'ms': 4, 'linestyle': '', 'label': 'start'}
    add_path(views, reference.pose[:1], **start)
    views[0].set_title('Path and robot')
    views[-1].legend(loc='center left', bbox_to_anchor=(1.25, 0.5), frameon=False)


def _drawn(axes: Any, values: np.ndarray, limits: np.ndarray) -> str:
    """Draw limits that are near; what to say of the tightest."""
    largest = np.nanmax(np.abs(values), initial=0.0)
    for k, limit in enumerate(limits):
        if limit < CLOSE * largest:
            for side in (-limit, limit):
                axes.axhline(side, **{**look_of(k), 'linestyle': ':'})
    return f'; limit {limits.min():g}'
