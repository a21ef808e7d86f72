"""Computed torque control: the model inverted, a PD law around it."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_model.compiler import vector

TITLE = 'computed torque'


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    Kp: Annotated[float, Field('1/s^2', 'gain of the error', 0.0)]
    Kd: Annotated[float, Field('1/s', 'gain of its rate', 0.0)]


def initial_memory(joints: int) -> Array:
    """Empty: the law has no memory."""
    return vector(())


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle: M (thdd_d + Kd e' + Kp e) + Q thd.

    Returns:
        Torque [N m], e [rad] in place of a sliding variable, memory.

    Source:
        Siciliano et al. (2009), Robotics, section 8.5.2.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    acceleration = reference.acceleration + gains.Kd * e_dot + gains.Kp * e
    torque = inverse_dynamics(model, acceleration, feedback.velocity)
    return ControlOutput(torque, e, e, memory)
