"""Tracking by the certainty-equivalence principle (LQG): an optimal law on estimated states."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_model.compiler import vector

TITLE = 'LQG tracking'
ESTIMATOR = 'kalman'


class Gains(NamedTuple):
    """Weights of the criterion, by the poles that follow from them."""

    bandwidth: Annotated[float, Field('1/s', 'modulus of both poles of the error', 1e-6)]


def initial_memory(joints: int) -> Array:
    """Empty: the law has no memory but that of the estimator."""
    return vector(())


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        tau = M (thdd_d + sqrt(2) b e' + b^2 e) + Q thd + d

    e is the error of the motion that the Kalman filter predicts for the moment at which the torque
    acts, d the disturbance that it estimates. With the model inverted each joint is a double
    integrator, e'' = u; the law minimises int b^4 e^2 + u^2 dt, whose poles are at
    b (-1 +- i) / sqrt(2).

    Returns:
        Torque [N m], e [rad] in place of a sliding variable, memory.

    Source:
        Anderson, Moore (1990), Optimal Control: Linear Quadratic Methods, chapters 3 and 8.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    b = gains.bandwidth
    acceleration = reference.acceleration + math.sqrt(2.0) * b * e_dot + b * b * e
    torque = inverse_dynamics(model, acceleration, feedback.velocity) + feedback.disturbance
    return ControlOutput(torque, e, e, memory)
