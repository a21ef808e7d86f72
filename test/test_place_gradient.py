"""How the place follows from the joints, against the inverse kinematics with rates."""

import numpy as np
import pytest

from parallel_robot_control.configuration import configure, resolve
from parallel_robot_control.terms import place_gradient
from parallel_robot_model.compiler import kernel, vector
from parallel_robot_model.robots.contract import PoseMotion


@kernel
def _gradient(locate, robot, place, position, pose):
    return place_gradient(locate, robot, place, position, pose)


@pytest.mark.parametrize(
    ('scenario', 'place'),
    [
        ('paper_circle', 2), ('axes_step', 0), ('serial_2r_circle', 2),
        ('delta_circle', 3), ('hexapod_circle', 3),
    ],
)  # fmt: skip
def test_it_is_that_of_the_inverse_kinematics(scenario, place):
    configuration = configure(resolve(scenario))
    robot, pose = configuration.robot, np.array(configuration.guess)
    still = vector(0.0 * pose)

    def joints(rate):
        motion = PoseMotion(vector(pose), vector(rate), still)
        return robot.module.joint_motion(robot.constants, motion)

    slopes = np.array([joints(row).velocity for row in np.eye(len(pose))]).T
    A = np.linalg.inv(slopes)[:place] if place else np.eye(len(slopes))
    position = vector(np.array(joints(0.0 * pose).position))
    locate = robot.kernel('locate', position, vector(pose))
    found = _gradient(locate, robot.constants, place, position, vector(pose))
    assert robot.place == place
    assert np.allclose(np.array(found), A.T @ A, atol=1e-8 * np.abs(A.T @ A).max())
