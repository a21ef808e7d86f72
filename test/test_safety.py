"""Every cause of a fault or a limit: seen in the same cycle, latched, safe, cleared on demand."""

import math
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from assembly import FAULTS, simulated
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry import ROBOT, jacobian, kinetic_energy, legs, margins
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message
from rig import MS, JointSample, Rig, answer_of
from vectors import on_vectors

from parallel_robot_control import controller
from parallel_robot_control.assembly import assemble
from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.messages import status_message
from parallel_robot_control.safety import limiting
from parallel_robot_control.safety.faults import (
    EMERGENCY_STOP,
    NONE,
    POSITION_JUMP,
    REFERENCE_JUMP,
    REFERENCE_STALE,
    REFERENCES_DISAGREE,
    SPEED,
    STATES_DISAGREE,
    STATES_STALE,
    TORQUE_NOT_FINITE,
)
from parallel_robot_control.safety.limiting import RAMP, RATE, TORQUE
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.planar_3rrr.estimate import TYPE_1, TYPE_2
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import NOT_CONVERGED

MOVING = 150  # sample; the joints are fast while the first error is corrected
DAMPING, STIFFNESS = 40.0, 400.0  # docs/safety.md
NARROW = {'safety.torque_limit': [100.0] * 3, 'safety.torque_rate': [60_000.0] * 3}
limit_torque = on_vectors(limiting.limit_torque)
LIMITS = assemble(configure(config.resolve('paper_circle', NARROW))).setup.safety


def moved(measured, **changes):
    """The state with joint 2 changed."""
    fields = {
        key: getattr(measured, key) + np.array([0.0, by, 0.0]) for key, by in changes.items()
    }
    return measured._replace(**fields)


def too_fast(rig):
    return rig.step(moved(rig.measured(), velocity=10.5))


def jump_of_a_joint(rig):
    return rig.step(moved(rig.measured(), position=0.011))


def jump_of_the_reference(rig):
    desired = rig.reference()
    return rig.step(reference=desired._replace(position=desired.position + 0.011))


def torque_not_finite(rig):
    desired = rig.reference()
    return rig.step(reference=desired._replace(acceleration=np.full(3, 1.7e308)))


def stale_reference(rig):
    """No reference for 51 ms, all states answered."""
    for _ in range(51):
        sample = answer_of(rig.controller, rig.controller.add_state(rig.stamp, rig.measured()))
        rig.simulator.advance(sample.torque)
        rig.k += 1
    return sample


def two_states(rig):
    """A second publisher: the same stamp, another angle."""
    rig.step()
    rig.k -= 1
    other = moved(rig.measured(), position=1e-6)
    assert not rig.controller.add_state(rig.stamp, other)
    rig.k += 1
    return rig.step()


def two_references(rig):
    rig.step()
    desired = rig.reference(rig.k - 1)
    other = desired._replace(velocity=desired.velocity + 1e-6)
    assert not rig.controller.add_reference(rig.stamp - MS, other)
    return rig.step()


def emergency_stop(rig):
    rig.controller.trip(EMERGENCY_STOP)
    return rig.step()


CAUSES = {
    SPEED: too_fast,
    POSITION_JUMP: jump_of_a_joint,
    REFERENCE_JUMP: jump_of_the_reference,
    TORQUE_NOT_FINITE: torque_not_finite,
    REFERENCE_STALE: stale_reference,
    STATES_DISAGREE: two_states,
    REFERENCES_DISAGREE: two_references,
    EMERGENCY_STOP: emergency_stop,
}


def level(rig, sample):
    """Level and text of the status message."""
    (status,) = deserialize_message(
        status_message(rig.stamp, sample.status), DiagnosticArray
    ).status
    return status.level, status.message


