"""Nonsingular Fast Terminal Sliding Mode Control with a boundary layer (NFTSMC)."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_control.terms import saturate, sig
from parallel_robot_model.compiler import vector

TITLE = 'NFTSMC'


class Gains(NamedTuple):
    """Gains of Table 2."""

    form: Annotated[
        Literal['printed', 'classical'],
        Field('', 'printed: the paper; classical: the surface of its source'),
    ]
    G: Annotated[float, Field('rad/s^2', 'bound of the lumped uncertainty', 0.0)]
    g: Annotated[float, Field('rad/s^2', 'margin above the bound', 0.0)]
    Gamma1: Annotated[float, Field('', 'first weight of the surface', 0.0)]
    Gamma2: Annotated[float, Field('', 'second weight of the surface', 0.0)]
    gamma1: Annotated[float, Field('', 'first exponent', 0.0)]
    gamma2: Annotated[float, Field('', 'second exponent', 0.0)]
    u: Annotated[float, Field('', 'thickness of the boundary layer, unit of S', 1e-6)]


def validate_gains(gains: Gains) -> list[str]:
    """Warn of exponents outside the condition under which the surface is proved.

    The exponents of Table 2 violate the condition printed for them, so this is a warning.
    """
    first, second = ('gamma1', 'gamma2') if gains.form == 'printed' else ('gamma2', 'gamma1')
    low, high = getattr(gains, first), getattr(gains, second)
    if 1.0 < low < 2.0 and high > low:
        return []
    return [
        f'the {gains.form} surface is proved for 1 < {first} < 2 and {second} > {first}, '
        f'not for {first} = {low:g} and {second} = {high:g}'
    ]


def initial_memory(joints: int) -> Array:
    """Empty: the law has no memory."""
    return vector(())


@kernel
def classical(gains, e, e_dot):
    """The classical surface S and its w, see :func:`update`, of any errors, each shape (n,).

    Args:
        gains: With Gamma1, Gamma2, gamma1 and gamma2.
        e: Error [rad], shape (n,).
        e_dot: Its rate [rad/s], shape (n,).
    """
    S = e + gains.Gamma1 * sig(e, gains.gamma1) + gains.Gamma2 * sig(e_dot, gains.gamma2)
    slope = gains.Gamma1 * gains.gamma1 * np.abs(e) ** (gains.gamma1 - 1.0)
    w = sig(e_dot, 2.0 - gains.gamma2) * (1.0 + slope) / (gains.Gamma2 * gains.gamma2)
    return S, w


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        printed    S = e' + Gamma1 sig(e, gamma1) + Gamma2 sig(e, gamma2)
                   w = (Gamma1 gamma1 |e|^(gamma1-1) + Gamma2 gamma2 |e|^(gamma2-1)) e'
        classical  S = e + Gamma1 sig(e, gamma1) + Gamma2 sig(e', gamma2)
                   w = sig(e', 2-gamma2) (1 + Gamma1 gamma1 |e|^(gamma1-1)) / (Gamma2 gamma2)
        tau = M (thdd_d + M^-1 Q thd + w + (G + g) sat(S / u))

    Returns:
        Torque [N m], S [rad/s] (printed) or [rad] (classical), memory.

    Source:
        Doan, Le, Vo (2019), eqs. (A9)-(A16).
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    if gains.form == 'printed':
        slope = gains.Gamma1 * gains.gamma1 * np.abs(e) ** (gains.gamma1 - 1.0)
        S = e_dot + gains.Gamma1 * sig(e, gains.gamma1) + gains.Gamma2 * sig(e, gains.gamma2)
        w = (slope + gains.Gamma2 * gains.gamma2 * np.abs(e) ** (gains.gamma2 - 1.0)) * e_dot
    else:
        S, w = classical(gains, e, e_dot)
    acceleration = reference.acceleration + w + (gains.G + gains.g) * saturate(S / gains.u)
    torque = inverse_dynamics(model, acceleration, feedback.velocity)
    return ControlOutput(torque, S, e, memory)
