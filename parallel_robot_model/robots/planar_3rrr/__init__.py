"""The 3-RRR planar parallel robot of Doan, Le and Vo (2019); the attributes of a robot.

Its pose is (x, y, phi) [m, m, rad], which is also what its plant integrates: minimal coordinates,
in which everything has a closed form and the loops stay closed to round-off.
"""

from parallel_robot_model.robots.contract import Coordinate
from parallel_robot_model.robots.planar_3rrr import linear_model, tree
from parallel_robot_model.robots.planar_3rrr.dynamics import acceleration
from parallel_robot_model.robots.planar_3rrr.estimate import (
    FAULTS,
    NO_POSE,
    MotionLimits,
    SafetyMargins,
    estimate,
    infeasible,
    joint_motion,
    locate,
    margins,
    measure,
    start,
)
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import pose_with
from parallel_robot_model.robots.planar_3rrr.kinematics import (
    Constants,
    constants,
    segments,
    validate,
)
from parallel_robot_model.robots.planar_3rrr.kinematics import RobotParameters as Parameters

PARTS = ('leg', 'platform')
PLANAR = True


def joints(parameters: Parameters) -> int:
    """Three, one for each leg."""
    return 3


def coordinates(parameters: Parameters) -> tuple[Coordinate, ...]:
    """Position and angle of the platform."""
    return Coordinate('x', 'm'), Coordinate('y', 'm'), Coordinate('phi', 'rad')


__all__ = [
    'FAULTS',
    'NO_POSE',
    'PARTS',
    'PLANAR',
    'Constants',
    'MotionLimits',
    'Parameters',
    'SafetyMargins',
    'acceleration',
    'constants',
    'coordinates',
    'estimate',
    'infeasible',
    'joint_motion',
    'joints',
    'linear_model',
    'locate',
    'margins',
    'measure',
    'pose_with',
    'segments',
    'start',
    'tree',
    'validate',
]