@pytest.mark.parametrize('fault', CAUSES, ids=lambda fault: FAULTS[fault].key)
def test_a_cause_is_seen_at_once_and_stays_until_it_is_cleared(fault):
    rig = Rig(safety__reference_timeout=0.05)
    before = rig.run(MOVING)
    assert level(rig, before) == (DiagnosticStatus.OK, 'ok')
    sample = CAUSES[fault](rig)
    assert sample.status.fault == FAULTS[fault] and rig.controller.fault == fault
    assert level(rig, sample) == (DiagnosticStatus.ERROR, f'fault: {FAULTS[fault].text}')
    assert rig.controller.counts[FAULTS[fault].text] == 1
    rig.run(2)  # the rate limit lets a huge torque go in two samples
    for _ in range(100):  # the cause is gone, the fault is not
        velocity = rig.measured().velocity
        assert np.array_equal(rig.step().torque, -DAMPING * velocity)
    assert rig.controller.fault == fault and rig.controller.counts[FAULTS[fault].text] == 1
    last = rig.torques[-1]
    assert rig.controller.clear_fault() == ''
    sample = rig.step()
    assert sample.status.fault is None and np.abs(sample.torque - last).max() <= 1.0 + 1e-12
    assert level(rig, sample)[0] == DiagnosticStatus.WARN
    assert 'ramp after a take-over' in level(rig, sample)[1]
    rig.run(900)
    assert rig.controller.fault == NONE
    error = np.linalg.norm((rig.simulator.state.coordinates - rig.samples.pose[rig.k])[:2])
    assert error < 1e-3


@pytest.mark.parametrize('lost', [0, 2])
@pytest.mark.parametrize('by', [0.95, 1.05])
def test_speed_and_jumps_have_their_limits_where_the_parameters_say(by, lost):
    """A jump is one of all the time since the state before, also where states were lost."""
    for change, fault in (
        ({'velocity': 10.0 * by}, SPEED),
        ({'position': 0.01 * (1 + lost) * by}, POSITION_JUMP),
    ):
        rig = Rig(safety__rate_tolerance=0.0)
        rig.run(MOVING)
        still = JointSample(rig.measured().position, np.zeros(3), np.zeros(3))
        rig.controller.add_state(rig.stamp, still)
        rig.k += 1 + lost
        rig.controller.add_reference(rig.stamp, rig.reference())
        sample = answer_of(
            rig.controller, rig.controller.add_state(rig.stamp, moved(still, **change))
        )
        assert sample.status.fault == (FAULTS[fault] if by > 1.0 else None)


@pytest.mark.parametrize(
    ('key', 'fault', 'margin'),
    [
        ('min_sin_psi', TYPE_1, lambda pose: margins(ROBOT, pose)[0]),
        (
            'min_determinant',
            TYPE_2,
            lambda pose: abs(np.linalg.det(jacobian(ROBOT, pose))),
        ),
    ],
)
@pytest.mark.parametrize('off', [-1e-6, 1e-6])
def test_the_margins_to_singularities_are_those_of_the_geometry(key, fault, margin, off):
    pose = config.resolve('paper_circle')['plant.initial_pose']
    rig = Rig(**{f'safety__{key}': float(margin(np.array(pose))) + off})
    sample = rig.ask()
    assert sample.status.fault == (FAULTS[fault] if off > 0.0 else None)
    if off > 0.0:  # it is not cleared while the robot is there
        assert rig.controller.clear_fault() == FAULTS[fault].text
        assert rig.controller.fault == fault


def test_angles_that_fit_no_pose_are_a_fault():
    rig = Rig()
    nowhere = JointSample(np.array([0.0, np.pi, -np.pi / 2]), np.full(3, 0.1), np.zeros(3))
    sample = rig.ask(nowhere)
    assert sample.status.fault == FAULTS[NOT_CONVERGED] and np.allclose(sample.torque, -4.0)


def energy(rig):
    state = rig.simulator.state
    return kinetic_energy(ROBOT, state.coordinates, state.rate)


def test_damping_takes_energy_out_until_the_robot_rests():
    rig = Rig()
    rig.run(MOVING)
    rig.controller.trip(EMERGENCY_STOP)
    energies = []
    for _ in range(300):
        rig.step()
        energies.append(energy(rig))
    resting = np.flatnonzero(np.array(energies) < 1e-6)[0]  # from there on dry friction chatters
    assert energies[0] > 1e-2 and resting < 200 and max(energies[resting:]) < 1e-6
    assert (np.diff(energies[:resting]) < 0.0).all()


