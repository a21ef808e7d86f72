"""A serial arm of two links and two revolute joints in a vertical plane, with gravity.

The shoulder is the origin, x points to the right and y up. q1 is the angle of the proximal link
from x, q2 that of the distal link from the proximal one. With c1 = cos q1, s12 = sin(q1 + q2) and
so on, the pose is the tip, and the plant integrates M qdd + Q qd + gravity = tau:

    x = l1 c1 + l2 c12,  y = l1 s1 + l2 s12
    a = I1 + m1 lc1^2 + (m2 + mp) l1^2,  b = I2 + m2 lc2^2 + mp l2^2,  h = l1 (m2 lc2 + mp l2)
    M = [[a + b + 2 h c2, b + h c2], [b + h c2, b]]
    Q = [[-h s2 q2d, -h s2 (q1d + q2d)], [h s2 q1d, 0]]
    gravity = g [(m1 lc1 + (m2 + mp) l1) c1 + (m2 lc2 + mp l2) c12, (m2 lc2 + mp l2) c12]

Source:
    Spong, Hutchinson, Vidyasagar (2006), Robot Modeling and Control, chapters 3 (kinematics) and 7
    (dynamics, Christoffel symbols); Lynch, Park (2017), Modern Robotics, chapters 6 and 8.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, RobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, multiply, select, vector
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots import serial_2r_linear_model as linear_model  # noqa: F401
from parallel_robot_model.robots import serial_2r_tree as tree  # noqa: F401
from parallel_robot_model.robots.contract import (
    FOUND,
    REACHED,
    Coordinate,
    Estimate,
    Fault,
    Infeasible,
    JointMotion,
    Location,
    Margin,
    Measurement,
    Model,
    PoseMotion,
    first_sample,
    no_model,
)
from parallel_robot_model.robots.joint_load import JointLoad, net_torque
from parallel_robot_model.robots.link import check_links

PARTS = ('joint', 'arm')
PLANAR = True
WRONG_WORKING_MODE = 1
SINGULARITY = 2
FAULTS = {
    WRONG_WORKING_MODE: Fault('wrong_working_mode', 'the elbow has folded to the other side'),
    SINGULARITY: Fault('singularity', 'the arm is close to being stretched or folded'),
}
NO_POSE = ()  # joints have one pose


class Parameters(NamedTuple):
    """Geometry and inertia of the arm."""

    l1: Annotated[float, Field('m', 'length of the proximal link')]
    l2: Annotated[float, Field('m', 'length of the distal link, elbow to tip')]
    lc1: Annotated[float, Field('m', 'shoulder to the centre of mass of the proximal link')]
    lc2: Annotated[float, Field('m', 'elbow to the centre of mass of the distal link')]
    m1: Annotated[float, Field('kg', 'mass of the proximal link')]
    m2: Annotated[float, Field('kg', 'mass of the distal link')]
    mp: Annotated[float, Field('kg', 'mass of the payload, a point at the tip', 0.0)]
    I1: Annotated[float, Field('kg m^2', 'inertia of the proximal link about its centre of mass')]
    I2: Annotated[float, Field('kg m^2', 'inertia of the distal link about its centre of mass')]
    gravity: Annotated[float, Field('m/s^2', 'gravity against y; 0: a horizontal plane', 0.0)]
    elbow: Annotated[float, Field('', 'sign of sin q2, the working mode, +1 or -1')]


class SafetyMargins(NamedTuple):
    """Limits beyond which the controller enters a fault."""

    min_sin_elbow: Annotated[float, Field('', '|sin q2| that is a fault (singularity)', 0.0, 1.0)]


class MotionLimits(NamedTuple):
    """Limits of a reference motion."""

    min_sin_elbow: Annotated[float, Field('', 'smallest |sin q2| allowed (singularity)', 0.0, 1.0)]


def validate(robot: Parameters, name: str = 'robot') -> Parameters:
    """Return `robot` if it can be built.

    Raises:
        RobotError: a length, a mass of a link or an inertia is not positive; a centre of mass lies
            outside its link; the working mode is neither +1 nor -1.
    """
    check_links(robot, ('l1', 'l2', 'm1', 'm2', 'I1', 'I2'), name)
    if robot.elbow not in (-1.0, 1.0):
        raise RobotError(f'{name}.elbow must be +1 or -1, not {robot.elbow:g}', f'{name}.elbow')
    return robot


def joints(robot: Parameters) -> int:
    """Two: shoulder and elbow."""
    return 2


def coordinates(robot: Parameters) -> tuple[Coordinate, ...]:
    """Position of the tip."""
    return Coordinate('x', 'm'), Coordinate('y', 'm')


def _reach(robot: Parameters) -> str:
    return f'the arm spans {abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m'


def start(robot: Parameters, pose: Array) -> Array:
    """Joints [rad], shape (2,), with the tip at the pose [m], shape (2,).

    Raises:
        InputError: the tip does not reach it.
    """
    still = vector(np.zeros(2))
    motion = joint_motion(robot, PoseMotion(vector(pose), still, still))
    if motion.out_of_reach != REACHED:
        what = f'{pose.tolist()} is out of reach ({_reach(robot)})'
        raise InputError(f'plant.initial_pose {what}', 'plant.initial_pose')
    return motion.position


@kernel
def _tip(robot: Parameters, position: Array) -> Array:
    """x = l1 c1 + l2 c12, y = l1 s1 + l2 s12 [m], shape (2,)."""
    q1, q12 = position[0], position[0] + position[1]
    return vector(
        (
            robot.l1 * math.cos(q1) + robot.l2 * math.cos(q12),
            robot.l1 * math.sin(q1) + robot.l2 * math.sin(q12),
        )
    )


@kernel
def joint_motion(robot: Parameters, motion: PoseMotion) -> JointMotion:
    """Joints with two derivatives on the elbow's side; all NaN out of reach.

    q1 lies in a range of one turn and is continuous, except for a jump by a whole turn where the
    tip passes straight below the shoulder. Stretched or folded, the arm counts as out of reach.
    """
    x, y = motion.pose[0], motion.pose[1]

    # Law of cosines: r^2 = l1^2 + l2^2 + 2 l1 l2 cos q2, and sin q2 on the elbow's side.
    cosine = (x * x + y * y - robot.l1 * robot.l1 - robot.l2 * robot.l2) / (
        2.0 * robot.l1 * robot.l2
    )
    reached = abs(cosine) < 1.0
    cosine = select(reached, cosine, np.nan)
    sine = robot.elbow * math.sqrt((1.0 - cosine) * (1.0 + cosine))
    q2 = math.atan2(sine, cosine)

    # Direction of the tip minus the angle from the proximal link to it,
    # q1 = atan2(y, x) - atan2(l2 s2, l1 + l2 c2). The direction is counted from straight up, so
    # that its jump lies below. The second angle does not jump: s2 has one sign.
    direction = 0.5 * math.pi + math.atan2(-x, y)
    q1 = direction - math.atan2(robot.l2 * sine, robot.l1 + robot.l2 * cosine)

    # Rates: J qd = v with J = [[-y, -l2 s12], [x, l2 c12]] and det J = l1 l2 s2.
    j12 = -robot.l2 * math.sin(q1 + q2)
    j22 = robot.l2 * math.cos(q1 + q2)
    determinant = robot.l1 * robot.l2 * sine
    vx, vy = motion.rate[0], motion.rate[1]
    q1_dot = (j22 * vx - j12 * vy) / determinant
    q2_dot = (-y * vy - x * vx) / determinant

    # Accelerations: J qdd = a - Jdot qd, and with w = q1d + q2d
    # Jdot qd = -[l1 c1 q1d^2 + l2 c12 w^2, l1 s1 q1d^2 + l2 s12 w^2].
    first, second = q1_dot * q1_dot, (q1_dot + q2_dot) * (q1_dot + q2_dot)
    ax = motion.acceleration[0] + robot.l1 * math.cos(q1) * first + j22 * second
    ay = motion.acceleration[1] + robot.l1 * math.sin(q1) * first - j12 * second
    return JointMotion(
        vector((q1, q2)),
        vector((q1_dot, q2_dot)),
        vector(((j22 * ax - j12 * ay) / determinant, (-y * ay - x * ax) / determinant)),
        vector(()),  # no passive joints
        select(reached, REACHED, 0),
    )


@kernel
def locate(robot: Parameters, position: Array, guess: Array) -> Location:
    """Tip at joint angles [rad], shape (2,); a fault where the elbow is on the other side.

    The tip is correct in that fault, too; the guess, shape (2,), does not matter.
    """
    wrong = robot.elbow * math.sin(position[1]) < 0.0
    return Location(_tip(robot, position), select(wrong, WRONG_WORKING_MODE, FOUND))


@kernel
def _model(robot: Parameters, position: Array, velocity: Array) -> Model:
    """M, Q and gravity of the module's docstring at joint angles and rates, each shape (2,)."""
    c1 = math.cos(position[0])
    c2, s2 = math.cos(position[1]), math.sin(position[1])
    c12 = math.cos(position[0] + position[1])

    # Constants a, b and h; `moment` is the first moment of mass about the elbow [kg m].
    moment = robot.m2 * robot.lc2 + robot.mp * robot.l2
    l1, l2, lc1, lc2 = robot.l1, robot.l2, robot.lc1, robot.lc2
    a = robot.I1 + robot.m1 * (lc1 * lc1) + (robot.m2 + robot.mp) * (l1 * l1)
    b = robot.I2 + robot.m2 * (lc2 * lc2) + robot.mp * (l2 * l2)
    h = robot.l1 * moment

    # M = [[a + b + 2 h c2, b + h c2], [b + h c2, b]].
    m12 = b + h * c2
    M = vector((vector((a + b + 2.0 * h * c2, m12)), vector((m12, b))))

    # Q = [[-h s2 q2d, -h s2 (q1d + q2d)], [h s2 q1d, 0]], from the Christoffel symbols
    # c_121 = c_221 = -h s2, c_112 = h s2.
    w1, w2 = velocity[0], velocity[1]
    Q = vector((vector((-h * s2 * w2, -h * s2 * (w1 + w2))), vector((h * s2 * w1, 0.0))))

    # Gradient of the potential energy g (m1 y1 + m2 y2 + mp y).
    proximal = robot.m1 * robot.lc1 + (robot.m2 + robot.mp) * robot.l1
    distal = robot.gravity * moment * c12
    gravity = vector((robot.gravity * proximal * c1 + distal, distal))
    return Model(M, Q, gravity)


