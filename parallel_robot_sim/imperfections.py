"""How sensors, motors and loads of the simulated robot differ from ideal ones: parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.compiler import Boxed, as_constants
from parallel_robot_model.configuration.fields import Field, PerJoint, check, is_active
from parallel_robot_model.robots.joint_load import FrictionParameters

# What lies between motors and joints, and joints that stick: parameters.

MOTOR, JOINT = 'motor', 'joint'  # where sensors are
HIDES: Any = {'neutral': 0.0, 'untrue': True}  # of what sensors tell wrong, see Field


class ComplianceParameters(NamedTuple):
    """A spring between the rotor of each motor and its joint; see :mod:`drive_step`."""

    stiffness: Annotated[PerJoint, Field('N m/rad', 'of the gear; 0: it is rigid', 0.0, **HIDES)]
    damping: Annotated[PerJoint, Field('N m s/rad', 'of the gear', 0.0)]
    backlash: Annotated[PerJoint, Field('rad', 'whole play of the gear', 0.0)]
    rotor_inertia: Annotated[
        PerJoint, Field('kg m^2', 'of the rotor as the joint feels it, beside the robot', 0.0)
    ]
    sensor: Annotated[
        Literal['motor', 'joint'], Field('', 'where positions and velocities are measured')
    ]


class StictionParameters(NamedTuple):
    """Bristles that bend before the dry friction of a joint yields; see :mod:`drive_step`."""

    stiffness: Annotated[
        PerJoint, Field('N m/rad', 'of joints that stick; 0: dry friction as it is', 0.0)
    ]
    damping: Annotated[PerJoint, Field('N m s/rad', 'of joints that stick', 0.0)]


class Drive(NamedTuple):
    """Gears and bristles."""

    on: bool  # whether there are any; if not, none of the rest is looked at
    at_motor: bool  # whether sensors measure the rotors
    substeps: int  # integration steps in a period
    gear: ComplianceParameters
    bristles: StictionParameters
    friction: FrictionParameters  # dry friction that they hold, and the Stribeck effect


def drive_of(
    compliance: ComplianceParameters, stiction: StictionParameters, friction: FrictionParameters
) -> Drive:
    """Put them together.

    Raises:
        InputError: a gear has play but no stiffness, or stiffness without a rotor; the sign of a
            friction that sticks is smoothed, or it depends on the load.
    """
    flexible = np.array(compliance.stiffness) > 0.0
    missing = flexible & (np.array(compliance.rotor_inertia) == 0.0)
    _refuse('rotor_inertia', 'above 0', missing, compliance.rotor_inertia)
    idle = ~flexible & (np.array(compliance.backlash) > 0.0)
    _refuse('backlash', '0', idle, compliance.backlash)
    if any(stiction.stiffness) and friction.smoothing > 0.0:
        key = 'friction.smoothing'
        what = f'must be 0 where joints stick (stiction.stiffness), not {friction.smoothing:g}'
        raise InputError(f'{key} {what}', key)
    for joint, (by_load, sticks) in enumerate(zip(friction.load, stiction.stiffness, strict=True)):
        if by_load and sticks:
            what = f'must be 0 where joints stick (stiction.stiffness), not {by_load:g}'
            raise InputError(f'friction.load {what} (joint {joint + 1})', 'friction.load')
    dry = np.add(friction.coulomb, friction.stribeck) > 0.0  # else there is nothing that sticks
    held = _where(dry, stiction.stiffness)
    bristles = StictionParameters(held, _where(np.array(held) > 0.0, stiction.damping))
    gear = compliance._replace(rotor_inertia=_where(flexible, compliance.rotor_inertia))
    on = bool(flexible.any() or any(stiction.stiffness))
    at_motor = bool(flexible.any()) and compliance.sensor == MOTOR
    return Drive(on, at_motor, 1, gear, bristles, friction)


def _where(wanted: np.ndarray, values: PerJoint) -> PerJoint:
    """Values of some joints, and 0 of the others."""
    return PerJoint(tuple(np.where(wanted, values, 0.0).tolist()))


def _refuse(key: str, right: str, wrong: np.ndarray, values: PerJoint) -> None:
    """Refuse values of gears that do not go with their stiffness."""
    if wrong.any():
        joint, key = int(np.argmax(wrong)), f'compliance.{key}'
        what = f'must be {right} where compliance.stiffness is, not {values[joint]:g}'
        raise InputError(f'{key} {what} (joint {joint + 1})', key)


def yielding(drive: Drive) -> FrictionParameters:
    """The friction that acts beside bristles: joints that stick have no other dry friction."""
    slides, friction = np.array(drive.bristles.stiffness) == 0.0, drive.friction
    return friction._replace(
        coulomb=_where(slides, friction.coulomb), stribeck=_where(slides, friction.stribeck)
    )


KINDS = 9  # of vectors that the plant remembers, see noise_and_delay.py
MAX_DELAY = 0.1  # s, of a delay
ENCODERS = 'sensor.resolution', 'sensor.counts_per_turn'  # what positions in steps come from


class SensorParameters(NamedTuple):
    """What the joint states tell of the true motion; all zero: exactly that."""

    zero_angle: Annotated[
        PerJoint,
        Field('rad', 'zero angle: what the positions show where a joint is at zero', **HIDES),
    ]
    position_noise: Annotated[PerJoint, Field('rad', 'noise of the positions, rms', 0.0, **HIDES)]
    velocity_noise: Annotated[
        PerJoint, Field('rad/s', 'noise of the velocities, rms', 0.0, neutral=0.0)
    ]
    resolution: Annotated[PerJoint, Field('rad', 'step of the encoders; 0: none', 0.0, **HIDES)]
    counts_per_turn: Annotated[
        PerJoint,
        Field(
            '', 'steps of the encoders in a turn, in place of resolution; 0: none', 0.0, **HIDES
        ),
    ]
    differentiate: Annotated[
        bool,
        Field('', 'velocity: difference of two measured positions over the period', neutral=0.0),
    ]
    delay: Annotated[
        float,
        Field('s', 'age of the states, rounded to whole samples', 0.0, MAX_DELAY, **HIDES),
    ]
    jitter: Annotated[
        float,
        Field('s', 'largest further age, random, in whole samples', 0.0, MAX_DELAY, **HIDES),
    ]
    stamp: Annotated[
        Literal['sent', 'measured'],
        Field('', 'what the stamp of a state tells: when it was sent, or when it was measured'),
    ]


class ActuatorParameters(NamedTuple):
    """What the motors make of the commands."""

    lag: Annotated[PerJoint, Field('s', 'time constant of the motors; 0: none', 0.0, neutral=0.0)]
    noise: Annotated[PerJoint, Field('N m', 'noise of the torques, rms', 0.0, neutral=0.0)]
    resolution: Annotated[
        PerJoint, Field('N m', 'step of the commands; 0: none', 0.0, neutral=0.0)
    ]
    delay: Annotated[
        float,
        Field('s', 'delay of the commands, rounded to whole samples', 0.0, MAX_DELAY, neutral=0.0),
    ]
    jitter: Annotated[
        float,
        Field('s', 'largest further delay, random, in whole samples', 0.0, MAX_DELAY, neutral=0.0),
    ]
    effectiveness: Annotated[
        PerJoint,
        Field('', 'share of the torque that is left after fault_time', 0.0, neutral=1.0),
    ]
    bias: Annotated[PerJoint, Field('N m', 'torque added after fault_time', neutral=0.0)]
    fault_time: Annotated[float, Field('s', 'when effectiveness and bias begin to act', 0.0)]


class LoadParameters(NamedTuple):
    """Disturbances that are held over each period, besides the sine."""

    constant: Annotated[PerJoint, Field('N m', 'constant torque per joint', neutral=0.0)]
    pulse: Annotated[PerJoint, Field('N m', 'torque of a pulse per joint', neutral=0.0)]
    pulse_start: Annotated[float, Field('s', 'start of the pulse', 0.0)]
    pulse_duration: Annotated[float, Field('s', 'length of the pulse', 0.0)]
    noise: Annotated[PerJoint, Field('N m', 'noise per joint, rms', 0.0, neutral=0.0)]
    bandwidth: Annotated[float, Field('Hz', 'bandwidth of the noise; 0: white', 0.0)]
    ripple: Annotated[
        PerJoint, Field('N m', 'amplitude of the cogging of the motors', 0.0, neutral=0.0)
    ]
    ripple_periods: Annotated[float, Field('', 'of it in a turn, or in 2 pi m of a slide', 0.0)]


class Imperfections(NamedTuple):
    """All of them."""

    on: bool  # whether there are any; if not, none of the rest is looked at
    depth: int  # most samples by which a state or a command can be late
    age: float  # age of the states that their stamps tell [s]
    seed: float  # seed of the random numbers, a whole number
    sensor: SensorParameters  # what the states tell; `resolution` is also that of counts
    actuator: ActuatorParameters  # what the motors make of the commands
    load: LoadParameters  # disturbances
    drive: Drive  # gears and bristles
    # what the plant remembers, see noise_and_delay.py, and room for random numbers, shape (n,)
    memory: Any = None
    draws: Any = None

    def constants(self, joints: int) -> Boxed:
        """All of them as kernels read them, with memory of their own; `joints` is n."""
        rows, drive = KINDS * (self.depth + 2) if self.on else 0, self.drive
        return Boxed(
            self._replace(
                sensor=as_constants(self.sensor),
                actuator=as_constants(self.actuator),
                load=as_constants(self.load),
                drive=drive._replace(
                    gear=as_constants(drive.gear),
                    bristles=as_constants(drive.bristles),
                    friction=as_constants(drive.friction),
                ),
                memory=np.zeros((rows, joints)),
                draws=np.zeros(joints),
            )
        )


def imperfections(
    seed: int,
    period: float,
    sensor: SensorParameters,
    actuator: ActuatorParameters,
    load: LoadParameters,
    drive: Drive,
    slides: tuple[bool, ...] = (),
) -> Imperfections:
    """Put them together.

    Args:
        seed: Of the random numbers.
        period: Of the samples [s].
        sensor: What the states tell.
        actuator: What the motors make of commands.
        load: Disturbances.
        drive: Gears and bristles.
        slides: Whether each joint is a slide; empty: all are hinges.

    Raises:
        InputError: jitter, with stamps that tell when states were measured; steps of an encoder
            both by their size and their number, fewer than one, or in a turn of a slide.
    """
    measured = sensor.stamp == 'measured'
    if measured and sensor.jitter > 0.0:
        raise InputError(
            'sensor.jitter must be 0 where sensor.stamp is measured, not '
            f'{sensor.jitter:g}: a state that comes late would come twice',
            'sensor.jitter',
        )
    steps = _steps(sensor, slides)
    sensor = sensor._replace(resolution=steps, counts_per_turn=PerJoint((0.0,) * len(steps)))
    on = drive.on or any(map(is_active, (sensor, actuator, load)))
    late = [
        _samples(each.delay, period) + _samples(each.jitter, period) for each in (sensor, actuator)
    ]
    age = _samples(sensor.delay, period) * round(period * NANOSECONDS) / NANOSECONDS
    return Imperfections(
        on, max(late), age if measured else 0.0, float(seed), sensor, actuator, load, drive
    )


def reported_age(values: Mapping[str, Any]) -> int:
    """Age of the states of a simulated robot when they are sent, as their stamps tell [ns].

    Args:
        values: A resolved configuration, perhaps that of a bag, with a valid period.

    Raises:
        InputError: the delay is no time that a sensor may have.
    """
    if values.get('sensor.stamp') != 'measured':
        return 0
    period, within = float(values['period']), Field('s', '', 0.0, MAX_DELAY)
    delay = check('sensor.delay', float, within, values.get('sensor.delay'))
    return _samples(delay, period) * round(period * NANOSECONDS)


def _steps(sensor: SensorParameters, slides: tuple[bool, ...]) -> PerJoint:
    """Steps of the encoders [rad]; 0: none."""
    size, key = ENCODERS
    steps = list(sensor.resolution)
    for joint, counts in enumerate(sensor.counts_per_turn):
        if not counts:
            continue
        if counts < 1.0:
            what = f'{key} must be 0 or at least 1, not {counts:g} (joint {joint + 1})'
            raise InputError(what, key)
        if steps[joint]:
            both = f'{key} and {size} are the same: one must be 0 (joint {joint + 1})'
            raise InputError(both, key)
        if slides and slides[joint]:
            what = f'{key} must be 0 where a joint slides, not {counts:g} (joint {joint + 1})'
            raise InputError(f'{what}; {size} is in m', key)
        steps[joint] = 2.0 * math.pi / counts
    return PerJoint(tuple(steps))


def _samples(time: float, period: float) -> int:
    return int(np.floor(time / period + 0.5))
