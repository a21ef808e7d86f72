"""Units of the parameters of a robot's joints."""

from __future__ import annotations

from collections.abc import Collection

from parallel_robot_model.common.units import JointUnits
from parallel_robot_model.configuration.fields import Field, Parameter, PerJoint

PHASE = 'disturbance.phase'  # an angle of all joints
ROBOTS = ('robot', 'true_robot')  # of whose parameters some are per joint, others geometry


def joint_field(
    key: str, parameter: Parameter, units: JointUnits, motions: Collection[str] = ()
) -> Field:
    """What a parameter means, with the unit of the joints that there are.

    Args:
        key: Its key.
        parameter: The parameter.
        units: Units of the joints.
        motions: Names of motions, whose angles are those of the pose.
    """
    group, field = key.partition('.')[0], parameter.field
    of_robot = group in ROBOTS and parameter.type is not PerJoint
    if of_robot or group in motions or key == PHASE:
        return field
    return field._replace(unit=units.of(field.unit))
