"""What the file of a robot of your own imports: these names stay. See docs/robots.md."""

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.compiler import (
    clip,
    cross,
    dot,
    every,
    inline_ir,
    internal,
    kernel,
    multiply,
    select,
    solve,
    some,
    vector,
)
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import (
    FOUND,
    REACHED,
    Coordinate,
    Estimate,
    Fault,
    JointMotion,
    Location,
    Margin,
    Measurement,
    Model,
    PoseMotion,
    first_sample,
)
from parallel_robot_model.robots.joint_load import net_torque

__all__ = [
    'FOUND',
    'REACHED',
    'Coordinate',
    'Estimate',
    'Fault',
    'Field',
    'JointMotion',
    'Location',
    'Margin',
    'Measurement',
    'Model',
    'PoseMotion',
    'RobotError',
    'clip',
    'cross',
    'dot',
    'every',
    'first_sample',
    'inline_ir',
    'internal',
    'kernel',
    'multiply',
    'net_torque',
    'select',
    'solve',
    'some',
    'vector',
]
