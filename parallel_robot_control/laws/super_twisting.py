"""Super-twisting control: a continuous second-order sliding mode."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_control.terms import Integral, advanced, sig, unless_saturated, zero_integral

TITLE = 'super-twisting'


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    z: Annotated[float, Field('1/s', 'slope of the sliding surface', 0.0)]
    k1: Annotated[float, Field('(rad/s)^0.5/s', 'gain of the square root', 0.0)]
    k2: Annotated[float, Field('rad/s^3', 'gain of the integral', 0.0)]


class Memory(NamedTuple):
    """Integral term w [rad/s^2]."""

    integral: Integral


def initial_memory(joints: int) -> Memory:
    """Integral zero."""
    return Memory(zero_integral(joints))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        S   = e' + z e
        tau = M (thdd_d + z e' + k1 sig(S, 1/2) + w) + Q thd,   w' = k2 sgn(S)

    Returns:
        Torque [N m], S [rad/s], new memory.

    Source:
        Levant (1993), Int. J. Control 58(6); Moreno, Osorio (2012), IEEE TAC 57(4).
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    S = e_dot + gains.z * e
    w = advanced(memory.integral, dt)
    acceleration = reference.acceleration + gains.z * e_dot + gains.k1 * sig(S, 0.5) + w
    torque = inverse_dynamics(model, acceleration, feedback.velocity)
    rate = unless_saturated(gains.k2 * np.sign(S), feedback.excess)
    return ControlOutput(torque, S, e, Memory(Integral(w, rate)))
