"""Sliding Mode Control with a boundary layer (SMC)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_control.terms import saturate
from parallel_robot_model.compiler import vector

TITLE = 'SMC'


class Gains(NamedTuple):
    """Gains of Table 2."""

    z: Annotated[float, Field('1/s', 'slope of the sliding surface', 0.0)]
    G: Annotated[float, Field('N m', 'bound of the lumped uncertainty', 0.0)]
    g: Annotated[float, Field('N m', 'margin above the bound', 0.0)]
    u: Annotated[float, Field('rad/s', 'thickness of the boundary layer', 1e-6)]


def initial_memory(joints: int) -> Array:
    """Empty: the law has no memory."""
    return vector(())


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        S   = e~' + z e~,   e~ = theta - theta_d (the appendices' sign)
        tau = M thdd_R + Q thd_R - (G + g) sat(S / u),   thd_R = thd_d - z e~

    The switching term is a torque: it is not multiplied by M.

    Returns:
        Torque [N m], S [rad/s], memory.

    Source:
        Doan, Le, Vo (2019), eqs. (A1)-(A4).
    """
    e = feedback.position - reference.position
    e_dot = feedback.velocity - reference.velocity
    S = e_dot + gains.z * e
    torque = inverse_dynamics(
        model, reference.acceleration - gains.z * e_dot, reference.velocity - gains.z * e
    ) - (gains.G + gains.g) * saturate(S / gains.u)
    return ControlOutput(torque, S, -e, memory)
