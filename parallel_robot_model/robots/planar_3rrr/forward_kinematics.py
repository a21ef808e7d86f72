"""Forward kinematics: the pose at given joint angles, in one assembly mode."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import dot, every, kernel, select, vector
from parallel_robot_model.robots.contract import FOUND, REACHED
from parallel_robot_model.robots.planar_3rrr.dynamics import Columns, inverse_rows, type_2_measure
from parallel_robot_model.robots.planar_3rrr.kinematics import (
    Constants,
    Posture,
    RobotParameters,
    arms,
    out_of_reach,
    posture_at,
    posture_of,
    theta_of,
)

# Why there is no trustworthy pose.
GUESS_OUT_OF_REACH = 1
NOT_CONVERGED = 2
WRONG_WORKING_MODE = 3
MAX_STEP = 0.05  # rad, of the path that the forward kinematics follows
SHORT = math.sin(MAX_STEP)
SINGULAR = 0.02  # |det Jx| / l3 below which the branch is not trusted
STATUS_TEXT = {
    GUESS_OUT_OF_REACH: 'the guess is out of reach',
    NOT_CONVERGED: 'no pose on the same assembly mode fits the joint angles',
    WRONG_WORKING_MODE: 'an elbow has folded to the other side',
}


class Assembly(NamedTuple):
    """Result of the forward kinematics."""

    pose: Array  # (x, y, phi) [m, m, rad], shape (3,); the guess if there is no trustworthy pose
    posture: Posture  # directions of the links there
    status: int  # FOUND or the reason why there is no trustworthy pose


class Closure(NamedTuple):
    """Residual of the loop closure, (|C_i - E_i|^2 - l2^2) / (2 l2) [m], and its Jacobian."""

    residual: Array
    jacobian: Columns


@kernel
def _closure(
    robot: Constants, elbow_x: Array, elbow_y: Array, pose: Array, arm_x: Array, arm_y: Array
) -> Closure:
    """Closure at a pose and its arms with the elbows E_i held."""
    dx = pose[0] + arm_x - elbow_x
    dy = pose[1] + arm_y - elbow_y
    residual = (0.5 * robot.per_l2) * (dx * dx + dy * dy - robot.l2 * robot.l2)
    turning = (dy * arm_x - dx * arm_y) * robot.per_l2
    return Closure(residual, Columns(dx * robot.per_l2, dy * robot.per_l2, turning))


@kernel
def _newton(
    robot: Constants, elbow_x: Array, elbow_y: Array, pose: Array, arm_x: Array, arm_y: Array
) -> tuple[Array, Array, Array, float]:
    """Newton's iteration on the loop closure, started only where it is known to converge.

    The Newton-Kantorovich condition L |J^-1| |step| <= 1/2 at the start guarantees one solution
    near the start and convergence to it. L bounds the second derivative of the residual, with
    lengths in metres and angles as l3 phi: each leg adds at most (2 + d / l3) / l2, where d bounds
    its distance from elbow to platform joint.

    Args:
        robot: The robot.
        elbow_x: x of the elbows [m], shape (3,).
        elbow_y: y of the elbows [m], shape (3,).
        pose: Pose at the start, shape (3,).
        arm_x: x of the arms there, see :func:`arms`, shape (3,).
        arm_y: y of the same.

    Source:
        Ortega (1968), The Newton-Kantorovich theorem, Amer. Math. Monthly 75(6).
    """
    # 1. The first step J^-1 r; size = |step|, with the angle as l3 phi.
    residual, jacobian = _closure(robot, elbow_x, elbow_y, pose, arm_x, arm_y)
    ix, iy, ip, determinant = inverse_rows(jacobian)
    step = vector((dot(ix, residual), dot(iy, residual), dot(ip, residual)))
    turn = robot.l3 * step[2]
    size = math.sqrt(step[0] * step[0] + step[1] * step[1] + turn * turn)
    # 2. Squared Frobenius norm of J^-1 (in the same units), and d, a bound of |C_i - E_i|.
    norm = dot(ix, ix) + dot(iy, iy) + robot.l3 * robot.l3 * dot(ip, ip)
    lengths = jacobian.x * jacobian.x + jacobian.y * jacobian.y
    longest = select(lengths[0] > lengths[1], lengths[0], lengths[1])
    longest = select(longest > lengths[2], longest, lengths[2])
    distance = robot.l2 * math.sqrt(longest)
    distance += 2.0 * math.sqrt(2.0) * size  # the solution lies within two steps
    # 3. The condition L |J^-1| |step| <= 1/2; NaN does not meet it.
    bound = math.sqrt(3.0) * (2.0 + distance * robot.per_l3) * robot.per_l2
    active = bound * math.sqrt(norm) * size <= 0.5
    # 4. Newton: X <- X - J^-1 r until the step vanishes.
    nearer = select(active, pose - step, pose)
    reached, turn = 0.0 * determinant, step[2]
    for _ in range(20):
        if not active:
            break
        next_x, next_y = arms(robot, nearer[2])
        residual, jacobian = _closure(robot, elbow_x, elbow_y, nearer, next_x, next_y)
        ix, iy, ip, determinant = inverse_rows(jacobian)
        step = vector((dot(ix, residual), dot(iy, residual), dot(ip, residual)))
        nearer = select(active, nearer - step, nearer)
        turn = select(active, step[2], turn)
        arm_x, arm_y = select(active, next_x, arm_x), select(active, next_y, arm_y)
        left = abs(step[0]) + abs(step[1]) + abs(step[2])
        done = active & (left < 1e-9)  # quadratic: the error is round-off
        reached = select(done, determinant * robot.per_l3, reached)
        active = active & (done == False)  # noqa: E712 `not` would branch
    # 5. The last step turned the arms by less than 1e-9 rad.
    arm_x, arm_y = arm_x + turn * arm_y, arm_y - turn * arm_x
    return nearer, arm_x, arm_y, select(active, 0.0, reached)


@kernel
def _assembled(
    robot: Constants, ct: Array, st: Array, pose: Array, arm_x: Array, arm_y: Array
) -> Assembly:
    """Posture at a pose that closes all loops; the elbows must be on their sides."""
    cb = (pose[0] + arm_x - (robot.base_x + robot.l1 * ct)) * robot.per_l2
    sb = (pose[1] + arm_y - (robot.base_y + robot.l1 * st)) * robot.per_l2
    posture = posture_of(arm_x, arm_y, ct, st, cb, sb)
    right = every(robot.side * posture.sin_psi < 0.0)
    return Assembly(pose, posture, select(right, FOUND, WRONG_WORKING_MODE))


@kernel
def _tracked_pose(robot: Constants, theta: Array, guess: Array) -> Assembly:
    """The pose at the end of the path of joint angles from those of the guess to the given ones.

    The path is followed in steps within which Newton's iteration provably converges to the
    solution near it. A path through a type 2 singularity ends in a failure, never on another
    branch.
    """
    # 1. Joint angles of the guess.
    start = posture_at(robot, guess)
    if out_of_reach(start) != REACHED:
        return Assembly(guess, start, GUESS_OUT_OF_REACH)
    first = theta_of(robot, start, guess)
    # 2. Change of each angle to the given one, in [-pi, pi).
    turn = theta - first
    change = turn - 2.0 * math.pi * np.floor(turn / (2.0 * math.pi) + 0.5)
    largest = max(abs(change[0]), abs(change[1]), abs(change[2]))
    # 3. Path theta_guess + s change, s = 0 ... 1: a step that fails or changes the sign of
    #    det Jx is halved; the path ends at a type 2 singularity.
    pose, arm_x, arm_y = guess, start.arm_x, start.arm_y
    side = type_2_measure(robot, start)
    done = 0.0
    part = 1.0 if largest < MAX_STEP else MAX_STEP / largest
    shortest = 1e-3 * part
    while done < 1.0:
        if not part > shortest or not abs(side) > SINGULAR:
            return Assembly(guess, start, NOT_CONVERGED)
        share = min(1.0, done + part)
        target = theta if share == 1.0 else first + share * change
        elbow_x = robot.base_x + robot.l1 * np.cos(target)
        elbow_y = robot.base_y + robot.l1 * np.sin(target)
        nearer, x, y, determinant = _newton(robot, elbow_x, elbow_y, pose, arm_x, arm_y)
        if determinant * side > 0.0:
            pose, arm_x, arm_y = nearer, x, y
            side = determinant
            done = share
        else:
            part *= 0.5
    if not abs(side) > SINGULAR:
        return Assembly(guess, start, NOT_CONVERGED)
    return _assembled(robot, np.cos(theta), np.sin(theta), pose, arm_x, arm_y)


@kernel
def forward_kinematics(robot: Constants, theta: Array, guess: Array) -> Assembly:
    """Pose at given joint angles, in the assembly mode of the guess.

    Close samples take one step of Newton's iteration from the guess; from farther ones the path
    of the joint angles is followed.

    Args:
        robot: The robot.
        theta: Actuated angles [rad], shape (3,); whole turns do not matter.
        guess: A pose near the solution, e.g. the previous one, shape (3,).

    Returns:
        Pose, posture and status.
    """
    ct, st = np.cos(theta), np.sin(theta)
    # 1. The joints have turned by less than MAX_STEP since the guess; NaN is not close.
    start = posture_at(robot, guess)
    across = start.ct * st - start.st * ct
    along = start.ct * ct + start.st * st
    close = every((along > 0.0) & (np.abs(across) < SHORT))
    # 2. Newton's iteration, which must not end beyond a type 2 singularity.
    elbow_x, elbow_y = robot.base_x + robot.l1 * ct, robot.base_y + robot.l1 * st
    reached_pose, arm_x, arm_y, reached = _newton(
        robot, elbow_x, elbow_y, guess, start.arm_x, start.arm_y
    )
    side = type_2_measure(robot, start)
    trusted = (abs(side) > SINGULAR) & (abs(reached) > SINGULAR) & (reached * side > 0.0)
    done = close & trusted
    result = _assembled(robot, ct, st, reached_pose, arm_x, arm_y)
    # 3. From farther away.
    if not done:
        result = _tracked_pose(robot, theta, guess)
    return result


# The pose by all measured joints: actuated and passive ones, in whatever assembly mode.

CLOSED = 0.1  # of l3, how far a platform joint may be from where the others want it


def pose_with(robot: RobotParameters, position: Array, passive: Array) -> Array:
    """Pose at which the platform joints lie where the legs end, in the least squares.

    C_i = A_i + l1 u(theta_i) + l2 u(theta_i + psi_i) = P + l3 u(phi + gamma_i), which is linear in
    P and in exp(i phi) up to its length, with points of the plane as complex numbers.

    Args:
        robot: The robot.
        position: Actuated angles [rad], shape (3,).
        passive: Passive joints psi [rad], shape (3,).

    Returns:
        Pose (x, y, phi) [m, m, rad], shape (3,); NaN where the loops are not closed.
    """
    base = np.array(robot.base_x) + 1j * np.array(robot.base_y)
    elbow = base + robot.l1 * np.exp(1j * position)
    ends = elbow + robot.l2 * np.exp(1j * (position + passive))
    arms = robot.l3 * np.exp(1j * np.array(robot.platform_angle))
    from_centre = arms - arms.mean()
    phi = float(np.angle(np.vdot(from_centre, ends - ends.mean())))
    centre = (ends - np.exp(1j * phi) * arms).mean()
    gaps = np.abs(centre + np.exp(1j * phi) * arms - ends)
    closed = bool((gaps < CLOSED * robot.l3).all())
    return np.array([centre.real, centre.imag, phi]) if closed else np.full(3, np.nan)
