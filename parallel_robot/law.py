"""What the file of a law of your own imports: these names stay. See docs/custom_law.md."""

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_control.foreign.law import ForeignLaw
from parallel_robot_control.terms import (
    Integral,
    advanced,
    coupling,
    saturate,
    sig,
    unless_any_saturated,
    unless_saturated,
    zero_integral,
)
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.ring import synchronisation_error
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
from parallel_robot_model.robots.contract import Model, inverse_dynamics

__all__ = [
    'ControlOutput',
    'Feedback',
    'Field',
    'ForeignLaw',
    'InputError',
    'Integral',
    'JointReference',
    'Model',
    'advanced',
    'clip',
    'coupling',
    'cross',
    'dot',
    'every',
    'inline_ir',
    'internal',
    'inverse_dynamics',
    'kernel',
    'multiply',
    'saturate',
    'select',
    'sig',
    'solve',
    'some',
    'synchronisation_error',
    'unless_any_saturated',
    'unless_saturated',
    'vector',
    'zero_integral',
]
