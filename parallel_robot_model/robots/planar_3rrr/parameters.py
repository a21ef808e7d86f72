"""Parameters of the robot, and the conditions that they must meet."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Annotated, NamedTuple

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.link import check_links


class RobotParameters(NamedTuple):
    """Geometry and inertia of a 3-RRR robot with three equal legs.

    Source:
        Doan, Le, Vo (2019), Table 1; base points and platform angles from the same group's public
        model of the robot.
    """

    l1: Annotated[float, Field('m', 'length of the proximal (actuated) link')]
    l2: Annotated[float, Field('m', 'length of the distal link')]
    l3: Annotated[float, Field('m', 'radius from the platform centre to its joints')]
    lc1: Annotated[float, Field('m', 'actuated joint to the centre of mass of the proximal link')]
    lc2: Annotated[float, Field('m', 'elbow to the centre of mass of the distal link')]
    m1: Annotated[float, Field('kg', 'mass of a proximal link')]
    m2: Annotated[float, Field('kg', 'mass of a distal link')]
    mp: Annotated[float, Field('kg', 'mass of the platform')]
    I1: Annotated[float, Field('kg m^2', 'inertia of a proximal link about its centre of mass')]
    I2: Annotated[float, Field('kg m^2', 'inertia of a distal link about its centre of mass')]
    Ip: Annotated[float, Field('kg m^2', 'inertia of the platform about its centre')]
    base_x: Annotated[tuple[float, float, float], Field('m', 'x of the base joints')]
    base_y: Annotated[tuple[float, float, float], Field('m', 'y of the base joints')]
    platform_angle: Annotated[
        tuple[float, float, float], Field('rad', 'direction of the platform joints at phi = 0')
    ]
    working_mode: Annotated[
        tuple[float, float, float], Field('', 'side of the elbow of each leg, +1 or -1')
    ]


def validate(robot: RobotParameters, name: str = 'robot') -> RobotParameters:
    """Return `robot` if it can be built.

    Raises:
        RobotError: a length, mass or inertia is not positive; a centre of mass lies outside its
            link; two base joints coincide or are too far apart for the legs and the platform; a
            working mode is neither +1 nor -1.
    """
    check_links(robot, ('l1', 'l2', 'l3', 'm1', 'm2', 'mp', 'I1', 'I2', 'Ip'), name)
    for mode in robot.working_mode:
        if mode not in (-1.0, 1.0):
            key = f'{name}.working_mode'
            raise RobotError(f'{key} must hold +1 or -1, not {mode:g}', key)
    base = list(zip(robot.base_x, robot.base_y, strict=True))
    for (i, a), (j, b) in combinations(enumerate(base, start=1), 2):
        if math.dist(a, b) < 1e-6:  # m
            raise RobotError(f'{name}: base joints {i} and {j} stand on the same spot', name)
        # Legs i and j and the platform between them must be able to span the base.
        reach = 2.0 * (robot.l1 + robot.l2) + 2.0 * robot.l3
        if math.dist(a, b) >= reach:
            raise RobotError(
                f'{name}: base joints {i} and {j} are {math.dist(a, b):g} m apart, the legs and '
                f'the platform span only {reach:g} m',
                name,
            )
    return robot