@kernel
def estimate(
    robot: Parameters, margins: SafetyMargins, position: Array, velocity: Array, guess: Array
) -> Estimate:
    """Pose, margin and model at a joint state."""
    location = locate(robot, position, guess)
    # Distance to the singularity: det J = l1 l2 sin q2. NaN is a fault, too.
    bent = abs(math.sin(position[1])) >= margins.min_sin_elbow
    fault = select(location.fault == FOUND, select(bent, FOUND, SINGULARITY), location.fault)
    model = _model(robot, position, velocity)
    return Estimate(fault, location.pose, select(fault == FOUND, model, no_model(model)))


@kernel
def acceleration(
    robot: Parameters, load: JointLoad, position: Array, rate: Array, torque: Array, time: float
) -> Array:
    """Second derivative of the joints: M qdd = tau - friction - delta - Q qd - gravity."""
    model = _model(robot, position, rate)
    M = model.M
    force = net_torque(load, torque, rate, time) - multiply(model.Q, rate) - model.gravity
    # Cramer's rule; M is positive definite, so det M > 0.
    determinant = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    return vector(
        (
            (M[1, 1] * force[0] - M[0, 1] * force[1]) / determinant,
            (M[0, 0] * force[1] - M[1, 0] * force[0]) / determinant,
        )
    )


