"""A robot that runs away is stopped before a singularity or an end of travel, at any speed."""

import numpy as np
import pytest
from geometry import ROBOT, jacobian, legs
from rig import Rig

from parallel_robot_control.contract import JointReference
from parallel_robot_control.safety.faults import FAULTS, NONE, SPEED, TOO_FAST
from parallel_robot_model.robots.planar_3rrr.estimate import TYPE_2

PUSHED = {'safety__effort_tolerance': 0.0, 'safety__residual_limit': 0.0}  # by a strange hand
INERTIA = ('m1', 'm2', 'mp', 'I1', 'I2', 'Ip')


REST = 1e-3  # rad/s


def run_away(push, **changed):
    """Push a robot by the law's hand until there is a fault; the safe action then has 2 s.

    Returns:
        Fault, fastest joint [rad/s], positions [rad] and poses by state.
    """
    rig, fastest, fault, ways = Rig(**PUSHED, **changed), 0.0, None, []
    for _ in range(4000):
        position, velocity, _ = rig.measured()
        ways.append((position, rig.simulator.pose))
        sample = rig.ask(reference=JointReference(position, velocity, 0.0 * velocity))
        speed = np.abs(velocity).max()
        fastest = max(fastest, speed)
        if fault is None and sample.status.fault:
            fault, begun = rig.controller.fault, rig.k
        if fault is not None and (speed < REST or rig.k > begun + 2000):
            break
        rig.simulator.advance(push if fault is None else sample.torque)
        rig.k += 1
    assert speed < REST
    return fault, fastest, *map(np.array, zip(*ways, strict=True))


@pytest.mark.parametrize('heavier', [0.8, 1.2])
def test_the_robot_is_stopped_before_both_singularities(heavier):
    """With what it says of both, 0.05 and 0.1, half of the margin is left at the least."""
    rng, speeds = np.random.default_rng(7), []
    mass = {f'true_robot__{key}': heavier * getattr(ROBOT, key) for key in INERTIA}
    for size in np.geomspace(5.0, 200.0, 20):  # N m
        direction = rng.normal(size=3)
        push = size * direction / np.abs(direction).max()
        fault, fastest, _, poses = run_away(push, **mass)
        theta, beta = legs(ROBOT, poses)
        determinant = np.linalg.det(jacobian(ROBOT, poses))  # over l3
        assert fault in (TOO_FAST, SPEED, TYPE_2)
        assert np.abs(np.sin(beta - theta)).min() > 0.025 and np.abs(determinant).min() > 0.05
        speeds.append(fastest)
    assert min(speeds) < 2.0 and max(speeds) > 7.0


@pytest.mark.parametrize('size', [3.0, 10.0, 49.0])
def test_an_axis_is_stopped_before_its_end_of_travel(size):
    fault, fastest, positions, _ = run_away(np.full(5, size), scenario='axes_step')
    assert fault in (TOO_FAST, SPEED) and fastest > 3.0 and np.abs(positions).max() < 2.95


def place_of_the_fault(late):
    """Where the first axis is when it is too fast, of states that are so many samples old."""
    rig = Rig(**PUSHED, scenario='axes_step', estimator__delay=late * 1e-3)
    states = [rig.measured()] * late
    while rig.controller.fault == NONE:
        states.append(rig.measured())
        position, velocity, _ = old = states[-1 - late]
        rig.ask(old, JointReference(position, velocity, 0.0 * velocity))
        rig.simulator.advance(np.full(5, 3.0))
        rig.k += 1
    assert rig.controller.fault == TOO_FAST and states[-1].velocity[0] > 8.0
    return states[-1].position[0]


def test_of_old_states_it_is_known_where_the_robot_is_now():
    """At 8 rad/s it goes 0.08 rad in 10 ms."""
    places = [place_of_the_fault(late) for late in (0, 10, 30)]
    assert max(places) - min(places) < 0.03


@pytest.mark.parametrize('push', [(0.0, -10.0), (0.0, -30.0), (40.0, -90.0)])
def test_an_arm_is_stopped_before_it_is_stretched(push):
    level = {'true_robot__gravity': 0.0, 'robot__gravity': 0.0}
    fault, fastest, positions, _ = run_away(np.array(push), scenario='serial_2r_circle', **level)
    assert fault in (TOO_FAST, SPEED) and fastest > 1.0
    assert np.sin(positions[:, 1]).min() > 0.05


def test_it_says_so_and_the_way_back_is_free():
    rig, push = Rig(**PUSHED), np.array([20.0, -20.0, 20.0])
    while rig.controller.fault == 0:
        position, velocity, _ = rig.measured()
        rig.ask(reference=JointReference(position, velocity, 0.0 * velocity))
        rig.simulator.advance(push)
        rig.k += 1
    assert rig.controller.fault == TOO_FAST
    assert rig.controller.status.fault == FAULTS[TOO_FAST]
    for _ in range(1000):
        rest = JointReference(rig.measured().position, np.zeros(3), np.zeros(3))
        rig.step(reference=rest)
    assert np.abs(rig.measured().velocity).max() < 1e-3
    assert rig.controller.clear_fault() == ''
    assert rig.step(reference=rest).status.fault is None
