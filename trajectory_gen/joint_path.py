"""Motions in the joints as motions of the pose, which all else works with."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import solve_full, vector
from parallel_robot_model.mechanisms import spatial
from parallel_robot_model.robots.contract import FOUND, PoseMotion
from parallel_robot_model.robots.poses import rates_of
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen.paths import length_of
from trajectory_gen.waypoints import Spline, motion

STEP = 0.005  # s, of a piece of the path: a sine of 5 Hz is met to 1e-9 of its amplitude
MOST = 100_000  # pieces, about; those of a longer motion are longer
POINTS = 'waypoints.points'


def in_pose(robot: RobotModel, joints: Spline, near: Sequence[float]) -> Spline:
    """The motion of the pose that a motion of the actuated joints is.

    The forward kinematics is followed along the path, so assembly and working mode stay those of
    the pose `near`. Between places that are at most STEP apart, or so many that they are MOST,
    pose, rate and acceleration at both ends fix a polynomial of degree 5.

    Args:
        robot: The robot.
        joints: The motion of its joints [rad], n coordinates.
        near: Pose from which the first one is looked for, m numbers.

    Raises:
        InputError: it has another number of joints, or no pose fits those at some time.
    """
    count, names = joints.coefficients.shape[2], robot.module.coordinates(robot.parameters)
    wanted = robot.module.joints(robot.parameters)
    if count != wanted:
        raise InputError(f'{POINTS} have {count} joints; {robot.name} has {wanted}', POINTS)
    if [axis.name for axis in names] == [f'q{k + 1}' for k in range(count)]:
        return joints  # the pose is the joints
    steps = np.diff(joints.knots)
    step = max(STEP, float(steps.sum()) / MOST)
    parts = np.maximum(1, np.ceil(steps / step - 1e-9).astype(int))
    shares = np.concatenate([np.arange(part) / part for part in parts])
    knots = np.repeat(joints.knots[:-1], parts) + shares * np.repeat(steps, parts)
    knots = np.append(knots, joints.knots[-1])
    motions = _pose_track(robot, joints, knots - knots[0], near)
    return Spline(knots, hermite(np.diff(knots), motions), joints.periodic)


def _pose_track(robot: RobotModel, joints: Spline, times: Array, near: Sequence[float]) -> Array:
    """Pose, rate and acceleration at some times since the first point, shape (N, 3, m)."""
    pose = vector(near)
    row = vector(np.zeros(joints.coefficients.shape[2]))
    locate = robot.kernel('locate', row, pose)
    still = PoseMotion(pose, pose, pose)
    joint_motion = robot.kernel('joint_motion', still)
    constants, size = robot.constants, len(near)
    zero = vector(np.zeros(size))
    motions = np.empty((len(times), 3, size))
    for k, time in enumerate(times):
        q, rate, acceleration = motion(joints, time)
        located = locate(constants, vector(q), pose)
        if located.fault != FOUND:
            what = robot.module.FAULTS[located.fault].text
            shown = ', '.join(f'{angle:.4g}' for angle in q)
            raise InputError(f'{POINTS}: at t = {time:.4g} s, joints [{shown}]: {what}', POINTS)
        pose = located.pose
        # The joints follow the pose: qd = G v and qdd = G a + h(v).
        jacobian = rates_of(joint_motion, constants, pose)
        velocity = solve_full(jacobian, rate)
        carried = joint_motion(constants, PoseMotion(pose, vector(velocity), zero)).acceleration
        motions[k] = pose, velocity, solve_full(jacobian, acceleration - np.asarray(carried))
    return motions


def hermite(steps: Array, motions: Array) -> Array:
    """Coefficients of the powers 5 to 0 of the time between neighbours, shape (K, 6, m).

    Args:
        steps: Times from each to the next [s], shape (K,).
        motions: Pose, rate and acceleration, shape (K + 1, 3, m).
    """
    h = steps[:, np.newaxis]
    (p, v, a), (q, w, b) = motions[:-1].swapaxes(0, 1), motions[1:].swapaxes(0, 1)
    # What is missing at the end of a piece of degree 2, in units of the step.
    miss = q - p - h * v - 0.5 * (h * h) * a
    slope = h * (w - v - h * a)
    bend = (h * h) * (b - a)
    c3 = 10.0 * miss - 4.0 * slope + 0.5 * bend
    c4 = -15.0 * miss + 7.0 * slope - bend
    c5 = 6.0 * miss - 3.0 * slope + 0.5 * bend
    cube = h * h * h  # a product: powers of numpy are other bits on another processor
    return np.stack([c5 / (cube * h * h), c4 / (cube * h), c3 / cube, 0.5 * a, v, p], axis=1)


# Points with quaternions as poses of a robot, whose orientations are rotation vectors.

KEY = 'waypoints.space'
AXES = ('x', 'y', 'z', 'rx', 'ry', 'rz')
NUMBERS = 7  # of a point


def as_poses(robot: RobotModel, numbers: Sequence[float]) -> tuple[float, ...]:
    """Poses with the rotation vectors of the tool from home, which go on without a jump.

    Of a rotation that can be told by several vectors, the one nearest to that of the point before
    is taken: between two points the tool turns by less than half a turn.

    Args:
        robot: The robot.
        numbers: x, y, z [m] and the quaternion x, y, z, w of the tool in the world, point after
            point.

    Raises:
        InputError: the robot has no such poses, or a point is none.
    """
    axes = tuple(axis.name for axis in robot.module.coordinates(robot.parameters))
    orientations = robot.module.orientations
    if axes != AXES or orientations is None:
        raise InputError(
            f'quaternions need a pose of {", ".join(AXES)}; that of {robot.name} is '
            f'{", ".join(axes)}',
            KEY,
        )
    if len(numbers) % NUMBERS:
        what = f'x, y, z and a quaternion for each point, not {len(numbers)} numbers'
        raise InputError(f'waypoints.points must hold {what}', 'waypoints.points')
    points = np.reshape(numbers, (-1, NUMBERS))
    if not points[:, 3:].any(axis=1).all():
        raise InputError('a quaternion in waypoints.points is zero', 'waypoints.points')
    home = orientations(robot.parameters, np.zeros((1, len(AXES))))
    back = home * np.array([-1.0, -1.0, -1.0, 1.0])
    turned = spatial.vectors_of_quaternions(spatial.quaternion_product(points[:, 3:], back))
    return tuple(np.hstack([points[:, :3], continuous(turned)]).ravel().tolist())


def continuous(vectors: Array) -> Array:
    """Rotation vectors of the same rotations, each the nearest to the one before, shape (N, 3)."""
    made = vectors.copy()
    for k in range(1, len(made)):
        before, now = made[k - 1], vectors[k]
        angle = length_of(now)
        # Near no rotation, the axis is that of the vector before.
        axis = now / angle if angle > 1e-9 else before / max(length_of(before), 1e-9)
        turns = round((float(before @ axis) - angle) / (2.0 * math.pi))
        made[k] = now + 2.0 * math.pi * turns * axis
    return made
