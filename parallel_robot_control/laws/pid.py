"""PID control of each joint, without a model: the industrial baseline."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.law import ControlOutput, Field, kernel
from parallel_robot_control.terms import Integral, advanced, unless_saturated, zero_integral

TITLE = 'PID'
MODEL = False


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    Kp: Annotated[float, Field('N m/rad', 'proportional gain', 0.0)]
    Ki: Annotated[float, Field('N m/(rad s)', 'integral gain', 0.0)]
    Kd: Annotated[float, Field('N m s/rad', 'derivative gain', 0.0)]


class Memory(NamedTuple):
    """int e dt [rad s]."""

    integral: Integral


def initial_memory(joints: int) -> Memory:
    """Integral zero."""
    return Memory(zero_integral(joints))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle: Kp e + Ki int e dt + Kd e'.

    Returns:
        Torque [N m], e [rad] in place of a sliding variable, new memory.

    Source:
        Astrom, Murray (2021), Feedback Systems, ch. 11.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    integral = advanced(memory.integral, dt)
    torque = gains.Kp * e + gains.Ki * integral + gains.Kd * e_dot
    rate = unless_saturated(e, feedback.excess)
    return ControlOutput(torque, e, e, Memory(Integral(integral, rate)))
