"""Zero angles of the encoders: what they show, and a controller that knows them or does not."""

import numpy as np
import pytest

import parallel_robot as pr
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import corrected
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import robot_of

ZERO = [3e-4, -2e-4, 1e-4]


@pytest.fixture(scope='module')
def exact():
    return pr.simulate('paper_circle', duration=2)


def test_positions_are_off_by_the_zero_angles_and_the_robot_with_them():
    run = pr.simulate('paper_circle', duration=4, **{'sensor.zero_angle': ZERO})
    rows = slice(3000, None)
    joints = run.simulation.run.joints
    np.testing.assert_allclose(run.position, joints + ZERO, rtol=0, atol=1e-15)
    # The law holds what it sees, so the robot is where the joints less the zero angles are.
    robot = robot_of(run.values)
    there = poses_of(robot, run.reference[rows] - ZERO, run.pose_reference[3000])
    left, error = np.abs(run.pose[rows] - there), np.abs(run.pose_error[rows])
    assert (np.median(left, axis=0) < 0.05 * np.median(error, axis=0)).all()


def test_a_controller_that_knows_them_does_as_without(exact):
    known = {'sensor.zero_angle': ZERO, 'estimator.zero_angle': ZERO}
    run = pr.simulate('paper_circle', duration=2, **known)
    assert np.abs(run.position - exact.position - ZERO).max() < 1e-6
    assert np.abs(run.pose - exact.pose).max() < 1e-6
    seen = pr.metrics(run).seen
    assert seen is None or seen['xy_rms_m'] == pytest.approx(pr.metrics(run)['xy_rms_m'], rel=1e-3)


def test_a_false_zero_angle_of_the_controller_is_an_error_of_the_other_sign():
    """What the sensors add is as if the controller took off too little."""
    added, taken = (
        pr.simulate('paper_circle', duration=1, **{key: values})
        for key, values in (
            ('sensor.zero_angle', ZERO),
            ('estimator.zero_angle', [-each for each in ZERO]),
        )
    )
    np.testing.assert_allclose(added.pose, taken.pose, rtol=0, atol=1e-7)


def test_a_bag_is_identified_with_them(tmp_path):
    known = {'sensor.zero_angle': 0.02, 'estimator.zero_angle': 0.02, 'true_robot.mp': 4.5}
    run = pr.simulate('excitation', law='pid', duration=4, **known)
    pr.save(run, tmp_path / 'bag')
    found = pr.identify(tmp_path / 'bag')
    assert found.values['robot.mp'] == pytest.approx(4.5, rel=0.05)
    assert not found.warnings


def test_numbers_of_other_joints_are_refused():
    values = resolve('paper_circle') | {'estimator.zero_angle': [1.0, 2.0]}
    with pytest.raises(InputError, match=r'estimator\.zero_angle'):
        corrected(values, np.zeros((1, 3)))
