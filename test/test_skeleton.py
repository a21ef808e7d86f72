"""Links of the skeleton are as long as those of the robot."""

import numpy as np
import pytest
from geometry import PAPER_START, legs

from parallel_robot_model.planar_3rrr.skeleton import skeleton


@pytest.mark.parametrize('count', [None, 5])
def test_the_links_have_their_lengths(robot, count):
    poses = np.atleast_2d(PAPER_START) + 0.01 * np.arange(count or 1)[:, np.newaxis]
    theta = legs(robot, poses)[0]
    if count is None:
        poses, theta = poses[0], theta[0]
    found = skeleton(robot, poses, theta)
    for start, end, length in (
        (found.base, found.elbow, robot.l1),
        (found.elbow, found.platform, robot.l2),
        (poses[..., np.newaxis, :2], found.platform, robot.l3),
    ):
        np.testing.assert_allclose(np.linalg.norm(end - start, axis=-1), length, atol=1e-12)
    assert found.elbow.shape == (*np.shape(theta), 2)
