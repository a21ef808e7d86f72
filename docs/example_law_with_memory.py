"""Computed torque with an integral of the error: an example of a custom law with memory."""

from typing import Annotated, NamedTuple

from parallel_robot_control.antiwindup import unless_saturated
from parallel_robot_control.contract import ControlOutput
from parallel_robot_control.integral import Integral, advanced, zero_integral
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import inverse_dynamics

TITLE = 'computed torque + I'  # in pictures and reports


class Gains(NamedTuple):
    Kp: Annotated[float, Field('1/s^2', 'gain of the error', 0.0)] = 1200.0
    Ki: Annotated[float, Field('1/s^3', 'gain of its integral', 0.0)] = 8000.0
    Kd: Annotated[float, Field('1/s', 'gain of its rate', 0.0)] = 60.0


class Memory(NamedTuple):
    error: Integral  # its value and its rate, each a number for each joint


def initial_memory(joints):
    return Memory(zero_integral(joints))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    integral = advanced(memory.error, dt)  # to this sample, with the rate of the last one
    correction = gains.Kd * e_dot + gains.Kp * e + gains.Ki * integral
    torque = inverse_dynamics(model, reference.acceleration + correction, feedback.velocity)
    rate = unless_saturated(e, feedback.excess)  # it does not wind up
    return ControlOutput(torque, e, e, Memory(Integral(integral, rate)))
