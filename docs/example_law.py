"""Computed torque with friction compensation: an example of a custom law."""

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot.law import ControlOutput, Field, inverse_dynamics, kernel


class Gains(NamedTuple):
    Kp: Annotated[float, Field('1/s^2', 'gain of the error', 0.0)] = 900.0
    Kd: Annotated[float, Field('1/s', 'gain of its rate', 0.0)] = 60.0
    viscous: Annotated[float, Field('N m s/rad', 'viscous friction', 0.0)] = 2.5


def initial_memory(joints):
    return np.zeros(0)  # this law remembers nothing


@kernel
def update(gains, model, reference, feedback, memory, dt):
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    acceleration = reference.acceleration + gains.Kd * e_dot + gains.Kp * e
    torque = inverse_dynamics(model, acceleration, feedback.velocity)
    torque += gains.viscous * reference.velocity
    return ControlOutput(torque, e, e, memory)
