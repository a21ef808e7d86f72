"""What acts on the actuated joints besides the motors."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, kernel, select, some, vector
from parallel_robot_model.configuration.fields import Field, PerJoint

# Friction of the actuated joints.

MOST_LOAD = 0.99  # below 1: a gear that is driven backwards turns


class FrictionParameters(NamedTuple):
    """Viscous and dry friction, a constant torque, and losses of the gears.

        fr = viscous thd + (coulomb + stribeck exp(-(thd / stribeck_velocity)^2)) sgn(thd)
             + offset + load |tau_out| sgn(thd),  tau_out = tau - fr

    tau_out is what the joint transmits. Measured friction often falls towards rest: stribeck may
    be negative, down to -coulomb.

    Source:
        Doan, Le, Vo (2019), section 4, with thd_2 for the misprinted thd_1 of the second joint;
        Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7), eq. (2.3), for the
        Stribeck effect; Hamon, Gautier, Garrec (2010), Dynamic identification of robots with a
        dry friction model depending on load and velocity, IROS, for the load.
    """

    viscous: Annotated[PerJoint, Field('N m s/rad', 'viscous friction per joint', 0.0)]
    coulomb: Annotated[PerJoint, Field('N m', 'dry friction per joint', 0.0)]
    stribeck: Annotated[PerJoint, Field('N m', 'more dry friction at rest; below 0: less')]
    stribeck_velocity: Annotated[float, Field('rad/s', 'at which a third of it is left', 1e-6)]
    smoothing: Annotated[float, Field('rad/s', 'half width of a linear sgn; 0: exact', 0.0)]
    offset: Annotated[PerJoint, Field('N m', 'constant torque per joint, e.g. of its motor')]
    load: Annotated[
        PerJoint, Field('', 'dry friction per torque that a joint transmits', 0.0, MOST_LOAD)
    ]


def check_friction(friction: FrictionParameters) -> None:
    """Refuse dry friction that would drive a joint.

    Raises:
        InputError: with the joint.
    """
    for joint, (dry, more) in enumerate(zip(friction.coulomb, friction.stribeck, strict=True), 1):
        if dry + more < 0.0:
            raise InputError(
                f'friction.stribeck must be at least -friction.coulomb, {-dry:g}, not {more:g} '
                f'(joint {joint})',
                'friction.stribeck',
            )


@kernel
def _direction(friction: FrictionParameters, velocity: Array) -> Array:
    """sgn(velocity), shape (n,)."""
    smooth = clip(velocity / friction.smoothing, -1.0, 1.0)
    return select(friction.smoothing > 0.0, smooth, np.sign(velocity))


@kernel
def friction_torque(friction: FrictionParameters, velocity: Array) -> Array:
    """Torque against the motion but for that by load [N m], shape (n,), at rates [rad/s]."""
    sign = _direction(friction, velocity)
    dry, more = vector(friction.coulomb), vector(friction.stribeck)
    if some(more != 0.0):
        share = velocity / friction.stribeck_velocity
        dry = dry + more * np.exp(-share * share)
    return vector(friction.viscous) * velocity + dry * sign + vector(friction.offset)


# Torque disturbance of the actuated joints.


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


class JointLoad(NamedTuple):
    """Friction and disturbance of the actuated joints."""

    friction: FrictionParameters
    disturbance: DisturbanceParameters


@kernel
def net_torque(load: JointLoad, torque: Array, velocity: Array, time: float) -> Array:
    """Motor torque less friction and disturbance [N m], shape (n,).

    Args:
        load: Friction and disturbance.
        torque: Torque of the motors [N m], shape (n,).
        velocity: Rates of the actuated joints [rad/s], shape (n,).
        time: Time since the start [s].
    """
    given, by_load = torque - friction_torque(load.friction, velocity), vector(load.friction.load)
    if some(by_load != 0.0):
        given = given / (1.0 + by_load * np.sign(given) * _direction(load.friction, velocity))
    return given - disturbance_torque(load.disturbance, time)


@kernel
def motor_torque(load: JointLoad, torque: Array, velocity: Array, time: float) -> Array:
    """Torque of the motors that leaves a net torque, see :func:`net_torque`."""
    given = torque + disturbance_torque(load.disturbance, time)
    by_load = vector(load.friction.load)
    motor = given + friction_torque(load.friction, velocity)
    if some(by_load != 0.0):
        motor = motor + by_load * np.abs(given) * _direction(load.friction, velocity)
    return motor