def test_holding_returns_to_where_the_fault_was():
    rig = Rig(safety__action='hold')
    rig.run(MOVING)
    held = rig.measured().position  # of the last state that was answered it is one sample old
    rig.controller.trip(EMERGENCY_STOP)
    rig.step()
    way = 0.0
    for _ in range(1200):
        rig.step()
        way = max(way, np.abs(rig.measured().position - held).max())
    rest = np.abs(rig.measured().position - held).max()
    assert way > 2e-3 > 1.5 * 0.5 / STIFFNESS > rest  # dry friction, 0.5 N m, keeps a little
    assert np.abs(rig.measured().velocity).max() < 1e-3


def test_holding_is_spring_and_damper():
    rig = Rig(safety__action='hold')
    rig.run(MOVING)
    held = rig.measured().position
    rig.step(), rig.controller.trip(EMERGENCY_STOP)
    for _ in range(50):
        position, velocity, _ = rig.measured()
        expected = STIFFNESS * (held - position) - DAMPING * velocity
        assert np.allclose(rig.step().torque, expected, rtol=1e-12, atol=1e-12)


def test_no_torque_is_no_torque():
    rig = Rig(safety__action='zero')
    rig.run(MOVING)
    rig.controller.trip(EMERGENCY_STOP)
    assert not any(rig.step().torque.any() for _ in range(50))


@pytest.mark.parametrize('action', ['damp', 'hold'])
def test_a_stop_before_the_first_state_keeps_the_robot_where_it_is(action):
    rig = Rig(safety__action=action)
    rig.controller.trip(EMERGENCY_STOP)
    for _ in range(100):
        sample = rig.step()
        assert sample.status.fault == FAULTS[EMERGENCY_STOP] and not sample.torque.any()
    assert rig.controller.clear_fault() == ''
    assert rig.step().status.fault is None


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_a_controller_may_begin_in_emergency_stop(mode):
    """With nodes and without them, where nobody ends it."""
    rig = Rig(mode, controller__stopped=True)
    for _ in range(100):
        sample = rig.step()
        assert sample.status.fault == FAULTS[EMERGENCY_STOP] and not sample.torque.any()
    assert rig.controller.clear_fault() == ''
    assert rig.step().status.fault is None
    alone = simulated({**rig.values, 'duration': 0.1})
    assert alone.fault == (0.0, FAULTS[EMERGENCY_STOP]) and not alone.run.command.any()


@pytest.mark.parametrize('jump', [-900, 10_000, 10**9])
def test_a_fault_survives_a_new_run_of_the_plant(jump):
    rig = Rig()
    rig.run(1000)
    rig.controller.trip(EMERGENCY_STOP)
    rig.step()
    stamp = rig.stamp + jump * MS
    rig.controller.add_reference(stamp, rig.reference())
    sample = answer_of(rig.controller, rig.controller.add_state(stamp, rig.measured()))
    assert rig.controller.counts['new runs of the plant'] == 1
    assert sample.status.fault == FAULTS[EMERGENCY_STOP]
    assert np.array_equal(sample.torque, -DAMPING * rig.measured().velocity)


@pytest.fixture
def clock(monkeypatch):
    """Wall time of the controller, in s, as the test sets it."""
    now = SimpleNamespace(time=100.0)
    monkeypatch.setattr(
        controller, 'time', SimpleNamespace(monotonic_ns=lambda: round(1e9 * now.time))
    )
    return now


def test_stale_states_are_a_fault_that_cannot_be_cleared_until_states_come(clock):
    rig = Rig()
    for _ in range(MOVING):
        clock.time += 1e-3
        rig.step()
    clock.time += rig.values['safety.state_timeout'] - 1e-3
    assert not rig.controller.stale() and not rig.controller.watch()
    clock.time += 0.002
    assert rig.controller.watch() and rig.controller.fault == STATES_STALE
    assert not rig.controller.watch()  # told once
    assert rig.controller.clear_fault() == FAULTS[STATES_STALE].text
    assert rig.controller.fault == STATES_STALE
    velocity = rig.measured().velocity
    assert np.array_equal(rig.step().torque, -DAMPING * velocity)
    assert rig.controller.clear_fault() == '' and rig.step().status.fault is None


