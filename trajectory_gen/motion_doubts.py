"""Doubts about a motion whose numbers look like those of other units, or are not all used."""

from __future__ import annotations

import math

import numpy as np

from trajectory_gen.trajectory import LOOKS, Trajectory

TURN = 2.0 * math.pi  # rad, an angle beyond which may be in degrees
LONG = 1000.0  # s, a time that may be in another unit
FAR = 50.0  # m, a distance that may be in mm
USUAL = 100.0  # s, the longest time that is usual
UNITS = {'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}  # s


def motion_doubts(trajectory: Trajectory) -> tuple[str, ...]:
    """What a motion looks like that was given in other units, one line each; often nothing."""
    robot, name = trajectory.robot, trajectory.parameters.shape
    axes = robot.module.coordinates(robot.parameters)
    doubts = [trajectory.note] if trajectory.note else []
    poses = trajectory.poses(np.linspace(0.0, trajectory.span, LOOKS + 1)).pose
    for axis, values in zip(axes, poses.T, strict=True):
        most = float(values[np.argmax(np.abs(values))])
        if axis.unit == 'rad' and abs(most) > TURN:
            doubts.append(
                f'{name}: {axis.name} reaches {most:.4g} rad, {most / TURN:.3g} turns: '
                f'if that is in degrees, it must be {math.radians(most):.4g} rad'
            )
        elif axis.unit == 'm' and abs(most) > FAR:
            doubts.append(
                f'{name}: {axis.name} reaches {most:.4g} m: '
                f'if that is in mm, it must be {1e-3 * most:.4g} m'
            )
    if name != 'waypoints':
        return tuple(doubts)
    length = trajectory.span * trajectory.parameters.speed_factor
    if length > LONG:
        unit = next((unit for unit, size in UNITS.items() if length * size <= USUAL), 'ns')
        doubts.append(
            f'waypoints.times last {length:.4g} s: if they are in {unit}, they must be divided '
            f'to last {length * UNITS[unit]:.4g} s'
        )
    if trajectory.size > len(axes):
        names = ', '.join(axis.name for axis in axes)
        doubts.append(
            f'waypoints.points have phi, which is not used: the pose of {robot.name} is {names}'
        )
    return tuple(doubts)
