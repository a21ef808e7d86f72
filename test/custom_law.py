"""Source of a custom law: PID with other gains, its classes named as the suite's own are."""

LAW = """
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot.law import ControlOutput, Field, kernel


class Gains(NamedTuple):
    Kp: Annotated[float, Field('N m/rad', 'proportional gain', 0.0)] = 1350
    Ki: Annotated[float, Field('N m/(rad s)', 'integral gain', 0.0)] = 6000.0
    Kd: Annotated[float, Field('N m s/rad', 'derivative gain', 0.0)] = 90.0


class Memory(NamedTuple):
    integral: np.ndarray


def initial_memory(joints):
    return Memory(np.zeros(joints))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    torque = gains.Kp * e + gains.Ki * memory.integral + gains.Kd * e_dot
    return ControlOutput(torque, e, e, Memory(memory.integral + dt * e))
"""

RETURN = 'ControlOutput(torque, e, e, Memory(memory.integral + dt * e))'
