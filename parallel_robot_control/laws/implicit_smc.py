"""First-order sliding mode control, discretised by backward Euler."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_model.compiler import clip, vector

TITLE = 'implicit SMC'


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    z: Annotated[float, Field('1/s', 'slope of the sliding surface', 0.0)]
    G: Annotated[float, Field('rad/s^2', 'bound of the lumped uncertainty', 0.0)]


def initial_memory(joints: int) -> Array:
    """Empty: the law has no memory."""
    return vector(())


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        S   = e' + z e
        tau = M (thdd_d + z e' + G sgn(s)) + Q thd,   s + dt G sgn(s) = S

    with s, the S that backward Euler foresees at the next sample, and sgn(0) any number from -1
    to 1: G sgn(s) = clip(S / dt, -G, G). It is a boundary layer of thickness dt G, which nobody
    has to choose. S stays at dt times the uncertainty.

    Returns:
        Torque [N m], S [rad/s], memory.

    Source:
        Acary, Brogliato (2010), Implicit Euler numerical scheme and chattering-free implementation
        of sliding mode systems, Systems and Control Letters 59(5).
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    S = e_dot + gains.z * e
    acceleration = reference.acceleration + gains.z * e_dot + clip(S / dt, -gains.G, gains.G)
    return ControlOutput(inverse_dynamics(model, acceleration, feedback.velocity), S, e, memory)