@kernel
def measure(robot: Parameters, position: Array, rate: Array) -> Measurement:
    """Joints, which are the plant's coordinates, and tip; each shape (2,), no passive joints."""
    none = vector(())
    return Measurement(position, rate, none, none, _tip(robot, position))


def infeasible(robot: Parameters, limits: MotionLimits, reference: Any) -> list[Infeasible]:
    """First samples of a motion out of reach, near the singularity, or across the jump of q1."""
    unreached = np.flatnonzero(reference.out_of_reach != REACHED)
    position = reference.position[: unreached[0] if unreached.size else None]
    sines = np.abs(np.sin(position[:, 1]))
    turns = np.abs(np.diff(position[:, 0], prepend=position[:1, 0]))
    near = 'singularity, |sin q2| = {} is below trajectory.min_sin_elbow, {}'
    jump = 'the tip passes straight below the shoulder, where q1 jumps by a whole turn'
    failures = [
        first_sample(sines < limits.min_sin_elbow, sines, near, limits.min_sin_elbow),
        first_sample(turns > math.pi, turns, jump),
    ]
    if unreached.size:
        failures.append(Infeasible(int(unreached[0]), None, f'out of reach ({_reach(robot)})'))
    return [failure for failure in failures if failure is not None]


def margins(robot: Parameters, reference: Any) -> tuple[Margin]:
    """Distance from the singularity along a motion, shape (N,)."""
    sines = np.abs(np.sin(reference.position[:, 1]))
    return (Margin('min_sin_elbow', '|sin q2|', sines),)


def segments(robot: Parameters, pose: Array, position: Array) -> dict[str, Array]:
    """Both links as lines, in one posture or in many.

    Returns:
        Ends of the proximal and of the distal link [m], each shape (..., 1, 2, 2).
    """
    shoulder = position[..., 0]
    elbow = robot.l1 * np.stack([np.cos(shoulder), np.sin(shoulder)], axis=-1)
    ends = {'proximal': (np.zeros_like(elbow), elbow), 'distal': (elbow, pose)}
    return {part: np.stack(pair, axis=-2)[..., np.newaxis, :, :] for part, pair in ends.items()}
