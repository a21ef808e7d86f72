"""A motion before it runs: its path with the robot, and its joints against their limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot.analysis.report.figures import COLOURS, add_legend, look_of, panels
from parallel_robot.analysis.report.labels import joint_label, label
from parallel_robot.bags.printable_output import without_mathematics
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.fastest import speed_limit, torque_limit, torques
from trajectory_gen import preflight

ROBOTS = 4  # postures of the robot along the path
CLOSE = 2.0  # a limit is drawn where the motion comes as close to it, as a factor


def figure_of_motion(configuration: Configuration) -> Any:
    """Path, joint speeds and the torques that they take, as a figure of matplotlib.

    A robot that does not move in a plane has no path. Torques are those of the nominal robot with
    friction. A limit that is more than twice as large as all there is is not drawn but named.

    Args:
        configuration: The experiment; its motion may be one that the robot cannot perform.
    """
    trajectory, loop = configuration.trajectory, configuration.loop
    robot = trajectory.robot
    times = preflight.grid(trajectory, loop.period)
    reference = trajectory.sample(times)
    planar = robot.module.PLANAR
    figure, path, (first, second, third) = panels(
        f'{label(loop.scenario)}: planned motion', planar
    )
    if planar:
        x, y = 1e3 * reference.pose[:, :2].T
        rows = np.unique(np.linspace(0, len(times) - 1, ROBOTS, endpoint=False).astype(int))
        for k in rows[::-1]:
            parts = robot.module.segments(
                robot.parameters, reference.pose[k : k + 1], reference.position[k : k + 1]
            )
            for ends in parts.values():
                lines = 1e3 * ends[0]
                path.plot(*lines.T, color='0.35' if k == 0 else '0.85', lw=2.0 if k == 0 else 1.0)
        path.plot(x, y, color=COLOURS[0], lw=1.6, label='path')
        path.plot(x[0], y[0], 'o', color=COLOURS[1], label='start')
        path.set(xlabel='x [mm]', ylabel='y [mm]', title='Path and robot', aspect='equal')
        path.legend(loc='upper right')
    with np.errstate(invalid='ignore'):  # where the robot does not reach
        torque = np.sum(torques(configuration, reference), axis=0)
    rows_of = (
        (first, reference.position, None, 'position [rad]', 'Joint positions'),
        (second, reference.velocity, speed_limit(configuration), 'speed [rad/s]', 'Joint speeds'),
        (third, torque, torque_limit(configuration), 'torque [N m]', 'Torques'),
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


def _drawn(axes: Any, values: np.ndarray, limits: np.ndarray) -> str:
    """Draw limits that are near; what to say of the tightest."""
    largest = np.nanmax(np.abs(values), initial=0.0)
    for k, limit in enumerate(limits):
        if limit < CLOSE * largest:
            for side in (-limit, limit):
                axes.axhline(side, **{**look_of(k), 'linestyle': ':'})
    return f'; limit {limits.min():g}'
