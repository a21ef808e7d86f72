"""Inverse and forward kinematics, Jacobians and their rates.

Loop closure of leg i, with u(a) = (cos a, sin a), elbow E_i = A_i + l1 u(theta_i):

    P + l3 u(phi + gamma_i) = A_i + l1 u(theta_i) + l2 u(beta_i)

The pose is (x, y, phi) [m, m, rad]; theta_i is the actuated and beta_i the distal angle, both
absolute [rad]; the passive joint is psi_i = beta_i - theta_i.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.errors import KinematicsError
from parallel_robot_base.kernel import kernel
from parallel_robot_base.linear_algebra import determinant, inverse, multiply
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

Array = NDArray[np.float64]

# Outcome of the forward kinematics.
FOUND = 0
GUESS_OUT_OF_REACH = 1
NOT_CONVERGED = 2
WRONG_WORKING_MODE = 3
LONGEST_STEP = 0.05  # rad, of the path that the forward kinematics follows
SINGULAR = 0.02  # |det Jx| / l3 below which it does not trust the branch
STATUS_TEXT = {
    GUESS_OUT_OF_REACH: 'the guess is out of reach',
    NOT_CONVERGED: 'no pose on the same assembly mode fits the joint angles',
    WRONG_WORKING_MODE: 'an elbow has folded to the other side',
}


class Legs(NamedTuple):
    """Angles of the three legs at a pose.

    Attributes:
        theta: Actuated angles [rad], shape (3,).
        beta: Absolute angles of the distal links [rad], shape (3,).
        out_of_reach: 0-based index of the first leg that does not reach, -1 when all do.
    """

    theta: Array
    beta: Array
    out_of_reach: int


class Assembly(NamedTuple):
    """Result of the forward kinematics.

    Attributes:
        pose: (x, y, phi) [m, m, rad], shape (3,).
        beta: Absolute angles of the distal links [rad], shape (3,).
        status: FOUND or the reason why there is no trustworthy pose.
    """

    pose: Array
    beta: Array
    status: int


class Rates(NamedTuple):
    """Velocity maps at a pose, and their time derivatives: thetadot = H Xdot, betadot = K Xdot.

    Attributes:
        H: Pose rate to actuated rates, shape (3, 3).
        K: Pose rate to distal rates, shape (3, 3).
        H_dot: Time derivative of H, shape (3, 3).
        K_dot: Time derivative of K, shape (3, 3).
    """

    H: Array
    K: Array
    H_dot: Array
    K_dot: Array


@kernel
def inverse_kinematics(robot: RobotParameters, pose: Array) -> Legs:
    """Angles of all legs at a pose, in the robot's working mode.

    The direction of a leg is counted from the direction to the centre of the base, so theta is
    continuous wherever a platform joint is not straight behind its base joint.
    """
    theta = np.empty(3)
    beta = np.empty(3)
    out_of_reach = -1
    centre_x = (robot.base_x[0] + robot.base_x[1] + robot.base_x[2]) / 3.0
    centre_y = (robot.base_y[0] + robot.base_y[1] + robot.base_y[2]) / 3.0
    for i in range(3):
        ux = centre_x - robot.base_x[i]
        uy = centre_y - robot.base_y[i]
        if ux == 0.0 and uy == 0.0:
            ux = 1.0
        angle = pose[2] + robot.platform_angle[i]
        rx = pose[0] + robot.l3 * math.cos(angle) - robot.base_x[i]
        ry = pose[1] + robot.l3 * math.sin(angle) - robot.base_y[i]
        c = math.sqrt(rx * rx + ry * ry)
        cosine = (robot.l1 * robot.l1 - robot.l2 * robot.l2 + c * c) / (2.0 * robot.l1 * c)
        if not abs(cosine) < 1.0:
            if out_of_reach < 0:
                out_of_reach = i
            theta[i] = np.nan
            beta[i] = np.nan
            continue
        direction = math.atan2(uy, ux) + math.atan2(ux * ry - uy * rx, ux * rx + uy * ry)
        theta[i] = direction + robot.working_mode[i] * math.acos(cosine)
        dx = rx - robot.l1 * math.cos(theta[i])
        dy = ry - robot.l1 * math.sin(theta[i])
        beta[i] = math.atan2(dy, dx)
    return Legs(theta, beta, out_of_reach)


@kernel
def jacobian_x(robot: RobotParameters, phi: float, beta: Array) -> Array:
    """Parallel Jacobian of Jx Xdot = Jq thetadot; row i is [cos b, sin b, l3 sin(b - phi - g)]."""
    jacobian = np.empty((3, 3))
    for i in range(3):
        jacobian[i, 0] = math.cos(beta[i])
        jacobian[i, 1] = math.sin(beta[i])
        jacobian[i, 2] = robot.l3 * math.sin(beta[i] - phi - robot.platform_angle[i])
    return jacobian


@kernel
def jacobian_q(robot: RobotParameters, theta: Array, beta: Array) -> Array:
    """Serial Jacobian of Jx Xdot = Jq thetadot: its diagonal l1 sin psi_i, shape (3,)."""
    diagonal = np.empty(3)
    for i in range(3):
        diagonal[i] = robot.l1 * math.sin(beta[i] - theta[i])
    return diagonal


@kernel
def _cranks(robot: RobotParameters, theta: Array) -> Array:
    """Proximal links l1 u(theta_i) [m], shape (3, 2)."""
    cranks = np.empty((3, 2))
    for i in range(3):
        cranks[i, 0] = robot.l1 * math.cos(theta[i])
        cranks[i, 1] = robot.l1 * math.sin(theta[i])
    return cranks


@kernel
def _close(
    robot: RobotParameters, cranks: Array, pose: Array, residual: Array, jacobian: Array
) -> None:
    """Write the closure residual (|C_i - E_i|^2 - l2^2) / (2 l2) [m] and its Jacobian by pose."""
    for i in range(3):
        angle = pose[2] + robot.platform_angle[i]
        px = robot.l3 * math.cos(angle)
        py = robot.l3 * math.sin(angle)
        dx = pose[0] + px - robot.base_x[i] - cranks[i, 0]
        dy = pose[1] + py - robot.base_y[i] - cranks[i, 1]
        residual[i] = (dx * dx + dy * dy - robot.l2 * robot.l2) / (2.0 * robot.l2)
        jacobian[i, 0] = dx / robot.l2
        jacobian[i, 1] = dy / robot.l2
        jacobian[i, 2] = (dy * px - dx * py) / robot.l2


@kernel
def _newton(robot: RobotParameters, cranks: Array, pose: Array) -> tuple[Array, float]:
    """Newton's iteration on the loop closure, begun only where it is known to converge.

    The Newton-Kantorovich condition L |J^-1| |step| <= 1/2 at the start guarantees one solution
    near the start and convergence to it. L bounds the second derivative of the residual, with
    lengths in metres and angles as l3 phi: each leg adds at most (2 + d / l3) / l2, where d bounds
    its distance from elbow to platform joint.

    Returns:
        The pose and det J / l3 there; 0 when the iteration does not converge.

    Source:
        Ortega (1968), The Newton-Kantorovich theorem, Amer. Math. Monthly 75(6).
    """
    residual = np.empty(3)
    jacobian = np.empty((3, 3))
    _close(robot, cranks, pose, residual, jacobian)
    inverted = inverse(jacobian)
    step = multiply(inverted, residual)
    size = math.sqrt(step[0] ** 2 + step[1] ** 2 + (robot.l3 * step[2]) ** 2)
    norm = 0.0
    distance = 0.0
    for i in range(3):
        norm += inverted[0, i] ** 2 + inverted[1, i] ** 2 + (robot.l3 * inverted[2, i]) ** 2
        distance = max(distance, robot.l2 * math.hypot(jacobian[i, 0], jacobian[i, 1]))
    distance += 2.0 * math.sqrt(2.0) * size  # the solution lies within two steps
    bound = math.sqrt(3.0) * (2.0 + distance / robot.l3) / robot.l2
    if not bound * math.sqrt(norm) * size <= 0.5:
        return pose, 0.0
    found = pose - step
    for _ in range(20):
        _close(robot, cranks, found, residual, jacobian)
        step = multiply(inverse(jacobian), residual)
        found = found - step
        if abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-9:  # quadratic: the error is round-off
            return found, determinant(jacobian) / robot.l3
    return found, 0.0


@kernel
def forward_kinematics(robot: RobotParameters, theta: Array, guess: Array) -> Assembly:
    """Pose at given joint angles, on the assembly mode of the guess.

    Follows the straight line of joint angles from those of the guess to the given ones, in steps
    within which Newton's iteration provably converges to the solution next to it; near samples
    take one step. A path through a type 2 singularity ends in a failure, never on another branch.

    Args:
        robot: The robot.
        theta: Actuated angles [rad], shape (3,); whole turns do not matter.
        guess: A pose near the solution, e.g. the previous one, shape (3,).

    Returns:
        Pose, distal angles and status.
    """
    start = inverse_kinematics(robot, guess)
    beta = np.full(3, np.nan)
    if start.out_of_reach >= 0:
        return Assembly(guess, beta, GUESS_OUT_OF_REACH)
    change = np.empty(3)
    for i in range(3):
        turn = theta[i] - start.theta[i]
        change[i] = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    largest = max(abs(change[0]), abs(change[1]), abs(change[2]))
    pose = guess
    side = determinant(jacobian_x(robot, guess[2], start.beta)) / robot.l3
    done = 0.0
    part = 1.0 if largest < LONGEST_STEP else LONGEST_STEP / largest
    shortest = 1e-3 * part
    cranks = np.empty((3, 2))
    while done < 1.0:
        if not part > shortest or not abs(side) > SINGULAR:
            return Assembly(guess, beta, NOT_CONVERGED)
        share = min(1.0, done + part)
        target = theta if share == 1.0 else start.theta + share * change
        cranks = _cranks(robot, target)
        found, determinant_found = _newton(robot, cranks, pose)
        if determinant_found * side > 0.0:
            pose = found
            side = determinant_found
            done = share
        else:
            part *= 0.5
    if not abs(side) > SINGULAR:
        return Assembly(guess, beta, NOT_CONVERGED)
    for i in range(3):
        angle = pose[2] + robot.platform_angle[i]
        dx = pose[0] + robot.l3 * math.cos(angle) - (robot.base_x[i] + cranks[i, 0])
        dy = pose[1] + robot.l3 * math.sin(angle) - (robot.base_y[i] + cranks[i, 1])
        beta[i] = math.atan2(dy, dx)
        if not robot.working_mode[i] * (cranks[i, 0] * dy - cranks[i, 1] * dx) < 0.0:
            return Assembly(guess, beta, WRONG_WORKING_MODE)
    return Assembly(pose, beta, FOUND)


@kernel
def velocity_maps(
    robot: RobotParameters, phi: float, theta: Array, beta: Array, rate: Array
) -> Rates:
    """H, K and their rates, from the loop closure differentiated twice.

    With B_i = [1 0 -l3 sin(a); 0 1 l3 cos(a)], a = phi + gamma_i, the platform joint moves with
    B_i Xdot; l1 sin(psi) thetadot = u(beta)^T B Xdot, -l2 sin(psi) betadot = u(theta)^T B Xdot.

    Args:
        robot: The robot.
        phi: Platform angle [rad].
        theta: Actuated angles [rad], shape (3,).
        beta: Distal angles [rad], shape (3,).
        rate: Pose rate [m/s, m/s, rad/s], shape (3,).

    Returns:
        The maps; not finite at a type 1 singularity.
    """
    H = np.empty((3, 3))
    K = np.empty((3, 3))
    H_dot = np.empty((3, 3))
    K_dot = np.empty((3, 3))
    for i in range(3):
        ct, st = math.cos(theta[i]), math.sin(theta[i])
        cb, sb = math.cos(beta[i]), math.sin(beta[i])
        px = robot.l3 * math.cos(phi + robot.platform_angle[i])
        py = robot.l3 * math.sin(phi + robot.platform_angle[i])
        sin_psi = sb * ct - cb * st
        cos_psi = cb * ct + sb * st
        to_theta = 1.0 / (robot.l1 * sin_psi)
        to_beta = -1.0 / (robot.l2 * sin_psi)
        H[i, 0] = to_theta * cb
        H[i, 1] = to_theta * sb
        H[i, 2] = to_theta * (sb * px - cb * py)
        K[i, 0] = to_beta * ct
        K[i, 1] = to_beta * st
        K[i, 2] = to_beta * (st * px - ct * py)
        theta_dot = H[i, 0] * rate[0] + H[i, 1] * rate[1] + H[i, 2] * rate[2]
        beta_dot = K[i, 0] * rate[0] + K[i, 1] * rate[1] + K[i, 2] * rate[2]
        shrink = cos_psi / sin_psi * (beta_dot - theta_dot)
        H_dot[i, 0] = to_theta * -sb * beta_dot - shrink * H[i, 0]
        H_dot[i, 1] = to_theta * cb * beta_dot - shrink * H[i, 1]
        H_dot[i, 2] = to_theta * (cb * px + sb * py) * (beta_dot - rate[2]) - shrink * H[i, 2]
        K_dot[i, 0] = to_beta * -st * theta_dot - shrink * K[i, 0]
        K_dot[i, 1] = to_beta * ct * theta_dot - shrink * K[i, 1]
        K_dot[i, 2] = to_beta * (ct * px + st * py) * (theta_dot - rate[2]) - shrink * K[i, 2]
    return Rates(H, K, H_dot, K_dot)


def pose_of(robot: RobotParameters, theta: Array, guess: Array) -> Array:
    """Forward kinematics for one sample or a row of them, each begun at the pose before.

    Args:
        robot: The robot.
        theta: Actuated angles [rad], shape (3,) or (N, 3).
        guess: A pose near the first one, shape (3,).

    Returns:
        Poses [m, m, rad], shape (3,) or (N, 3).

    Raises:
        KinematicsError: no pose on the guess's assembly mode fits.
    """
    angles = np.ascontiguousarray(np.atleast_2d(theta), dtype=np.float64)
    poses, failed, status = _poses(robot, angles, np.asarray(guess, dtype=np.float64))
    if status != FOUND:
        raise KinematicsError(
            f'forward kinematics: {STATUS_TEXT[status]} (sample {failed}, '
            f'theta = {np.round(angles[failed], 4).tolist()} rad)'
        )
    return poses[0] if np.ndim(theta) == 1 else poses


@kernel
def _poses(robot: RobotParameters, theta: Array, guess: Array) -> tuple[Array, int, int]:
    poses = np.empty_like(theta)
    for k in range(len(theta)):
        assembly = forward_kinematics(robot, theta[k], guess)
        if assembly.status != FOUND:
            return poses, k, assembly.status
        poses[k] = assembly.pose
        guess = assembly.pose
    return poses, -1, FOUND
