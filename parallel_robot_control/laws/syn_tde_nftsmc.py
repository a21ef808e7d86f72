"""Synchronisation, nonsingular fast terminal sliding mode, and time delay estimation."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import Array, ControlOutput, Field, InputError, kernel
from parallel_robot_control.laws.nftsmc import classical
from parallel_robot_control.laws.tdc import unexplained
from parallel_robot_control.terms import (
    Integral,
    advanced,
    coupling,
    saturate,
    unless_any_saturated,
    zero_integral,
)
from parallel_robot_model.compiler import vector

TITLE = 'Syn-TDE-NFTSMC'
MODEL = False


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    inertia: Annotated[
        float, Field('kg m^2', 'Mbar, less than twice the least eigenvalue of M', 1e-9)
    ]
    lambda_: Annotated[float, Field('1/s', 'weight of the synchronisation errors', 0.0)]
    Gamma1: Annotated[
        float, Field('rad^(1-gamma1)', 'weight of the power of the coupled error', 0.0)
    ]
    Gamma2: Annotated[float, Field('rad (s/rad)^gamma2', "weight of its rate's power", 1e-9)]
    gamma1: Annotated[float, Field('', 'exponent of the coupled error', 1.0)]
    gamma2: Annotated[float, Field('', 'exponent of its rate', 1.0, 2.0)]
    G: Annotated[float, Field('rad/s^2', 'bound of the error of the estimate', 0.0)]
    u: Annotated[float, Field('rad', 'thickness of the boundary layer', 1e-9)]


def validate_gains(gains: Gains) -> list[str]:
    """Refuse exponents for which the surface is not proved.

    Raises:
        InputError: gamma2 is not between 1 and 2, or gamma1 is not above it.
    """
    if not 1.0 < gains.gamma2 < 2.0:
        raise InputError(f'gamma2 must lie between 1 and 2, not be {gains.gamma2:g}')
    if not gains.gamma1 > gains.gamma2:
        raise InputError(f'gamma1 must be above gamma2 = {gains.gamma2:g}, not {gains.gamma1:g}')
    return []


class Memory(NamedTuple):
    """The integral of the coupling, and the last sample, each shape (n,)."""

    coupling: Integral  # int De dt [rad s]
    torque: Array  # demanded torque [N m]
    velocity: Array  # measured rates [rad/s]
    started: float  # 0 before the first update, then 1


def initial_memory(joints: int) -> Memory:
    """Zeros: the first update has nothing to estimate from."""
    zero = vector(np.zeros(joints))
    return Memory(zero_integral(joints), zero, zero, 0.0)


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        e_c = e + lambda int De dt
        S   = e_c + Gamma1 sig(e_c, gamma1) + Gamma2 sig(e_c', gamma2)
        w   = sig(e_c', 2-gamma2) (1 + Gamma1 gamma1 |e_c|^(gamma1-1)) / (Gamma2 gamma2)
        tau = Mbar (thdd_d + lambda De' + w + G sat(S / u)) + N_k,
        N_k = tau_(k-1) - Mbar (thd_k - thd_(k-1)) / dt

    Returns:
        Torque [N m], S [rad], new memory.

    Source:
        Appl. Sci. 12(11), 5527 (2022), and 15(9), 5206 (2025), whose abstracts name the parts; put
        together here of Yang, Yang (2011), Nonsingular fast terminal sliding-mode control, for
        the surface, and of TDC for N_k.
    """
    # 1. The cross-coupling error and the surface.
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    De, De_dot = coupling(e), coupling(e_dot)
    integral = advanced(memory.coupling, dt)
    e_c, e_c_dot = e + gains.lambda_ * integral, e_dot + gains.lambda_ * De
    S, w = classical(gains, e_c, e_c_dot)
    # 2. All that is not Mbar thdd, as it was over the last interval.
    N = unexplained(gains.inertia, feedback, memory, dt)
    wanted = reference.acceleration + gains.lambda_ * De_dot + w + gains.G * saturate(S / gains.u)
    torque = gains.inertia * wanted + N
    after = Integral(integral, unless_any_saturated(De, feedback.excess))
    return ControlOutput(torque, S, e_c, Memory(after, torque, feedback.velocity, 1.0))
