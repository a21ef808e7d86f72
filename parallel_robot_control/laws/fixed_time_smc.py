"""Second-order sliding mode control with a settling time that no initial error exceeds."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import (
    Array,
    ControlOutput,
    Field,
    InputError,
    inverse_dynamics,
    kernel,
)
from parallel_robot_control.terms import saturate, sig

TITLE = 'fixed-time SMC'


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    alpha1: Annotated[float, Field('rad/s^2', 'of the surface, near zero error', 0.0)]
    beta1: Annotated[float, Field('1/(rad s^2)', 'of the surface, far from zero error', 0.0)]
    alpha2: Annotated[float, Field('rad/s^3', 'of the reaching law, near the surface', 0.0)]
    beta2: Annotated[float, Field('1/(rad s)', 'of the reaching law, far from the surface', 0.0)]
    G: Annotated[float, Field('rad/s^2', 'bound of the lumped uncertainty', 0.0)]
    u: Annotated[float, Field('rad/s', 'thickness of the boundary layer', 1e-6)]


def validate_gains(gains: Gains) -> list[str]:
    """Refuse gains without a settling time.

    Raises:
        InputError: alpha1, beta1, alpha2 or beta2 is zero.
    """
    for name in ('alpha1', 'beta1', 'alpha2', 'beta2'):
        if getattr(gains, name) == 0.0:
            raise InputError(f'{name} must be positive: with 0 there is no settling time')
    return []


def initial_memory(joints: int) -> Array:
    """Empty: the law has no memory."""
    return np.zeros(0)


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        S   = e' + sig(sig(e', 2) + alpha1 e + beta1 sig(e, 3), 1/2)
        w   = (alpha1 + 3 beta1 e^2 + 2 G) / 2 sat(S / u) + sig(alpha2 S + beta2 sig(S, 3), 1/2)
        tau = M (thdd_d + w) + Q thd

    The source has sgn(S) in place of sat(S / u). Then, as long as the acceleration that the model
    does not explain stays below G, S and e vanish, from any initial error, not later than

        2 / sqrt(alpha2) + 2 / sqrt(beta2) + 2 sqrt(2 / alpha1) + 2 sqrt(2 / beta1)   [s].

    The boundary layer removes the chattering and leaves an error: on its edge, |e| = u^2 / alpha1.

    Returns:
        Torque [N m], S [rad/s], memory.

    Source:
        Polyakov (2012), Nonlinear feedback design for fixed-time stabilization of linear control
        systems, IEEE TAC 57(8): Lemma 1 for the time, the nested sliding mode of order two for
        the law.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    S = e_dot + sig(sig(e_dot, 2.0) + gains.alpha1 * e + gains.beta1 * sig(e, 3.0), 0.5)
    gain = 0.5 * (gains.alpha1 + 3.0 * gains.beta1 * e * e) + gains.G
    w = gain * saturate(S / gains.u) + sig(gains.alpha2 * S + gains.beta2 * sig(S, 3.0), 0.5)
    torque = inverse_dynamics(model, reference.acceleration + w, feedback.velocity)
    return ControlOutput(torque, S, e, memory)
