"""Robots that cannot be built are refused with the reason."""

import math

import pytest

from parallel_robot_model.common.errors import RobotError
from parallel_robot_model.robots.planar_3rrr.kinematics import validate


def test_the_papers_robot_can_be_built(robot):
    assert validate(robot) is robot


@pytest.mark.parametrize('key', ['l1', 'l2', 'l3', 'm1', 'm2', 'mp', 'I1', 'I2', 'Ip'])
@pytest.mark.parametrize('value', [0.0, -1.0, math.nan])
def test_lengths_masses_and_inertias_are_positive(robot, key, value):
    with pytest.raises(RobotError, match=f'true_robot.{key} must be positive, not {value:g}'):
        validate(robot._replace(**{key: value}), 'true_robot')


@pytest.mark.parametrize(('key', 'link'), [('lc1', 'l1'), ('lc2', 'l2')])
def test_centres_of_mass_lie_on_their_links(robot, key, link):
    length = getattr(robot, link)
    for inside in (0.0, length):
        validate(robot._replace(**{key: inside}))
    for outside in (-1e-9, math.nextafter(length, 1.0), math.nan):
        with pytest.raises(RobotError, match=f'{key} must lie on its link'):
            validate(robot._replace(**{key: outside}))


@pytest.mark.parametrize('mode', [0.0, 2.0, math.nan])
def test_an_elbow_has_two_sides(robot, mode):
    validate(robot._replace(working_mode=(1.0, -1.0, 1.0)))
    with pytest.raises(RobotError, match='working_mode'):
        validate(robot._replace(working_mode=(1.0, mode, 1.0)))


def test_base_joints_stand_apart(robot):
    with pytest.raises(RobotError, match='base joints 1 and 3 stand on the same spot'):
        validate(robot._replace(base_x=(0.0, 1.0, 0.0), base_y=(0.0, 0.0, 0.0)))


def test_legs_and_platform_span_the_base(robot):
    reach = 2 * (0.4 + 0.6 + 0.2)
    validate(robot._replace(base_x=(0.0, reach - 1e-9, 0.5)))
    with pytest.raises(RobotError, match=r'base joints 1 and 2 are 2\.4 m apart.*only 2\.4 m'):
        validate(robot._replace(base_x=(0.0, reach + 1e-9, 0.5)))
