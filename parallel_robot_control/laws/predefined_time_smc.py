"""Sliding mode control whose settling time is a parameter."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_control.terms import saturate, sig
from parallel_robot_model.compiler import select, vector

TITLE = 'predefined-time SMC'


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    T1: Annotated[float, Field('s', 'time on the surface until the error vanishes', 1e-3)]
    T2: Annotated[float, Field('s', 'time until the surface is reached', 1e-3)]
    p: Annotated[float, Field('', 'exponent of both', 0.01, 0.99)]
    G: Annotated[float, Field('rad/s^2', 'bound of the lumped uncertainty', 0.0)]
    u: Annotated[float, Field('rad/s', 'thickness of the boundary layer', 1e-6)]
    clip: Annotated[float, Field('rad', 'error below which the surface is a plane', 1e-9)]


def initial_memory(joints: int) -> Array:
    """Empty: the law has no memory."""
    return vector(())


@kernel
def settling(x, p, T):
    """The f of x' = -f(x), which is at zero after T [s] from wherever it begins, shape (n,)."""
    return np.exp(np.abs(x) ** p) * sig(x, 1.0 - p) / (p * T)


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        f(x, T) = exp(|x|^p) sig(x, 1-p) / (p T)
        S   = e' + f(e, T1)
        tau = M (thdd_d + f'(e, T1) e' + f(S, T2) + G sat(S / u)) + Q thd

    With sgn(S) in place of sat(S / u), and uncertainty below G, S vanishes until T2 and e until
    T1 + T2, whatever the error at the start. f' is infinite at 0: where |e| < clip, f is a line,
    and e decays with the time constant clip / f(clip, T1).

    Returns:
        Torque [N m], S [rad/s], memory.

    Source:
        Sanchez-Torres, Gomez-Gutierrez, Lopez, Loukianov (2018), A class of predefined-time stable
        dynamical systems, IMA J. Mathematical Control and Information 35(1), for f; the law is
        put together here.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    size, edge = np.abs(e), 0.0 * e + gains.clip
    steepest = settling(edge, gains.p, gains.T1) / gains.clip
    size = select(size < edge, edge, size)  # so that no power is infinite
    slope = np.exp(size**gains.p) * (gains.p + (1.0 - gains.p) * size ** (-gains.p))
    near = np.abs(e) < gains.clip
    f = select(near, steepest * e, settling(e, gains.p, gains.T1))
    f_slope = select(near, steepest, slope / (gains.p * gains.T1))
    S = e_dot + f
    w = f_slope * e_dot + settling(S, gains.p, gains.T2) + gains.G * saturate(S / gains.u)
    torque = inverse_dynamics(model, reference.acceleration + w, feedback.velocity)
    return ControlOutput(torque, S, e, memory)
