"""What lies between motors and joints, and joints that stick: parameters."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import Field, PerJoint
from parallel_robot_model.robots.joint_load import FrictionParameters

MOTOR, JOINT = 'motor', 'joint'  # where sensors are


class ComplianceParameters(NamedTuple):
    """A spring between the rotor of each motor and its joint; see :mod:`drive_step`."""

    stiffness: Annotated[PerJoint, Field('N m/rad', 'of the gear; 0: it is rigid', 0.0)]
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
    """Gears and bristles as the kernels take them.

    Attributes:
        on: Whether there are any; if not, none of the rest is looked at.
        at_motor: Whether sensors measure the rotors.
        substeps: Integration steps in a period.
        stiffness: Of the gears [N m/rad]; 0: rigid.
        damping: Of the gears [N m s/rad].
        backlash: Whole play of the gears [rad].
        rotor_inertia: Of the rotors [kg m^2].
        bristle_stiffness: Of the bristles [N m/rad]; 0: none.
        bristle_damping: Of the bristles [N m s/rad].
        friction: Dry friction that they hold, and the Stribeck effect.
    """

    on: bool
    at_motor: bool
    substeps: int
    stiffness: PerJoint
    damping: PerJoint
    backlash: PerJoint
    rotor_inertia: PerJoint
    bristle_stiffness: PerJoint
    bristle_damping: PerJoint
    friction: FrictionParameters


def drive_of(
    compliance: ComplianceParameters, stiction: StictionParameters, friction: FrictionParameters
) -> Drive:
    """Put them together.

    Raises:
        InputError: a gear has play but no stiffness, or stiffness without a rotor; the sign of a
            friction that sticks is smoothed.
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
    dry = np.add(friction.coulomb, friction.stribeck) > 0.0  # else there is nothing that sticks
    held = _where(dry, stiction.stiffness)
    damped = _where(np.array(held) > 0.0, stiction.damping)
    gears = compliance._replace(rotor_inertia=_where(flexible, compliance.rotor_inertia))
    on = bool(flexible.any() or any(stiction.stiffness))
    at_motor = bool(flexible.any()) and compliance.sensor == MOTOR
    return Drive(on, at_motor, 1, *gears[:-1], held, damped, friction)


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
    slides, friction = np.array(drive.bristle_stiffness) == 0.0, drive.friction
    return friction._replace(
        coulomb=_where(slides, friction.coulomb), stribeck=_where(slides, friction.stribeck)
    )
