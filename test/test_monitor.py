"""The monitor without ROS, beside the metrics of a whole run."""

import numpy as np
import pytest
from assembly import simulated

from parallel_robot.analysis import metrics
from parallel_robot.analysis.monitor import OF_TOPICS, Monitor, MonitorParameters
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.motions import Motion, Poses

START = 10**9  # ns
MS = 10**6  # ns


@pytest.fixture(scope='module')
def setup():
    """A second of the paper's circle, and a configuration with a short window."""
    values = config.resolve('paper_circle', {'duration': 1.0, 'monitor.window': 0.5})
    return values, simulated(values)


def feed(monitor, simulation, indices, shift=0, ahead=20):
    """Give states and references, these some samples ahead; collect the metrics."""
    found = []
    reference, run = simulation.reference, simulation.run
    sent = indices[0]
    for k in indices:
        while sent <= min(k + ahead, len(reference.position) - 1):
            motion = [reference.position, reference.velocity, reference.acceleration]
            monitor.add_reference(START + (sent + shift) * MS, [part[sent] for part in motion])
            sent += 1
        measured = monitor.add_state(START + (k + shift) * MS, run.position[k], run.effort[k])
        if measured is not None:
            found.append(measured)
    return found


def monitor_of(values, window=0.5):
    return Monitor(*nominal_of(values), MonitorParameters(window))


def expected(setup, rows):
    """The metrics of some samples, as for a recorded run."""
    values, simulation = setup
    reference, run = simulation.reference.position[rows], simulation.run.position[rows]
    robot = robot_of(values)
    guess = simulation.reference.pose[rows][0]
    pose = Poses(poses_of(robot, run, guess), poses_of(robot, reference, guess))
    time = np.arange(len(run)) * 1e-3
    moved = Motion(time, run, reference, simulation.run.effort[rows], pose)
    found = metrics.evaluate(moved, all_of_it=True)
    return [found[key] for key in OF_TOPICS]


def test_metrics_are_those_of_the_window_ten_times_a_second(setup):
    values, simulation = setup
    found = feed(monitor_of(values), simulation, range(1001))
    assert len(found) == 10
    for k, measured in zip(range(100, 1001, 100), found, strict=True):
        rows = slice(max(0, k - 500), k + 1)
        assert list(measured) == pytest.approx(expected(setup, rows), rel=1e-9)


def test_missing_references_are_extrapolated(setup):
    values, simulation = setup
    reference, run = simulation.reference, simulation.run
    monitor, found = monitor_of(values), []
    for k in range(501):
        if k % 5 == 0:
            motion = [reference.position[k], reference.velocity[k], reference.acceleration[k]]
            monitor.add_reference(START + k * MS, motion)
        found.append(monitor.add_state(START + k * MS, run.position[k], run.effort[k]))
    last = [measured for measured in found if measured][-1]
    assert list(last) == pytest.approx(expected(setup, slice(0, 501)), rel=1e-3)


@pytest.mark.parametrize('shift', [-300, 5000], ids=['back', 'far on'])
def test_a_jump_clears_the_window(shift, setup):
    values, simulation = setup
    monitor = monitor_of(values)
    feed(monitor, simulation, range(600, 1001))
    found = feed(monitor, simulation, range(301), shift=shift)
    assert list(found[-1]) == pytest.approx(expected(setup, slice(0, 301)), rel=1e-9)


@pytest.mark.parametrize('shift', [-300, 2000, 20_000], ids=['back', 'on', 'far on'])
def test_after_a_jump_no_reference_of_before_it_is_used(shift, setup):
    """A trajectory is ahead of the plant: the first references after a jump are too late."""
    values, simulation = setup
    rows, ahead = range(301), 20
    monitor = monitor_of(values, window=5.0)
    feed(monitor, simulation, range(1001))
    found = []
    reference, run = simulation.reference, simulation.run
    for k in rows:
        stamp = START + (1000 + shift + k) * MS
        found.append(monitor.add_state(stamp, run.position[k], run.effort[k]))
        motion = [reference.position, reference.velocity, reference.acceleration]
        monitor.add_reference(stamp + ahead * MS, [part[k + ahead] for part in motion])
    last = [measured for measured in found if measured][-1]
    wanted = expected(setup, slice(ahead, 301))
    if shift == 2000:  # the window is longer than the jump: it also holds what was before
        before = np.array(expected(setup, slice(0, 1001)))
        counts = 1001, 301 - ahead
        wanted = np.sqrt(np.average([before**2, np.square(wanted)], axis=0, weights=counts))
        assert list(last)[:1] == pytest.approx(wanted[:1], rel=1e-9)
        assert last.platform_error_max == pytest.approx(before[1], rel=1e-12)
    else:
        assert list(last) == pytest.approx(wanted, rel=1e-9)


def test_a_trajectory_that_ends_leaves_no_metrics(setup):
    values, simulation = setup
    reference, run = simulation.reference, simulation.run
    monitor = monitor_of(values)
    for k in range(1001):
        if k <= 300:
            motion = [reference.position[k], reference.velocity[k], reference.acceleration[k]]
            monitor.add_reference(START + k * MS, motion)
        measured = monitor.add_state(START + k * MS, run.position[k], run.effort[k])
    assert measured is None and len(monitor._window.stamps) == 0


def test_without_references_there_are_no_metrics(setup):
    values, simulation = setup
    assert not feed(monitor_of(values), simulation, range(300), ahead=-1000)


def test_without_a_pose_the_joints_are_left(setup):
    values, simulation = setup
    monitor = monitor_of(values)
    for k in range(201):
        motion = [simulation.reference.position[k], np.zeros(3), np.zeros(3)]
        monitor.add_reference(START + k * MS, motion)
        theta = np.array([0.0, np.pi, np.pi / 2])
        measured = monitor.add_state(START + k * MS, theta, np.zeros(3)) or None
    assert np.isnan(measured.platform_error_rms) and np.isfinite(measured.joint_error_rms)


def test_a_robot_outside_a_plane_has_no_platform_error():
    values = config.resolve('axes_step', {'duration': 0.2})
    made = simulated(values)
    monitor = monitor_of(values)
    last = feed(monitor, made, range(201))[-1]
    names = [name for name in last._fields if not name.startswith('platform')]
    assert list(monitor.names) == names and len(names) == 5
    assert np.isnan([last.platform_error_rms, last.platform_error_max]).all()
    error = made.reference.position - made.run.position
    assert last.joint_error_rms == pytest.approx(np.sqrt((error**2).mean()), rel=1e-9)
    assert np.isfinite([getattr(last, name) for name in names]).all()


def test_it_costs_little(setup):
    """Window and references do not grow with the motion."""
    values, simulation = setup
    monitor = monitor_of(values)
    feed(monitor, simulation, range(1001))
    assert len(monitor._window.stamps) == 501 and len(monitor._references) <= 2
    span = monitor._window.stamps[-1] - monitor._window.stamps[0]
    assert span == 0.5 * NANOSECONDS
