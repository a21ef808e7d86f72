"""Super-twisting control, discretised by backward Euler."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control.law import Array, ControlOutput, inverse_dynamics, kernel
from parallel_robot_control.laws.super_twisting import Gains as Gains
from parallel_robot_control.terms import unless_saturated
from parallel_robot_model.compiler import clip, select, vector

TITLE = 'implicit super-twisting'


class Memory(NamedTuple):
    """Integral term w [rad/s^2], shape (n,)."""

    integral: Array


def initial_memory(joints: int) -> Memory:
    """Integral zero."""
    return Memory(vector(np.zeros(joints)))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        S   = e' + z e,   w += dt k2 sgn(s)
        tau = M (thdd_d + z e' + k1 sig(s, 1/2) + w) + Q thd

    with the s that backward Euler foresees at the next sample, where the w before cancels the
    uncertainty: s + dt k1 sig(s, 1/2) + dt^2 k2 sgn(s) = S, sgn(0) any number from -1 to 1.

    Returns:
        Torque [N m], S [rad/s], new memory.

    Source:
        Brogliato, Polyakov, Efimov (2020), IEEE TAC 65(8); Xiong et al., arXiv 1905.00707.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    S = e_dot + gains.z * e
    # 1. The root r of |s|: r^2 + dt k1 r = |S| beyond what w can take.
    most, half = dt * gains.k2, 0.5 * dt * gains.k1
    beyond = select(np.abs(S) > dt * most, np.abs(S) - dt * most, np.zeros_like(S))
    root = beyond / (half + np.sqrt(half * half + beyond))
    # 2. The integral takes the rest at once.
    change = unless_saturated(clip(S / dt, -most, most), feedback.excess)
    w = memory.integral + change
    acceleration = reference.acceleration + gains.z * e_dot + gains.k1 * np.sign(S) * root + w
    torque = inverse_dynamics(model, acceleration, feedback.velocity)
    return ControlOutput(torque, S, e, Memory(w))
