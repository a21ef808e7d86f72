"""Metrics, against closed forms."""

import numpy as np
import pytest
from bags import JOINTS
from geometry import PAPER_START, legs

from parallel_robot_analysis import metrics
from parallel_robot_analysis.readable_metrics import (
    EFFORT,
    METRICS,
    STEADY,
    TORQUE,
    as_data,
    brief,
    defined,
)
from parallel_robot_bags.run_log import RunLog
from parallel_robot_base import config

COUNT = 1000
TIME = np.arange(COUNT + 1) * 1e-3
OFFSET = np.array([1e-4, -2e-4, 1e-3])  # m, m, rad


def run(reference, position, effort=None):
    """Log of angles of shape (N, 3)."""
    values = config.resolve('paper_circle')
    nothing = np.zeros((COUNT + 1, 3))
    return RunLog(
        'paper_circle', 's_fotsmc', JOINTS, values, 0, (TIME * 1e9).astype(int), TIME,
        position, nothing, nothing if effort is None else effort,
        reference, nothing, nothing, nothing, {},
    )  # fmt: skip


def still(pose):
    return np.tile(pose, (COUNT + 1, 1)).astype(float)


def evaluate(log, actual=PAPER_START, reference=PAPER_START):
    return metrics.evaluate(log, metrics.Poses(still(actual), still(reference)))


def test_a_constant_offset_is_its_own_rms():
    found = evaluate(
        run(still([0, 0, 0]), still([3e-3, 0, -4e-3])), [0.503, 0.404, 0], [0.5, 0.4, 9]
    )
    assert found.steady.xy_rms_m == pytest.approx(5e-3) == found.steady.xy_max_m
    assert found.steady.joint_rms_rad == pytest.approx(5e-3 / np.sqrt(3))
    # differences of neighbours: 3, -4 and 7 mrad, in a ring
    assert found.steady.sync_rms_rad == pytest.approx(np.sqrt((9 + 16 + 49) / 3) * 1e-3)
    assert found.duration_s == pytest.approx(1.0)


def test_equal_errors_are_synchronous():
    found = evaluate(run(still([0, 0, 0]), still([2e-3] * 3)))
    assert found.steady.sync_rms_rad == 0.0
    assert found.steady.joint_rms_rad == pytest.approx(2e-3)


def test_only_the_second_half_is_steady():
    error = still([1, 1, 1]) * (TIME < 0.4995)[:, np.newaxis]
    reference, actual = still(PAPER_START), still(PAPER_START)
    actual[:500, 0] += 1.0
    log = run(still([0, 0, 0]), error)
    steady = metrics.evaluate(log, metrics.Poses(actual, reference)).steady
    assert steady == (0.0, 0.0, 0.0, 0.0)
    actual[500, 0] += 1.0
    assert metrics.evaluate(log, metrics.Poses(actual, reference)).steady.xy_max_m == 1.0


def test_torque_of_a_sawtooth():
    effort = still([0, 0, 0])
    effort[1::2, 1] = -2.0  # 1000 changes of 2 N m in a second
    effort[:, 2] = 5.0 * TIME  # 5 N m in one go
    torque = evaluate(run(still([0, 0, 0]), still([0, 0, 0]), effort)).torque
    assert torque.max_nm == pytest.approx(5.0)
    assert torque.total_variation_nm_per_s == pytest.approx(2000.0 + 5.0)
    log = run(still([0, 0, 0]), still([0, 0, 0]), -effort)
    assert evaluate(log).torque == torque


def test_energy_is_the_work_of_each_motor_in_either_direction():
    """A constant torque on a joint that swings: twice the width of the swing in each turn."""
    position, effort = still([0, 0, 0]), still([0, -3.0, 2.0])
    position[:, 1] = 0.25 * np.cos(2.0 * np.pi * 10.0 * TIME)
    found = evaluate(run(still([0, 0, 0]), position, effort)).effort
    assert found.energy_j == pytest.approx(
        5 * 4 * 0.25 * 3.0, rel=1e-3
    )  # turns of the second half
    assert found.torque_rms_nm == pytest.approx(np.sqrt(13.0 / 3.0))
    assert np.isnan(found.excess_chattering_nm)


def test_poses_are_those_of_the_angles(robot):
    t = TIME[:, np.newaxis]
    path = PAPER_START + np.hstack([0.02 * np.sin(5 * t), 0.03 * np.cos(5 * t), 0.1 * t])
    reference, _ = legs(robot, path)
    actual, _ = legs(robot, path + OFFSET)
    found = metrics.poses(run(reference, actual))
    assert np.abs(found.reference - path).max() < 1e-12
    assert np.abs(found.actual - path - OFFSET).max() < 1e-12


def test_a_run_of_one_state(robot):
    theta = legs(robot, PAPER_START)[0][np.newaxis]
    log = run(theta, theta)._replace(time=TIME[:1], effort=np.array([[1.0, -3.0, 2.0]]))
    found = metrics.evaluate(log, metrics.poses(log))
    assert found.duration_s == 0.0 and found.torque == (3.0, 0.0, 0.0)


def test_a_robot_outside_a_plane_has_no_distances():
    log = run(still([0, 0, 0]), still([2e-3] * 3))
    pose = metrics.Poses(still([0, 0, 0]), still([2e-3] * 3), planar=False)
    found = metrics.evaluate(log, pose)
    assert np.isnan(found.transient).all()
    assert np.isnan([found.steady.xy_rms_m, found.steady.xy_max_m]).all()
    assert found.steady.joint_rms_rad == pytest.approx(2e-3) and found.steady.sync_rms_rad == 0.0
    data = as_data(found)
    assert data['transient'] == {} and set(data['steady']) == {'joint_rms_rad', 'sync_rms_rad'}
    assert data['torque'] == found.torque._asdict()
    assert defined(METRICS, found) == [*STEADY[2:], *TORQUE, *EFFORT[:2]]  # nor the ideal torque
    assert len(brief(found, {})) == 3 and 'nan' not in ' '.join(brief(found, {}))


def test_a_state_that_is_never_reached_is_a_metric():
    """Unlike one that is not defined."""
    far = evaluate(run(still([0, 0, 0]), still([0, 0, 0])), [0.6, 0.4, 0])
    assert far.transient == (None, None) and defined(METRICS, far) == list(METRICS[:11])
    assert as_data(far)['transient'] == {'to_1_mm_s': None, 'to_0_1_mm_s': None}


def test_settling_is_the_time_after_the_last_excursion():
    from parallel_robot_analysis.metrics import _settled

    time = np.arange(6) * 0.5
    assert _settled(time, np.array([9.0, 0.1, 2.0, 0.5, 0.2, 0.1]), 1.0) == 1.5
    assert _settled(time, np.array([9.0, 0.1, 0.2, 0.5, 0.2, 1.0]), 1.0) is None
    assert _settled(time, np.full(6, 0.1), 1.0) == 0.0
