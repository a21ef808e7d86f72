"""What can be chosen of a described machine, how near to singularities it may come, its faults."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_model.configuration.fields import Field, PerJoint, PerLink
from parallel_robot_model.mechanisms import mechanism
from parallel_robot_model.robots.contract import Fault

TRAVEL, CLOSURE, TOOL = 4, 5, 6  # faults beside those of closing the loops
FAULTS = {
    mechanism.NOT_CLOSED: Fault('not_closed', 'the loops cannot be closed at these joints'),
    mechanism.SINGULAR: Fault(
        'assembly_mode', 'on the way to these joints the machine passes a singularity'
    ),
    mechanism.NOT_FINITE: Fault('not_finite', 'a joint position is no number'),
    TRAVEL: Fault('end_of_travel', 'a joint is close to an end of its travel'),
    CLOSURE: Fault(
        'closure_singularity', 'the passive joints are close to yielding (type 2 singularity)'
    ),
    TOOL: Fault('tool_singularity', 'the tool is close to losing a freedom (type 1 singularity)'),
}
NO_POSE = (mechanism.NOT_CLOSED, mechanism.SINGULAR, mechanism.NOT_FINITE)


class Parameters(NamedTuple):
    """What is chosen of a described machine, and numbers that may differ from the file's."""

    actuated: Annotated[
        tuple[str, ...], Field('', "its actuated joints; []: what the file's actuators move")
    ]
    tool: Annotated[str, Field('', "the frame that is the tool: a site, body or link; '': found")]
    home: Annotated[
        str,
        Field(
            '', "posture that tells the assembly mode: a keyframe, 'joint=value, ...'; '': zero"
        ),
    ]
    held: Annotated[tuple[str, ...], Field('', 'joints that are held at home')]
    mass_factor: Annotated[
        PerLink, Field('', 'factor of mass and inertia of each link that moves', 0.0)
    ]
    spread_factor: Annotated[
        tuple[float, ...],
        Field(
            '', 'beside that, of the squared extent of its mass along x, y, z of its frame', 0.0
        ),
    ]
    centre_shift: Annotated[
        tuple[float, ...],
        Field('m', "by which each link's centre of mass lies elsewhere, x, y, z in its frame"),
    ]
    inertia_shift: Annotated[
        tuple[float, ...],
        Field(
            'kg m^2',
            "by which each link's Ixx, Ixy, Ixz, Iyy, Iyz, Izz about its centre of mass are "
            'greater, before the mass factor',
        ),
    ]
    armature: Annotated[
        PerJoint,
        Field('kg m^2', 'inertia of the rotors as felt at the joints; kg for a slide', 0.0),
    ]
    payload: Annotated[float, Field('kg', 'a point of mass at the tool, beside the file', 0.0)]
    shift: Annotated[
        tuple[float, ...],
        Field(
            'm',
            "by which each joint's origin lies elsewhere, x, y, z on the link before, "
            'then the two points of each loop on their links',
        ),
    ]
    gravity: Annotated[tuple[float, float, float], Field('m/s^2', 'acceleration of gravity')]
    lower: Annotated[PerJoint, Field('rad', 'lower ends of travel; m for a slide')]
    upper: Annotated[PerJoint, Field('rad', 'upper ends of travel; m for a slide')]


class SafetyMargins(NamedTuple):
    """Limits beyond which the controller enters a fault."""

    min_closure: Annotated[
        float, Field('', 'share of the closure margin at home that is a fault (type 2)', 0.0)
    ]
    min_tool: Annotated[
        float, Field('', 'share of the tool margin at home that is a fault (type 1)', 0.0)
    ]
    min_travel: Annotated[
        float, Field('rad', 'distance to an end of travel that is a fault; m for a slide', 0.0)
    ]


class MotionLimits(NamedTuple):
    """Limits of a reference motion."""

    min_closure: Annotated[
        float, Field('', 'least share of the closure margin at home allowed (type 2)', 0.0)
    ]
    min_tool: Annotated[
        float, Field('', 'least share of the tool margin at home allowed (type 1)', 0.0)
    ]
    min_travel: Annotated[
        float, Field('rad', 'least distance to an end of travel allowed; m for a slide', 0.0)
    ]