def test_stale_states_are_told_once_in_another_fault_too(clock):
    """Else zero torque, sent again and again, would keep the motors from their own safe action."""
    rig = Rig()
    rig.run(MOVING)
    rig.controller.trip(EMERGENCY_STOP)
    clock.time += 1.0
    assert [rig.controller.watch() for _ in range(5)] == [True] + 4 * [False]
    assert rig.controller.fault == EMERGENCY_STOP
    assert rig.controller.clear_fault() == FAULTS[STATES_STALE].text
    rig.step()
    clock.time += 1.0
    assert rig.controller.watch()
    assert rig.controller.counts[FAULTS[STATES_STALE].text] == 0


def test_before_the_first_state_and_in_lockstep_nothing_is_stale(clock):
    for rig, steps in ((Rig(), 0), (Rig('lockstep'), 10)):
        for _ in range(steps):
            rig.step()
        clock.time += 1e6
        assert not rig.controller.watch() and rig.controller.clear_fault() == ''


def test_after_the_last_state_of_the_motion_nothing_is_stale(clock):
    rig = Rig(duration=0.05)
    rig.run(51)
    clock.time += 10.0
    assert not rig.controller.watch()


def test_a_reference_from_the_far_future_does_no_harm():
    """It is dropped when the next one comes; the samples before it are still there."""
    rig, untouched = Rig(), Rig()
    for k in range(30):  # references run ahead
        for one in (rig, untouched):
            one.controller.add_reference(one.stamp + k * MS, one.reference(k))
    rig.controller.add_reference(rig.stamp + 10**13, rig.reference(500))
    answers = []
    for k in range(30, 60):
        for one in (rig, untouched):
            one.controller.add_reference(one.stamp + 30 * MS, one.reference(k))
            sample = answer_of(one.controller, one.controller.add_state(one.stamp, one.measured()))
            one.simulator.advance(sample.torque)
            one.k += 1
            answers.append(sample.torque)
    assert np.array_equal(answers[::2], answers[1::2])
    assert rig.controller.counts == {'reference stamps that jump back': 1}


class Before(NamedTuple):
    """What of a CycleState the limits look at."""

    torque: np.ndarray
    offset: np.ndarray
    bumpless: bool


def last(torque, offset=(0.0, 0.0, 0.0), bumpless=False):
    return Before(np.array(torque), np.array(offset), bumpless)


def test_the_torque_limit_clips_each_joint_and_says_what_is_cut_off():
    demand = np.array([99.0, -130.0, 101.0])
    torque, excess, _, acted = limit_torque(LIMITS, demand, last((90.0, -90.0, 90.0)), 1e-3, 1e-3)
    assert torque.tolist() == [99.0, -100.0, 100.0] and acted == TORQUE
    assert excess.tolist() == [0.0, -30.0, 1.0]


def test_the_rate_limit_slows_each_joint():
    demand = np.array([70.0, -70.0, 50.0])
    torque, excess, _, acted = limit_torque(LIMITS, demand, last((0.0, 0.0, 0.0)), 1e-3, 1e-3)
    assert torque.tolist() == [60.0, -60.0, 50.0] and acted == RATE
    assert excess.tolist() == [10.0, -10.0, 0.0]


@pytest.mark.parametrize('lost', [0, 1, 2])
def test_after_lost_states_the_torque_may_change_by_the_rate_over_all_of_the_time(lost):
    rig = Rig(safety__torque_rate=[100.0] * 3)
    before = rig.run(5).torque
    for _ in range(lost):
        rig.k += 1
        rig.simulator.advance(before)
    change = np.abs(rig.step().torque - before).max()
    assert change == pytest.approx(100.0 * 1e-3 * (1 + lost), rel=1e-9)


