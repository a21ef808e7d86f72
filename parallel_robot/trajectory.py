"""What the file of a trajectory of your own imports: these names stay.

See docs/custom_trajectory.md.
"""

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import (
    clip,
    every,
    inline_ir,
    internal,
    kernel,
    select,
    some,
    vector,
)
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.paths import quintic, trapezoid

__all__ = [
    'Field',
    'InputError',
    'PoseMotion',
    'clip',
    'every',
    'inline_ir',
    'internal',
    'kernel',
    'quintic',
    'select',
    'some',
    'trapezoid',
    'vector',
]
