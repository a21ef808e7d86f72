"""How sensors, motors and loads of the simulated robot differ from ideal ones: parameters."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.fields import Field, PerJoint
from parallel_robot_sim.space import Space

Array = NDArray[np.float64]

KINDS = 5  # of vectors that the plant remembers, see memory.py
LONGEST = 0.1  # s, of a delay


class SensorParameters(NamedTuple):
    """What the joint states tell of the true motion; all zero: exactly that."""

    position_noise: Annotated[PerJoint, Field('rad', 'noise of the positions, rms', 0.0)]
    velocity_noise: Annotated[PerJoint, Field('rad/s', 'noise of the velocities, rms', 0.0)]
    resolution: Annotated[PerJoint, Field('rad', 'step of the encoders; 0: none', 0.0)]
    differentiate: Annotated[
        bool, Field('', 'velocity: difference of two measured positions over the period')
    ]
    delay: Annotated[
        float, Field('s', 'age of the states, rounded to whole samples', 0.0, LONGEST)
    ]
    jitter: Annotated[
        float, Field('s', 'largest further age, random, in whole samples', 0.0, LONGEST)
    ]


class ActuatorParameters(NamedTuple):
    """What the motors make of the commands."""

    lag: Annotated[PerJoint, Field('s', 'time constant of the motors; 0: none', 0.0)]
    noise: Annotated[PerJoint, Field('N m', 'noise of the torques, rms', 0.0)]
    resolution: Annotated[PerJoint, Field('N m', 'step of the commands; 0: none', 0.0)]
    delay: Annotated[
        float, Field('s', 'delay of the commands, rounded to whole samples', 0.0, LONGEST)
    ]
    jitter: Annotated[
        float, Field('s', 'largest further delay, random, in whole samples', 0.0, LONGEST)
    ]
    effectiveness: Annotated[
        PerJoint, Field('', 'share of the torque that is left after fault_time', 0.0)
    ]
    bias: Annotated[PerJoint, Field('N m', 'torque added after fault_time')]
    fault_time: Annotated[float, Field('s', 'when effectiveness and bias begin to act', 0.0)]


class LoadParameters(NamedTuple):
    """Disturbances that are held over each period, besides the sine."""

    constant: Annotated[PerJoint, Field('N m', 'constant torque per joint')]
    pulse: Annotated[PerJoint, Field('N m', 'torque of a pulse per joint')]
    pulse_start: Annotated[float, Field('s', 'begin of the pulse', 0.0)]
    pulse_duration: Annotated[float, Field('s', 'length of the pulse', 0.0)]
    noise: Annotated[PerJoint, Field('N m', 'noise per joint, rms', 0.0)]
    bandwidth: Annotated[float, Field('Hz', 'bandwidth of the noise; 0: white', 0.0)]


class Imperfections(NamedTuple):
    """All of them, as the kernels take them.

    Attributes:
        on: Whether there are any; if not, none of the rest is looked at.
        depth: Most samples by which a state or a command can be late.
        seed: Seed of the random numbers, a whole number.
        sensor: What the states tell.
        actuator: What the motors make of the commands.
        load: Disturbances.
        memory: Address of the space for what the plant remembers, see memory.py.
        draws: Address of the space for random numbers.
    """

    on: bool
    depth: int
    seed: float
    sensor: SensorParameters
    actuator: ActuatorParameters
    load: LoadParameters
    memory: int = 0
    draws: int = 0

    def with_memory(self, like: Array) -> Imperfections:
        """The same with space of their own for vectors as `like`, shape (n,) or with lanes."""
        rows = KINDS * (self.depth + 2) if self.on else 0
        return self._replace(memory=Space(rows * like.size), draws=Space(like.size))


def imperfections(
    seed: int,
    period: float,
    sensor: SensorParameters,
    actuator: ActuatorParameters,
    load: LoadParameters,
) -> Imperfections:
    """Put them together; `period` of the samples [s]."""
    whole = np.not_equal(actuator.effectiveness, 1.0).any()
    acting = actuator._replace(effectiveness=PerJoint((0.0,)), fault_time=0.0)
    loading = (load.constant, load.pulse, load.noise)
    on = whole or any(np.any(each) for each in (*sensor, *acting, *loading))
    late = [
        _samples(each.delay, period) + _samples(each.jitter, period) for each in (sensor, acting)
    ]
    return Imperfections(bool(on), max(late), float(seed), sensor, actuator, load)


def _samples(time: float, period: float) -> int:
    return int(np.floor(time / period + 0.5))
