"""Terms that laws share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import Law
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, internal, kernel, multiply, select, some, vector
from parallel_robot_model.robots.contract import FOUND
from parallel_robot_model.robots.registry import RobotModel

# Conditional integration: the integrals of a law do not wind up while the torque is limited.


@kernel
def unless_saturated(increment: Array, excess: Array) -> Array:
    """Increments of integrals in the torque; zero where they would increase the excess.

    Args:
        increment: Increment of the integral of each joint, shape (n,).
        excess: Torque beyond the limits [N m], shape (n,).

    Source:
        Astrom, Haegglund (1995), PID Controllers, section 3.5, conditional integration.
    """
    return select(increment * excess > 0.0, 0.0, increment)


@kernel
def unless_any_saturated(increment: Array, excess: Array) -> Array:
    """The increments, shape (n,); zero for all joints while any joint is saturated.

    For integrals of differences between joints: their sum remains zero.
    """
    return select(some(excess != 0.0), np.zeros_like(increment), increment)


@kernel
def coupling(error: Array) -> Array:
    """De_i = e_s,i - e_s,(i-1) = 2 e_i - e_(i-1) - e_(i+1), shape (n,); see ring.py."""
    return 2.0 * error - np.roll(error, 1) - np.roll(error, -1)


# Integrals of a law by forward Euler, for any time between two samples.


class Integral(NamedTuple):
    """An integral at the last sample and its rate there, each shape (n,).

    It advances when the next sample comes, because only then is the time between the two known: it
    is twice as long if a state was lost.
    """

    value: Array
    rate: Array


def zero_integral(joints: int) -> Integral:
    """An integral that starts at zero."""
    zero = vector(np.zeros(joints))
    return Integral(zero, zero)


@kernel
def advanced(integral: Integral, dt: float) -> Array:
    """Value of an integral `dt` [s] after the last sample, shape (n,)."""
    return integral.value + dt * integral.rate


# Functions for switching and terminal terms: sig(x) and sat(x).


@kernel
def sig(x: Array, exponent: float) -> Array:
    """|x|^exponent sgn(x), element-wise, shape (n,)."""
    return np.copysign(np.abs(x) ** exponent, x)


@kernel
def saturate(x: Array) -> Array:
    """Each element of `x` clipped to -1 ... 1, shape (n,)."""
    return clip(x, -1.0, 1.0)


# How the place of the end effector follows from the joints, for laws that ask for it.

STEP = 1e-5  # rad or m, of a difference
NO_PLACE_REQUESTED = -1  # of a law that does not ask


def requested_place(law: Law, robot: RobotModel) -> int:
    """Number of the coordinates of the place, 0 to 3, that a law asks for; or NO_PLACE."""
    return robot.place if law.PLACE else NO_PLACE_REQUESTED


@internal
def place_gradient(locate: Any, robot: Any, place: int, position: Array, pose: Array) -> Array:
    """A^T A, A the derivative of the place by the joints, shape (n, n).

    By central differences of the forward kinematics, which every robot has. Where there is no
    place, or none beside the present one, all joints are to be held: the identity.

    Args:
        locate: Forward kinematics, see Robot.locate.
        robot: Constants of the robot.
        place: Number of the first coordinates of a pose that are the place.
        position: Joints [rad or m], shape (n,).
        pose: Their pose, shape (m,).
    """
    zero = np.zeros_like(position)
    one = np.diag(zero + 1.0)
    x, y, z = zero, zero, zero
    if place == 0:
        return one
    for j in range(len(position)):
        ahead = locate(robot, position + STEP * one[j], pose)
        back = locate(robot, position - STEP * one[j], pose)
        if ahead.fault != FOUND or back.fault != FOUND:
            return one
        slope = (ahead.pose - back.pose) / (2.0 * STEP)
        for k in range(place):
            share = slope[k] * one[j]
            x = x + select(k == 0, share, zero)
            y = y + select(k == 1, share, zero)
            z = z + select(k == 2, share, zero)
    return _outer(x) + _outer(y) + _outer(z)


@internal
def _outer(a: Array) -> Array:
    """a a^T."""
    diagonal = np.diag(a)
    return multiply(multiply(diagonal, np.zeros_like(diagonal) + 1.0), diagonal)
