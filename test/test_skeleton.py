"""Lines of the picture are as long as the links of the robot."""

import numpy as np
import pytest
from geometry import PAPER_START, legs

from parallel_robot_model.robots.planar_3rrr.kinematics import segments


@pytest.mark.parametrize('count', [None, 5])
def test_the_links_have_their_lengths(robot, count):
    poses = np.atleast_2d(PAPER_START) + 0.01 * np.arange(count or 1)[:, np.newaxis]
    theta = legs(robot, poses)[0]
    if count is None:
        poses, theta = poses[0], theta[0]
    found = segments(robot, poses, theta)
    for part, length in (('proximal', robot.l1), ('distal', robot.l2)):
        start, end = np.moveaxis(found[part], -2, 0)
        np.testing.assert_allclose(np.linalg.norm(end - start, axis=-1), length, atol=1e-12)
    corner = found['platform'][..., 0, :]
    radius = np.linalg.norm(corner - poses[..., np.newaxis, :2], axis=-1)
    np.testing.assert_allclose(radius, robot.l3, atol=1e-12)
    np.testing.assert_array_equal(found['platform'][..., 1, :], np.roll(corner, -1, axis=-2))
    np.testing.assert_array_equal(found['distal'][..., 1, :], corner)
    assert {ends.shape for ends in found.values()} == {(*np.shape(theta), 2, 2)}
