"""How fast a motion may run until a joint meets a limit of speed or torque."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, distinct_texts
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, read_row, vector, write_row
from parallel_robot_model.robots.contract import inverse_dynamics
from parallel_robot_sim.configuration import Configuration
from trajectory_gen import preflight
from trajectory_gen.trajectory import Reference

FACTOR = 'trajectory.speed_factor'
ROUNDS = 5  # corrections of a speed by the friction at it
RESERVE = 1e-4  # of the factor: the fastest moment may lie between two samples


class Fastest(NamedTuple):
    """The fastest feasible speed of a motion."""

    factor: float  # value of ``trajectory.speed_factor`` at which a joint meets its limit
    span: float  # what the motion takes then until it repeats or rests [s]
    text: str  # the limit for people, with joint and time


def fastest(configuration: Configuration) -> Fastest:
    """Find how fast a motion may run.

    The torque is that of the nominal robot on the motion, with friction, without a reserve for
    the control of errors. A motion that runs k times as fast takes k^2 I + k V + C, where I is
    the torque of inertia, V that of viscous friction and C that of dry friction and gravity.

    Raises:
        InputError: the motion stands still, a motor cannot even hold the robot on it, or the
            robot cannot perform it at any speed.
    """
    trajectory = configuration.trajectory
    times = preflight.grid(trajectory, configuration.loop.period)
    reference = trajectory.sample(times)
    if not reference.velocity.any():
        raise InputError('the motion stands still: it has no fastest speed', 'trajectory.shape')
    # 1. The speed of the joints.
    speed = speed_limit(configuration)
    # 2. Their torque: k^2 I + k V + C = a limit.
    least, greatest = torque_limits(configuration)
    friction = configuration.joint_load.friction
    scale, rounds = 1.0, ROUNDS if any(friction.load) or any(friction.stribeck) else 1
    for _ in range(rounds):  # friction is that at the speed that is found
        inertia, viscous, dry = torques(configuration, reference, scale)
        with np.errstate(divide='ignore', invalid='ignore'):
            by_speed = speed / np.abs(reference.velocity)
            upper = _least_root(inertia, viscous, dry - greatest)
            lower = _least_root(inertia, viscous, dry - least)
        by_torque = np.where((least < dry) & (dry < greatest), np.fmin(upper, lower), 0.0)
        both = np.nan_to_num(np.minimum(by_speed, by_torque), nan=np.inf)
        k, joint = np.unravel_index(both.argmin(), both.shape)
        scale = float(both[k, joint])
    torque = np.where(dry[0] > 0.0, greatest, -least)
    name = configuration.loop.joints[joint]
    at_speed = by_speed[k, joint] <= by_torque[k, joint]
    units = trajectory.robot.joint_units.one(int(joint))
    limit, unit = (speed, units.of('rad/s')) if at_speed else (torque, units.of('N m'))
    if not scale:
        raise InputError(f'{torque[joint]:g} {unit} do not hold {name} on the motion', FACTOR)
    # 3. What does not depend on the speed, as reach, is checked as ever.
    factor = scale * trajectory.parameters.speed_factor * (1.0 - RESERVE)
    faster = trajectory.at_speed(factor)
    preflight.check(faster, configuration.loop.period)
    shown, _ = distinct_texts(float(limit[joint]), 0.0, 6)
    text = f'{name} is at {shown} {unit} at t = {times[k] / scale:.3f} s'
    return Fastest(factor, faster.span, text)


def _least_root(a: Array, b: Array, c: Array) -> Array:
    """Least positive root of a k^2 + b k + c = 0; infinite where there is none."""
    root = np.sqrt(b * b - 4.0 * a * c)
    q = -0.5 * (b + np.copysign(root, b))
    roots = np.stack([q / a, c / q])
    smallest: Array = np.where(roots > 0.0, roots, np.inf).min(axis=0)
    return smallest


def speed_limit(configuration: Configuration) -> Array:
    """Joint speeds that the motion or the controller forbids [rad/s], shape (n,)."""
    most = configuration.trajectory.parameters.max_joint_speed
    limits: Array = np.minimum(most, configuration.safety.speed_limit)
    return limits


def torque_limits(configuration: Configuration) -> tuple[Array, Array]:
    """Least and greatest torque of controller and motors [N m], each shape (n,)."""
    plant, most = configuration.plant, configuration.safety.torque_limit
    back, forth = (
        np.minimum(np.multiply(plant.torque_limit, share), most)
        for share in (plant.torque_backward, plant.torque_forward)
    )
    return -back, forth


def torques(
    configuration: Configuration, reference: Reference, scale: float = 1.0
) -> tuple[Array, Array, Array]:
    """Torque that the nominal robot with friction needs on a motion [N m], each shape (N, n).

    Args:
        configuration: The experiment.
        reference: The motion.
        scale: How many times as fast it runs, for friction at rest and what gears transmit.

    Returns:
        That of inertia, that of viscous friction, that of dry friction and gravity.
    """
    robot, friction = configuration.trajectory.robot, configuration.joint_load.friction
    margins = configuration.margins
    pose, joints = vector(reference.pose[0]), vector(reference.position[0])
    estimate = robot.kernel('estimate', margins, joints, joints, pose)
    rows = reference.position, reference.velocity, reference.acceleration
    held, moved = _along(estimate, robot.constants, margins, pose, joints, reference.pose, *rows)
    share = scale * reference.velocity / friction.stribeck_velocity
    dry = np.array(friction.coulomb) + np.array(friction.stribeck) * np.exp(-share * share)
    sign, inertia = np.sign(reference.velocity), moved - held
    driving = 1.0 + np.array(friction.load) * sign * np.sign(scale**2 * inertia + held)
    dry = dry * sign + held * driving + np.array(friction.offset)
    return inertia * driving, np.array(friction.viscous) * reference.velocity, dry


@kernel
def _along(
    estimate: Any,
    robot: Any,
    margins: Any,
    pose_template: Array,
    template: Array,
    pose: Array,
    position: Array,
    velocity: Array,
    acceleration: Array,
) -> tuple[Array, Array]:
    """Torques that hold the robot and that move it [N m], each shape (N, n)."""
    held, moved = np.empty_like(position), np.empty_like(position)
    for k in range(len(position)):
        rate = read_row(velocity, k, template)
        at = read_row(position, k, template)
        model = estimate(robot, margins, at, rate, read_row(pose, k, pose_template)).model
        write_row(held, k, model.gravity)
        write_row(moved, k, inverse_dynamics(model, read_row(acceleration, k, template), rate))
    return held, moved
