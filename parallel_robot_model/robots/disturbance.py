"""Torque disturbance of the actuated joints."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, some, vector
from parallel_robot_model.configuration.fields import Field, PerJoint


class DisturbanceParameters(NamedTuple):
    """delta_i = amplitude_i sin(2 pi frequency t + phase_i), eq. (1).

    The paper specifies no disturbance, so it is zero in its scenarios.
    """

    amplitude: Annotated[PerJoint, Field('N m', 'amplitude per joint', 0.0)]
    frequency: Annotated[float, Field('Hz', 'frequency, the same for all joints', 0.0)]
    phase: Annotated[PerJoint, Field('rad', 'phase per joint')]


@kernel
def disturbance_torque(disturbance: DisturbanceParameters, time: float) -> Array:
    """Torque that opposes the motors [N m], shape (n,), at `time` since the start [s]."""
    amplitude, angle = vector(disturbance.amplitude), vector(disturbance.phase)
    if some(amplitude != 0.0):
        angle = angle + 2.0 * math.pi * disturbance.frequency * time
        return amplitude * np.sin(angle)
    return np.zeros_like(amplitude)
