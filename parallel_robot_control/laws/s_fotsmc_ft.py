"""S-FOTSMC whose synchronisation errors converge in finite time too."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import Field, kernel
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.terms import sig
from parallel_robot_model.compiler import select

TITLE = 'S-FOTSMC-FT'

initial_memory = s_fotsmc.initial_memory
validate_gains = s_fotsmc.validate_gains


class Gains(NamedTuple):
    """Gains of S-FOTSMC, and the exponent of the coupling."""

    lambda_: Annotated[float, Field('rad^(1-p)/s', 'weight of the synchronisation errors', 0.0)]
    p: Annotated[float, Field('', 'exponent of the synchronisation errors', 0.1, 1.0)]
    clip: Annotated[float, Field('rad', 'error below which the slope of sig is kept', 1e-9)]
    G: Annotated[float, Field('rad/s^3', 'bound of the rate of the lumped uncertainty', 0.0)]
    g: Annotated[float, Field('rad/s^3', 'margin above the bound', 0.0)]
    Gamma1: Annotated[float, Field('rad^(1-gamma1)/s^2', 'weight of the coupled error', 0.0)]
    Gamma2: Annotated[float, Field('(rad/s)^(1-gamma2)/s', 'weight of its rate', 0.0)]
    gamma1: Annotated[float, Field('', 'exponent of the coupled error', 0.0, 1.0)]
    gamma2: Annotated[float, Field('', 'exponent of its rate', 0.0, 1.0)]


@kernel
def _edges(error):
    """e_i - e_(i+1) around the ring, shape (n,)."""
    return error - np.roll(error, -1)


@kernel
def _gather(edge):
    """edge_i - edge_(i-1), shape (n,); its sum is zero whatever the edges are."""
    return edge - np.roll(edge, 1)


@kernel
def _root(x, p, clip):
    """sig(x, p), linear where |x| < clip so that its slope stays finite, shape (n,)."""
    return select(np.abs(x) < clip, clip ** (p - 1.0) * x, sig(x, p))


@kernel
def _root_slope(x, p, clip):
    """Derivative of :func:`_root`, shape (n,)."""
    return select(np.abs(x) < clip, clip ** (p - 1.0), p * np.abs(x) ** (p - 1.0))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle: S-FOTSMC, its coupling edge by edge.

        De_i = sig(e_s,i, p) - sig(e_s,(i-1), p),   e_s,i = e_i - e_(i+1).

    On e_c = 0 the errors obey e' = -lambda De. With p = 1 that is the paper's linear coupling, and
    synchronisation errors decay exponentially; with p < 1 they reach zero in finite time. The sum
    of De is zero as before, so the mean error is not disturbed. Below `clip` the power is replaced
    by a line: its slope would be infinite at zero, and De' with it.

    Returns:
        Torque [N m], S [rad/s^2], new memory.

    Source:
        Doan, Le, Vo (2019), eqs. (12)-(17); Wang, Xiao (2010), Finite-time consensus problems for
        networks of dynamic agents, IEEE TAC 55(4), for the edge-wise power.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    edge = _edges(e)
    De = _gather(_root(edge, gains.p, gains.clip))
    De_dot = _gather(_root_slope(edge, gains.p, gains.clip) * _edges(e_dot))
    output = s_fotsmc.with_coupling(gains, De, De_dot, model, reference, feedback, memory, dt)
    rate = (gains.G + gains.g) * np.sign(output.sliding_variable)
    return s_fotsmc.switched(output, rate, feedback.excess)
