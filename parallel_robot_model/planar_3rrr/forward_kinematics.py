"""Forward kinematics: the pose at given joint angles, in one assembly mode."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel
from parallel_robot_base.linear_algebra import determinant, inverse, multiply
from parallel_robot_model.contract import FOUND
from parallel_robot_model.planar_3rrr.kinematics import inverse_kinematics, jacobian_x
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

Array = NDArray[np.float64]

# Why there is no trustworthy pose.
GUESS_OUT_OF_REACH = 1
NOT_CONVERGED = 2
WRONG_WORKING_MODE = 3
LONGEST_STEP = 0.05  # rad, of the path that the forward kinematics follows
SINGULAR = 0.02  # |det Jx| / l3 below which the branch is not trusted
STATUS_TEXT = {
    GUESS_OUT_OF_REACH: 'the guess is out of reach',
    NOT_CONVERGED: 'no pose on the same assembly mode fits the joint angles',
    WRONG_WORKING_MODE: 'an elbow has folded to the other side',
}


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
    """Newton's iteration on the loop closure, started only where it is known to converge.

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
    # 1. The first step J^-1 r; size = |step|, with the angle as l3 phi.
    _close(robot, cranks, pose, residual, jacobian)
    inverted = inverse(jacobian)
    step = multiply(inverted, residual)
    size = math.sqrt(step[0] ** 2 + step[1] ** 2 + (robot.l3 * step[2]) ** 2)
    # 2. Squared Frobenius norm of J^-1 (in the same units), and d, a bound of |C_i - E_i|.
    norm = 0.0
    distance = 0.0
    for i in range(3):
        norm += inverted[0, i] ** 2 + inverted[1, i] ** 2 + (robot.l3 * inverted[2, i]) ** 2
        distance = max(distance, robot.l2 * math.hypot(jacobian[i, 0], jacobian[i, 1]))
    distance += 2.0 * math.sqrt(2.0) * size  # the solution lies within two steps
    # 3. The condition L |J^-1| |step| <= 1/2; NaN does not meet it.
    bound = math.sqrt(3.0) * (2.0 + distance / robot.l3) / robot.l2
    if not bound * math.sqrt(norm) * size <= 0.5:
        return pose, 0.0
    # 4. Newton: X <- X - J^-1 r until the step vanishes.
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
    """Pose at given joint angles, in the assembly mode of the guess.

    Follows the straight line of joint angles from those of the guess to the given ones, in steps
    within which Newton's iteration provably converges to the solution near it; close samples
    take one step. A path through a type 2 singularity ends in a failure, never on another branch.

    Args:
        robot: The robot.
        theta: Actuated angles [rad], shape (3,); whole turns do not matter.
        guess: A pose near the solution, e.g. the previous one, shape (3,).

    Returns:
        Pose, distal angles and status.
    """
    # 1. Joint angles of the guess.
    start = inverse_kinematics(robot, guess)
    beta = np.full(3, np.nan)
    if start.out_of_reach >= 0:
        return Assembly(guess, beta, GUESS_OUT_OF_REACH)
    # 2. Change of each angle to the given one, in [-pi, pi).
    change = np.empty(3)
    for i in range(3):
        turn = theta[i] - start.theta[i]
        change[i] = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    largest = max(abs(change[0]), abs(change[1]), abs(change[2]))
    # 3. Path theta_guess + s change, s = 0 ... 1: a step that fails or changes the sign of
    #    det Jx is halved; the path ends at a type 2 singularity.
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
    # 4. Distal links C_i - E_i: angles beta_i, and the side of each elbow by the sign of
    #    l1 u(theta_i) x (C_i - E_i).
    for i in range(3):
        angle = pose[2] + robot.platform_angle[i]
        dx = pose[0] + robot.l3 * math.cos(angle) - (robot.base_x[i] + cranks[i, 0])
        dy = pose[1] + robot.l3 * math.sin(angle) - (robot.base_y[i] + cranks[i, 1])
        beta[i] = math.atan2(dy, dx)
        if not robot.working_mode[i] * (cranks[i, 0] * dy - cranks[i, 1] * dx) < 0.0:
            return Assembly(guess, beta, WRONG_WORKING_MODE)
    return Assembly(pose, beta, FOUND)
