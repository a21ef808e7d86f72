"""Computed torque with an integral of the error: an example of a custom law with memory."""

from typing import Annotated, NamedTuple

from parallel_robot.law import (
    ControlOutput,
    Field,
    Integral,
    advanced,
    inverse_dynamics,
    kernel,
    unless_saturated,
    zero_integral,
)

TITLE = 'computed torque + I'  # in pictures and reports


class Gains(NamedTuple):
    Kp: Annotated[float, Field('1/s^2', 'gain of the error', 0.0)] = 1200.0
    Ki: Annotated[float, Field('1/s^3', 'gain of its integral', 0.0)] = 8000.0
    Kd: Annotated[float, Field('1/s', 'gain of its rate', 0.0)] = 60.0


def initial_memory(joints):
    return zero_integral(joints)  # its value and its rate, each a number for each joint


@kernel
def update(gains, model, reference, feedback, memory, dt):
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    integral = advanced(memory, dt)  # to this sample, with the rate of the last one
    correction = gains.Kd * e_dot + gains.Kp * e + gains.Ki * integral
    torque = inverse_dynamics(model, reference.acceleration + correction, feedback.velocity)
    rate = unless_saturated(e, feedback.excess)  # it does not wind up
    return ControlOutput(torque, e, e, Integral(integral, rate))
