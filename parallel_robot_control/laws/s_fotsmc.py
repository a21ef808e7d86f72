"""Synchronization Full-Order Terminal Sliding Mode Control (S-FOTSMC)."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_control.law import (
    Array,
    ControlOutput,
    Field,
    InputError,
    inverse_dynamics,
    kernel,
)
from parallel_robot_control.terms import (
    Integral,
    advanced,
    coupling,
    sig,
    unless_any_saturated,
    unless_saturated,
    zero_integral,
)

TITLE = 'S-FOTSMC'
ROUNDING = 0.005  # of gamma2, which the paper rounds to two digits


class Gains(NamedTuple):
    """Gains of Table 2."""

    lambda_: Annotated[float, Field('1/s', 'weight of the synchronisation errors', 0.0)]
    G: Annotated[float, Field('rad/s^3', 'bound of the rate of the lumped uncertainty', 0.0)]
    g: Annotated[float, Field('rad/s^3', 'margin above the bound', 0.0)]
    Gamma1: Annotated[float, Field('rad^(1-gamma1)/s^2', 'weight of the coupled error', 0.0)]
    Gamma2: Annotated[float, Field('(rad/s)^(1-gamma2)/s', 'weight of its rate', 0.0)]
    gamma1: Annotated[float, Field('', 'exponent of the coupled error', 0.0, 1.0)]
    gamma2: Annotated[float, Field('', 'exponent of its rate', 0.0, 1.0)]


def validate_gains(gains: Any) -> list[str]:
    """Refuse gains that the theory of the full-order surface forbids.

    Args:
        gains: Gains of this law or of one with the same surface.

    Returns:
        Warnings: none.

    Raises:
        InputError: p^2 + Gamma2 p + Gamma1 is not Hurwitz, gamma1 is not inside (0, 1), or gamma2
            differs from 2 gamma1 / (1 + gamma1) by more than rounding to two digits.
    """
    if not (gains.Gamma1 > 0.0 and gains.Gamma2 > 0.0):
        raise InputError(
            'p^2 + Gamma2 p + Gamma1 must be Hurwitz: Gamma1 and Gamma2 positive, not '
            f'{gains.Gamma1:g} and {gains.Gamma2:g}'
        )
    if not 0.0 < gains.gamma1 < 1.0:
        raise InputError(f'gamma1 must lie between 0 and 1, not be {gains.gamma1:g}')
    wanted = 2.0 * gains.gamma1 / (1.0 + gains.gamma1)
    if abs(gains.gamma2 - wanted) > ROUNDING:
        raise InputError(
            f'gamma2 must be 2 gamma1 / (1 + gamma1) = {wanted:.4g}, not {gains.gamma2:g}'
        )
    return []


class Memory(NamedTuple):
    """Integrals and the last sample of v."""

    coupling: Integral  # int De dt [rad s]
    surface: Integral  # int Gamma2 sig(e_c') + Gamma1 sig(e_c) dt [rad/s]
    switching: Integral  # tau_sw [rad/s^2]
    v: Array  # the integral form of S at the last sample [rad/s], shape (n,)
    started: float  # 0 before the first update, then 1


def initial_memory(joints: int) -> Memory:
    """All integrals zero; tau_sw(0) = 0."""
    zero = zero_integral(joints)
    return Memory(zero, zero, zero, zero.value, 0.0)


@kernel
def without_switching(gains, model, reference, feedback, memory, dt):
    """The law without the rate of tau_sw, for any gains with lambda_, Gamma and gamma."""
    De = coupling(reference.position - feedback.position)
    De_dot = coupling(reference.velocity - feedback.velocity)
    return with_coupling(gains, De, De_dot, model, reference, feedback, memory, dt)


@kernel
def with_coupling(gains, De, De_dot, model, reference, feedback, memory, dt):
    """The law without the rate of tau_sw, with the coupling De [rad] and its rate De_dot [rad/s].

    Both have shape (n,); all other arguments are those of :func:`update`.
    """
    # 1. The cross-coupling error and its rate, eq. (10): e_c = e + lambda int De dt.
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    integral, surface = advanced(memory.coupling, dt), advanced(memory.surface, dt)
    tau_sw = advanced(memory.switching, dt)
    e_c = e + gains.lambda_ * integral
    e_c_dot = e_dot + gains.lambda_ * De
    # 2. The surface: S = d/dt (e_c' + int w dt), from the difference of two samples.
    w = gains.Gamma2 * sig(e_c_dot, gains.gamma2) + gains.Gamma1 * sig(e_c, gains.gamma1)
    v = e_c_dot + surface
    S = memory.started * (v - memory.v) / dt
    # 3. The torque, eqs. (15)-(17): equivalent control and tau_sw.
    acceleration = reference.acceleration + gains.lambda_ * De_dot + w + tau_sw
    torque = inverse_dynamics(model, acceleration, feedback.velocity)
    # 4. Integrals for the next sample; those that would wind up are held.
    after = Memory(
        Integral(integral, unless_any_saturated(De, feedback.excess)),
        Integral(surface, w),
        Integral(tau_sw, np.zeros_like(e)),
        v,
        1.0,
    )
    return ControlOutput(torque, S, e_c, after)


@kernel
def switched(output, rate, excess):
    """The output with a rate of tau_sw [rad/s^3], zero where the torque is saturated."""
    switching = Integral(output.memory.switching.value, unless_saturated(rate, excess))
    return with_switching(output, output.torque, switching)


@kernel
def with_switching(output, torque, switching):
    """The output with another torque [N m], shape (n,), and another integral tau_sw."""
    memory = output.memory
    return ControlOutput(
        torque,
        output.sliding_variable,
        output.coupled_error,
        Memory(memory.coupling, memory.surface, switching, memory.v, memory.started),
    )


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        S   = e_c'' + w,   w = Gamma2 sig(e_c', gamma2) + Gamma1 sig(e_c, gamma1)
        tau = M (thdd_d + M^-1 Q thd + lambda De' + w + tau_sw),   tau_sw' = (G + g) sgn(S)

    S needs the acceleration, which no joint state carries; its integral v = e_c' + int w dt needs
    velocities alone, and sgn(S_k) = sgn(v_k - v_(k-1)). The first update has no v before it and
    takes S = 0. Integrals advance by forward Euler from sample to sample; int w dt matters by its
    differences alone and cannot wind up.

    Returns:
        Torque [N m], S [rad/s^2] as the difference quotient of v, new memory.

    Source:
        Doan, Le, Vo (2019), eqs. (12)-(17); Feng, Han, Yu (2014), Automatica 50(4), for sgn(S)
        from velocities.
    """
    output = without_switching(gains, model, reference, feedback, memory, dt)
    rate = (gains.G + gains.g) * np.sign(output.sliding_variable)
    return switched(output, rate, feedback.excess)
