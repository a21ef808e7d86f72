"""Synchronization Sliding Mode Control with a boundary layer (S-SMC)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.law import ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_control.terms import (
    Integral,
    advanced,
    coupling,
    saturate,
    unless_any_saturated,
    zero_integral,
)

TITLE = 'S-SMC'


class Gains(NamedTuple):
    """Gains of Table 2."""

    lambda_: Annotated[float, Field('1/s', 'weight of the synchronisation errors', 0.0)]
    z: Annotated[float, Field('1/s', 'slope of the sliding surface', 0.0)]
    K: Annotated[float, Field('N m s/rad', 'gain of the sliding variable', 0.0)]
    G: Annotated[float, Field('N m', 'bound of the lumped uncertainty', 0.0)]
    g: Annotated[float, Field('N m', 'margin above the bound', 0.0)]
    u: Annotated[float, Field('rad/s', 'thickness of the boundary layer', 1e-6)]


class Memory(NamedTuple):
    """int De~ dt [rad s]."""

    coupling: Integral


def initial_memory(joints: int) -> Memory:
    """Integral zero."""
    return Memory(zero_integral(joints))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        S   = e~_c' + z e~_c,   e~_c = e~ + lambda int De~ dt,   e~ = theta - theta_d
        tau = M thdd_R + Q thd_R - K S - (G + g) sat(S / u)
        thd_R = thd_d - lambda De~ - z e~_c

    The printed surface and reference velocity contradict each other; this is the standard form
    with the coupled error, in which S = thd - thd_R holds.

    Returns:
        Torque [N m], S [rad/s], new memory.

    Source:
        Doan, Le, Vo (2019), eqs. (A5)-(A8), restored.
    """
    e = feedback.position - reference.position
    e_dot = feedback.velocity - reference.velocity
    De = coupling(e)
    integral = advanced(memory.coupling, dt)
    e_c = e + gains.lambda_ * integral
    e_c_dot = e_dot + gains.lambda_ * De
    S = e_c_dot + gains.z * e_c
    acceleration = reference.acceleration - gains.lambda_ * coupling(e_dot) - gains.z * e_c_dot
    velocity = reference.velocity - gains.lambda_ * De - gains.z * e_c
    torque = (
        inverse_dynamics(model, acceleration, velocity)
        - gains.K * S
        - (gains.G + gains.g) * saturate(S / gains.u)
    )
    rate = unless_any_saturated(De, feedback.excess)
    return ControlOutput(torque, S, -e_c, Memory(Integral(integral, rate)))
