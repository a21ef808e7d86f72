"""Continuous twisting: a third-order sliding mode of the error under continuous torque."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import ControlOutput, Field, InputError, inverse_dynamics, kernel
from parallel_robot_control.terms import Integral, advanced, sig, unless_saturated, zero_integral

TITLE = 'continuous twisting'


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    k1: Annotated[float, Field('rad^(2/3)/s^2', 'gain of the cube root of the error', 0.0)]
    k2: Annotated[float, Field('(rad/s)^0.5/s', 'gain of the square root of its rate', 0.0)]
    k3: Annotated[float, Field('rad/s^3', 'gain of the sign of the error, integrated', 0.0)]
    k4: Annotated[float, Field('rad/s^3', 'gain of the sign of its rate, integrated', 0.0)]


def validate_gains(gains: Gains) -> list[str]:
    """Refuse gains without which the error would not reach zero in finite time.

    Raises:
        InputError: k1 or k2 is zero, or k3 is not above k4.
    """
    for name in ('k1', 'k2'):
        if getattr(gains, name) == 0.0:
            raise InputError(f'{name} must be positive, not 0')
    if gains.k3 > gains.k4:
        return []
    raise InputError(f'k3 must be above k4 = {gains.k4:g}, not {gains.k3:g}')


class Memory(NamedTuple):
    """Integral term w [rad/s^2]."""

    integral: Integral


def initial_memory(joints: int) -> Memory:
    """Integral zero."""
    return Memory(zero_integral(joints))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        tau = M (thdd_d + k1 sig(e, 1/3) + k2 sig(e', 1/2) + w) + Q thd
        w'  = k3 sgn(e) + k4 sgn(e')

    There is no surface: e and e' themselves reach zero in finite time, and w becomes the lumped
    uncertainty, as long as its rate stays below a bound L. Gains for another bound follow from
    k1 ~ L^(2/3), k2 ~ L^(1/2), k3 ~ k4 ~ L.

    Returns:
        Torque [N m], e [rad] in place of a sliding variable, new memory.

    Source:
        Torres-Gonzalez, Sanchez, Fridman, Moreno (2017), Design of continuous twisting algorithm,
        Automatica 80.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    w = advanced(memory.integral, dt)
    pull = gains.k1 * sig(e, 1.0 / 3.0) + gains.k2 * sig(e_dot, 0.5)
    torque = inverse_dynamics(model, reference.acceleration + pull + w, feedback.velocity)
    rate = unless_saturated(gains.k3 * np.sign(e) + gains.k4 * np.sign(e_dot), feedback.excess)
    return ControlOutput(torque, e, e, Memory(Integral(w, rate)))
