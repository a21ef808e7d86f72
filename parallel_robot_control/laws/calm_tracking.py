"""Calm tracking: the place of the end effector by the least torque, its rotation held slowly."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_model.compiler import multiply, select, solve, vector

TITLE = 'calm tracking'
ESTIMATOR = 'kalman'
LEVELS = 1.0  # s
PLACE = True
TORQUE = 1e-4  # weight of the torque against the place, relative


class Gains(NamedTuple):
    """Weights of the criterion, by the poles that follow from them."""

    bandwidth: Annotated[float, Field('1/s', 'modulus of both poles of the place', 1e-6)]
    rotation: Annotated[float, Field('1/s', 'the same of what does not move the place', 1e-6)]


class Memory(NamedTuple):
    """What the law keeps."""

    slow: Array  # disturbance behind a low-pass filter [N m], shape (n,)
    begun: bool  # whether there is one


def initial_memory(joints: int) -> Memory:
    """Nothing known of the disturbance."""
    return Memory(vector(np.zeros(joints)), False)


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        f = M (sqrt(2) b e' + b^2 e) + d
        s = M (sqrt(2) r e' + r^2 e) + d_s,   d_s' = r (d - d_s)
        tau = M thdd_d + Q thd + s + M y,   y = (G + w M^2)^-1 G M^-1 (f - s)

    e, d as in LQG tracking, b the bandwidth, r that of the rotation; G = A^T A, A the Jacobian of
    the place of the end effector. y has the least |A (y - M^-1 (f - s))|^2 + w |M y|^2: the place
    moves as under the torque f, by the torque that is nearest to s. Where the place has as many
    coordinates as there are joints, or none, y = M^-1 (f - s): LQG tracking.

    Returns:
        Torque [N m], e [rad] in place of a sliding variable, memory.

    Source:
        Anderson, Moore (1990), Optimal Control: Linear Quadratic Methods, chapters 3 and 8, for b
        and r; Khatib (1987), IEEE J. Robotics and Automation 3(1), for the place; Nakamura,
        Hanafusa (1986), J. Dyn. Syst. Meas. Control 108(3), for the damped inverse.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    b, r = gains.bandwidth, gains.rotation
    share = select(memory.begun, 1.0 - math.exp(-r * dt), 1.0)
    slow = memory.slow + share * (feedback.disturbance - memory.slow)
    away = feedback.disturbance - slow
    u = math.sqrt(2.0) * (b - r) * e_dot + (b * b - r * r) * e + solve(model.M, away)
    M, G = model.M, feedback.place
    one = np.diag(np.zeros_like(e) + 1.0)
    w = TORQUE * np.sum(np.sum(one * G)) / np.sum(np.sum(M * M))
    y = solve(G + w * multiply(M, M), multiply(G, u))
    held = reference.acceleration + math.sqrt(2.0) * r * e_dot + r * r * e
    torque = inverse_dynamics(model, held + y, feedback.velocity) + slow
    return ControlOutput(torque, e, e, Memory(slow, True))
