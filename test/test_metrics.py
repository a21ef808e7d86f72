"""Metrics, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from bags import JOINTS, metric_of_torques, motion_of
from geometry import PAPER_START, legs

from parallel_robot.analysis import metrics
from parallel_robot.analysis.metrics import METRICS, TABLE, Metrics, MotionPart, Window, named
from parallel_robot.analysis.readable_metrics import as_data, brief, defined, unsettled
from parallel_robot.analysis.recorded_motions import poses_of_log
from parallel_robot.bags import columns
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config
from parallel_robot_sim.motions import Motion, Motions, Poses

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
    return metrics.evaluate(motion_of(log, metrics.Poses(still(actual), still(reference))))


def test_a_constant_offset_is_its_own_rms():
    found = evaluate(
        run(still([0, 0, 0]), still([3e-3, 0, -4e-3])), [0.503, 0.404, 0], [0.5, 0.4, 9]
    )
    assert found['xy_rms_m'] == pytest.approx(5e-3) == found['xy_max_m']
    assert found['joint_rms_rad'] == pytest.approx(5e-3 / np.sqrt(3))
    # differences of neighbours: 3, -4 and 7 mrad, in a ring
    assert found['sync_rms_rad'] == pytest.approx(np.sqrt((9 + 16 + 49) / 3) * 1e-3)
    assert found.duration_s == pytest.approx(1.0)


def test_equal_errors_are_synchronous():
    found = evaluate(run(still([0, 0, 0]), still([2e-3] * 3)))
    assert found['sync_rms_rad'] == 0.0
    assert found['joint_rms_rad'] == pytest.approx(2e-3)


def test_only_the_second_half_is_steady():
    error = still([1, 1, 1]) * (TIME < 0.4995)[:, np.newaxis]
    reference, actual = still(PAPER_START), still(PAPER_START)
    actual[:500, 0] += 1.0
    log = run(still([0, 0, 0]), error)
    found = metrics.evaluate(motion_of(log, metrics.Poses(actual, reference)))
    keys = 'xy_rms_m', 'xy_max_m', 'joint_rms_rad', 'sync_rms_rad'
    assert [found[key] for key in keys] == [0.0] * 4
    actual[500, 0] += 1.0
    found = metrics.evaluate(motion_of(log, metrics.Poses(actual, reference)))
    assert found['xy_max_m'] == 1.0


def test_torque_of_a_sawtooth():
    effort = still([0, 0, 0])
    effort[1::2, 1] = -2.0  # 1000 changes of 2 N m in a second
    effort[:, 2] = 5.0 * TIME  # 5 N m in one go
    found = evaluate(run(still([0, 0, 0]), still([0, 0, 0]), effort))
    assert found['torque_max_nm'] == pytest.approx(5.0)
    assert found['torque_total_variation_nm_per_s'] == pytest.approx(2000.0 + 5.0)
    turned = evaluate(run(still([0, 0, 0]), still([0, 0, 0]), -effort))
    assert as_data(turned)['torque'] == as_data(found)['torque']


def test_samples_too_far_apart_tell_no_chattering():
    effort = np.tile([[1.0], [-1.0]], (50, 3))
    (close, far) = (step * np.arange(100) for step in (0.01, 0.02))
    assert metric_of_torques('chattering_nm', close, effort) > 0.5
    assert np.isnan(metric_of_torques('chattering_nm', far, effort))
    variation = metric_of_torques('torque_total_variation_nm_per_s', far, effort)
    assert variation == pytest.approx(99 * 2.0 * 3 / (99 * 0.02))
    assert np.isnan(metric_of_torques('excess_chattering_nm', far, effort, 0.5 * effort))


def test_energy_is_the_work_of_each_motor_in_either_direction():
    """A constant torque on a joint that swings: twice the width of the swing in each turn."""
    position, effort = still([0, 0, 0]), still([0, -3.0, 2.0])
    position[:, 1] = 0.25 * np.cos(2.0 * np.pi * 10.0 * TIME)
    found = evaluate(run(still([0, 0, 0]), position, effort))
    turns = 5  # of the second half
    assert found['energy_j'] == pytest.approx(turns * 4 * 0.25 * 3.0, rel=1e-3)
    assert found['torque_rms_nm'] == pytest.approx(np.sqrt(13.0 / 3.0))
    assert np.isnan(found['excess_chattering_nm'])


def test_poses_are_those_of_the_angles(robot):
    t = TIME[:, np.newaxis]
    path = PAPER_START + np.hstack([0.02 * np.sin(5 * t), 0.03 * np.cos(5 * t), 0.1 * t])
    reference, _ = legs(robot, path)
    actual, _ = legs(robot, path + OFFSET)
    found = poses_of_log(run(reference, actual))
    assert np.abs(found.reference - path).max() < 1e-12
    assert np.abs(found.actual - path - OFFSET).max() < 1e-12


def test_a_run_of_one_state(robot):
    theta = legs(robot, PAPER_START)[0][np.newaxis]
    log = run(theta, theta)._replace(time=TIME[:1], effort=np.array([[1.0, -3.0, 2.0]]))
    found = metrics.evaluate(motion_of(log))
    torque = {'max_nm': 3.0, 'total_variation_nm_per_s': 0.0, 'chattering_nm': 0.0}
    assert found.duration_s == 0.0 and as_data(found)['torque'] == torque


def test_a_robot_outside_a_plane_has_no_distances():
    log = run(still([0, 0, 0]), still([2e-3] * 3))
    pose = metrics.Poses(still([0, 0, 0]), still([2e-3] * 3), place=0)
    found = metrics.evaluate(motion_of(log, pose))
    assert np.isnan([found[key] for key in ('to_1_mm_s', 'to_0_1_mm_s', 'xy_rms_m')]).all()
    assert found['joint_rms_rad'] == pytest.approx(2e-3) and found['sync_rms_rad'] == 0.0
    data = as_data(found)
    assert data['transient'] == {} and set(data['steady']) == {'joint_rms_rad', 'sync_rms_rad'}
    assert [metric.key for metric in defined(METRICS, found)] == [
        'joint_rms_rad',
        'sync_rms_rad',
        'torque_max_nm',
        'torque_total_variation_nm_per_s',
        'chattering_nm',
        'torque_rms_nm',
        'energy_j',
    ]  # nor the ideal torque
    assert len(brief(found, {})) == 3 and 'nan' not in ' '.join(brief(found, {}))


def test_a_state_that_is_never_reached_is_a_metric():
    """Unlike one that is not defined."""
    far = evaluate(run(still([0, 0, 0]), still([0, 0, 0])), [0.6, 0.4, 0])
    assert defined(METRICS, far) == list(METRICS[:12])
    assert as_data(far)['transient'] == {'to_1_mm_s': None, 'to_0_1_mm_s': None}


def settled(time, distance):
    """Time to 1 mm of a point that is so far away [mm], shape (N,)."""
    there = np.zeros((len(time), 2))
    here = np.column_stack([1e-3 * distance, there[:, 1]])
    motion = Motion(time, there, there, there, Poses(here, there))
    return named('to_1_mm_s')[0].value(MotionPart(motion))


def test_settling_is_the_time_after_the_last_excursion():
    time = np.arange(6) * 0.5
    assert settled(time, np.array([9.0, 0.1, 2.0, 0.5, 0.2, 0.1])) == 1.5
    assert settled(time, np.array([9.0, 0.1, 0.2, 0.5, 0.2, 1.0])) is None
    assert settled(time, np.full(6, 0.1)) == 0.0


def moved(motion, error, count=COUNT):
    """A run whose joints follow a motion over time, shape (N,), with some error, shape (N,)."""
    time = np.arange(count + 1) * 1e-3
    reference = np.tile(motion(time)[:, np.newaxis], 3)
    position = reference - error(time)[:, np.newaxis]
    poses = Poses(position, reference, place=0)
    return Motions(Motion(time, position, reference, 0.0 * position, poses), None)


def test_a_robot_that_rests_after_its_motion_is_not_looked_at():
    def motion(time):
        return np.minimum(time, 0.4)

    def error(time):
        return np.where(time <= 0.4, 1e-3 * (1 + (time >= 0.1995)), 9.0)

    found = metrics.figures(moved(motion, error))
    assert found['joint_rms_rad'] == pytest.approx(2e-3, rel=1e-9)
    assert found.duration_s == pytest.approx(0.4)
    assert found.window[:3] == pytest.approx((0.2, 0.4, 1.0)) and found.window.unsettled is None
    short = metrics.figures(moved(motion, error, 400))
    assert as_data(short)['steady'] == as_data(found)['steady']
    assert as_data(short)['torque'] == as_data(found)['torque']
    assert short.window.run_s == 0.4
    held = metrics.figures(moved(np.zeros_like, error))
    assert held.window[:3] == (0.5, 1.0, 1.0) and held['joint_rms_rad'] == 9.0


def test_a_robot_that_waits_before_its_motion_is_not_looked_at():
    run = moved(lambda t: np.maximum(t - 0.6, 0.0), lambda t: np.where(t < 0.7995, 9.0, 1e-3))
    found = metrics.figures(run)
    assert found.window[:2] == pytest.approx((0.8, 1.0)) and found.window.rests
    assert found['joint_rms_rad'] == pytest.approx(1e-3, rel=1e-9)


@pytest.mark.parametrize('steps', [(0.2,), (0.1, 0.6)])
def test_of_steps_the_response_is_looked_at(steps):
    run = moved(lambda t: sum(1.0 * (t > step) for step in steps), np.zeros_like)
    assert metrics.figures(run).window[:2] == (0.5, 1.0)


def test_a_part_that_was_asked_for_is_all_that_is_looked_at():
    run = moved(lambda t: t, lambda t: np.where((t > 0.2495) & (t < 0.5005), 2e-3, 7.0))
    found = metrics.figures(run, 0.25, 0.5)
    assert found['joint_rms_rad'] == pytest.approx(2e-3, rel=1e-9) and found.window.requested
    assert found.window[:3] == (0.25, 0.5, 1.0) and found.duration_s == 0.25
    assert metrics.figures(run, None, 0.1).window[:2] == (0.0, 0.1)
    for start, stop in (0.5, 0.25), (2.0, None), (None, -1.0), (np.nan, 0.5), (0.3, 0.3):
        with pytest.raises(InputError, match='the run is from 0 to 1 s'):
            metrics.figures(run, start, stop)


def test_errors_that_still_fall_are_no_settled_ones():
    found = metrics.figures(moved(lambda t: t, lambda t: np.exp(-8.0 * t)))
    before, after = found.window.unsettled
    assert before / after == pytest.approx(np.exp(2.0), rel=0.01)
    assert unsettled(found)[0].startswith('not settled: in that time the joint error falls from')
    assert metrics.figures(moved(lambda t: t, lambda t: np.exp(-2.0 * t))).window.unsettled is None
    stopping = moved(lambda t: t * (2.0 - t), lambda t: np.exp(-8.0 * t))  # comes to rest at 1 s
    assert metrics.figures(stopping).window.unsettled is None


def test_a_run_that_is_too_short_to_settle_says_so():
    run = moved(lambda t: t, lambda t: np.full_like(t, 1e-3))
    short = run.between(0.0, 0.25)
    (line,) = unsettled(metrics.figures(short))
    assert line.startswith('too short') and line.endswith(': 0.249 s, of 0.5 s at least')
    assert unsettled(metrics.figures(run)) == []
    assert unsettled(metrics.figures(run, 0.0, 0.25)) == []  # asked for


def test_below_a_bound_for_a_moment_is_not_settled():
    time = np.arange(0.0, 2.0, 0.1)
    for below, expected in ((1.4, 1.4), (1.5, None)):
        found = settled(time, np.where(time > below - 0.05, 0.0, 9.0))
        assert found == (expected and pytest.approx(expected))


def test_torque_and_chattering_are_those_of_the_window():
    run = moved(lambda t: t, np.zeros_like)
    rough = np.where(np.arange(COUNT + 1) % 2, 3.0, -3.0)
    for part, torque in ((slice(0, 450), 0.0), (slice(550, None), 3.0)):
        effort = np.zeros((COUNT + 1, 3))
        effort[part] = rough[part, np.newaxis]
        found = metrics.figures(run._replace(true=run.true._replace(effort=effort)))
        assert found['torque_max_nm'] == 3.0  # of all of it
        share = np.sqrt(0.9) * torque
        assert found['torque_rms_nm'] == pytest.approx(share, rel=0.01)
        chattering = share * 20 / 21  # the moving mean is over 21 samples
        assert found['chattering_nm'] == pytest.approx(chattering, rel=0.01)


def test_figures_of_a_robot_whose_true_motion_nobody_knows_are_called_seen():
    run = moved(lambda t: t, np.zeros_like)
    assert metrics.figures(run).source == metrics.TRUE and metrics.figures(run).seen is None
    found = metrics.figures(Motions(None, run.true))
    assert found.source == metrics.SEEN and found.seen.values == found.values


NAMES = {
    'to_1_mm_s': 'time to 1 mm [s]',
    'to_0_1_mm_s': 'time to 0.1 mm [s]',
    'xy_rms_m': 'end-effector error, rms [µm]',
    'xy_max_m': 'end-effector error, max [µm]',
    'rotation_rms_rad': 'end-effector rotation error, rms [µrad]',
    'joint_rms_rad': 'joint error, rms [µrad]',
    'sync_rms_rad': 'synchronisation error, rms [µrad]',
    'torque_max_nm': 'torque, max (whole run) [N m]',
    'torque_total_variation_nm_per_s': 'torque, total variation [N m/s]',
    'chattering_nm': 'torque, chattering [N m]',
    'torque_rms_nm': 'torque, rms [N m]',
    'energy_j': 'energy [J]',
    'excess_chattering_nm': 'excess chattering [N m]',
}


def numbered(first):
    """Metrics of different numbers."""
    values = {metric.key: float(first + k) for k, metric in enumerate(TABLE)}
    return Metrics(values, 1.0, Window(0.0, 1.0, 1.0))


def test_each_figure_is_shown_under_its_name_in_its_unit():
    seen = numbered(101)
    found = replace(numbered(1), seen=seen)
    for metric in METRICS:
        key = metric.key.removeprefix('seen_')
        of = seen if metric.key != key else found
        scale = 1e6 if 'µ' in metric.unit else 1.0
        name = f'seen {NAMES[key]}' if metric.key != key else NAMES[key]
        assert f'{metric.name} [{metric.unit}]' == name
        assert metric.printed(found) == scale * of[key] == scale * metric.of(found)
    assert len(METRICS) == 21
    with pytest.raises(UnknownNameError, match="unknown metric 'xy_rms'"):
        found['xy_rms']


def test_a_long_motion_has_the_metrics_of_a_short_one(monkeypatch, moved_in_a_plane):
    """By blocks, whose borders nothing may show: equal up to the order of sums."""
    motion, ideal = moved_in_a_plane
    whole = metrics.evaluate(motion, ideal)
    assert all(np.isfinite(value) for value in whole.values.values())
    for block in (2, 100, 333):
        monkeypatch.setattr(columns, 'BLOCK', block)
        found = metrics.evaluate(motion, ideal)
        assert found.values == pytest.approx(whole.values, rel=1e-12)
        assert found.window == whole.window and found.duration_s == whole.duration_s


@pytest.fixture
def moved_in_a_plane():
    """A motion that settles, and its ideal torque."""
    chance = np.random.default_rng(3)
    t = TIME[:, np.newaxis]
    reference = np.hstack([np.sin(3.0 * t), np.cos(2.0 * t), 0.3 * t])
    position = reference + np.exp(-30.0 * t) + 1e-6 * chance.standard_normal((COUNT + 1, 3))
    actual = PAPER_START + 1e-2 * (position - reference)
    poses = Poses(actual, still(PAPER_START))
    ideal = np.sin(200.0 * t) * [1.0, 2.0, 3.0]
    effort = 0.7 * ideal + 0.1 * chance.standard_normal((COUNT + 1, 3))
    return Motion(TIME, position, reference, effort, poses), ideal