@pytest.mark.parametrize('gap', [1e-3, 5e-3, 0.1])
def test_a_take_over_is_faded_out_and_the_loop_is_not_slowed(gap):
    """The offset falls by 1 N m a sample, whatever the time between two; what the law asks for
    beside it is there at once.
    """
    demand, before = np.array([5.0, -5.0, 0.2]), last((0.0, 0.0, 0.0), bumpless=True)
    for k in range(1, 8):
        torque, excess, offset, acted = limit_torque(LIMITS, demand, before, 1e-3, gap)
        left = np.array([max(5.0 - k, 0.0), -max(5.0 - k, 0.0), 0.0])
        assert np.allclose(offset, left, atol=1e-12) and np.allclose(torque, demand - left)
        assert not excess.any() and bool(acted) == (k <= 5)
        assert acted in (0, RAMP)
        before = last(torque, offset)
        if k == 2:
            demand = demand + np.array([30.0, 0.0, 0.0])


@pytest.mark.parametrize('period', [5e-4, 1e-3, 4e-3])
def test_a_take_over_is_faded_at_the_same_rate_whatever_the_period(period):
    values = config.resolve('paper_circle', {'period': period, 'safety.ramp_rate': [1000.0] * 3})
    limits, demand = assemble(configure(values)).setup.safety, np.array([8.0, -8.0, 8.0])
    before = last((0.0, 0.0, 0.0), bumpless=True)
    torque, *_ = limit_torque(limits, demand, before, period, period)
    assert np.abs(torque) == pytest.approx(1000.0 * period, rel=1e-12)


@pytest.mark.parametrize('period', [1e-3, 5e-3, 0.02])
def test_two_lost_states_are_no_gap_whatever_the_period(period):
    values = config.resolve('paper_circle', {'period': period})
    gap = assemble(configure(values)).setup.safety.gap
    assert gap > 3.0 * period and (gap == values['safety.gap'] or period > 1e-3)


finite = st.floats(-1e300, 1e300)
triple = st.tuples(finite, finite, finite)


@given(triple, triple, triple, st.booleans(), st.floats(1e-6, 0.5))
def test_whatever_is_asked_and_was_before_the_torque_is_within_its_limits(
    demand, before, offset, takes_over, dt
):
    torque, excess, after, _ = limit_torque(
        LIMITS, np.array(demand), last(before, offset, takes_over), 1e-3, dt
    )
    assert (np.abs(torque) <= 100.0).all()
    start = np.clip(before, -100.0, 100.0)
    assert (np.abs(torque - start) <= 60_000.0 * dt * (1 + 1e-12) + 1e-12).all()
    assert np.isfinite(after).all() and not np.isnan(excess).any()


@pytest.mark.parametrize('effort', [1e6, 150.0, -150.0, 99.0, 0.0, math.nan, math.inf])
def test_a_controller_that_takes_over_goes_on_from_the_effort_within_its_limit(effort):
    """Of whatever unit the effort may be: drives that report a current exist."""
    rig = Rig(safety__torque_limit=[100.0] * 3, safety__torque_rate=[60_000.0] * 3)
    rig.controller.set_start(1)  # the motion began long ago
    sample = rig.step(rig.measured()._replace(effort=np.array([effort, 0.0, 0.0])))
    expected = np.clip(effort, -100.0, 100.0) if math.isfinite(effort) else 0.0
    assert abs(sample.torque[0] - expected) <= 1.0 + 1e-12
    assert np.abs(sample.torque[1:]).max() <= 1.0 + 1e-12


def test_a_limit_that_acts_is_told_as_a_warning():
    rig = Rig(safety__torque_limit=[3.0, 3.0, 3.0])
    sample = rig.run(50)
    assert np.abs(rig.torques).max() == 3.0
    assert level(rig, sample) == (DiagnosticStatus.WARN, 'acted: torque limit')
    rig = Rig(safety__torque_rate=[100.0, 100.0, 100.0])
    sample = rig.run(50)
    steps = np.diff([np.zeros(3), *rig.torques], axis=0)
    assert np.isclose(np.abs(steps).max(), 0.1, rtol=1e-9)
    assert level(rig, sample) == (DiagnosticStatus.WARN, 'acted: torque rate limit')


def test_the_angles_of_geometry_are_those_of_the_rig():
    """The margins above are of this pose."""
    rig = Rig()
    assert np.allclose(legs(ROBOT, rig.simulator.state.coordinates)[0], rig.measured().position)
    assert isinstance(rig.reference(), JointReference)
