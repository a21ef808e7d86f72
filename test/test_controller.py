"""The controller without ROS: which reference answers which state, and what it remembers."""

import time

import numpy as np
import pytest
from assembly import FAULTS
from rig import JointSample, answer_of

from parallel_robot_control.answer_kernel import AHEAD, ANSWERED, OLD, STATUS
from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.faults import EMERGENCY_STOP, REFERENCE_STALE
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator
from trajectory_gen.configuration import trajectory_of

MS = 10**6  # ns
START = 10**9  # ns
OFFSET = np.array([1e-3, -2e-3, 3e-3])  # rad


def controller(mode='wall', **changed):
    values = config.resolve('paper_circle', {'time_mode': mode, **changed})
    return Controller(configure(values))


@pytest.fixture(scope='module')
def motion():
    """References and states that lag a little behind them, at k = 0, 1, ... ms."""
    samples = trajectory_of(config.resolve('paper_circle')).sample(np.arange(100) * 1e-3)
    rows = zip(samples.position, samples.velocity, samples.acceleration, strict=True)
    references = [JointReference(*row) for row in rows]
    return references, [
        JointSample(row.position - OFFSET, row.velocity, np.full(3, np.nan)) for row in references
    ]


def errors(sample):
    return sample.telemetry.error[0], sample.telemetry.error_rate[0]


def run(core, motion, indices, start=START):
    """Feed reference and state of every index; return the torques."""
    references, states = motion
    torques = []
    for k in indices:
        core.add_reference(start + k * MS, references[k])
        torques.append(answer_of(core, core.add_state(start + k * MS, states[k])).torque)
    return np.array(torques)


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_the_reference_of_the_states_own_stamp_is_taken(mode, motion):
    references, states = motion
    core = controller(mode)
    for k in range(50):
        core.add_reference(START + k * MS, references[k])
    for k in (0, 1, 7, 20, 49):
        error, rate = errors(answer_of(core, core.add_state(START + k * MS, states[k])))
        assert np.array_equal(error, references[k].position - states[k].position)
        assert np.array_equal(rate, references[k].velocity - states[k].velocity)


def test_between_samples_the_newest_is_extrapolated(motion):
    references, states = motion
    core = controller()
    core.add_reference(START, references[0])
    core.add_reference(START + 40 * MS, references[40])
    state = states[15]
    error, rate = errors(answer_of(core, core.add_state(START + 15 * MS, state)))
    theta, theta_dot, theta_ddot = references[0]
    t = 0.015
    wanted = theta + theta_dot * t + theta_ddot * t**2 / 2
    assert np.abs(error - (wanted - state.position)).max() < 1e-15
    assert np.abs(rate - (theta_dot + theta_ddot * t - state.velocity)).max() < 1e-15
    assert np.abs(wanted - references[15].position).max() < 1e-6  # it is the motion, nearly


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_the_error_of_a_state_is_that_of_when_it_was_measured(mode, motion):
    """States are 4 ms older than their stamps tell."""
    references, states = motion
    core = controller(mode, **{'estimator.delay': 0.004})
    for k in range(50):
        core.add_reference(START + k * MS, references[k])
    for k in (10, 20, 40):
        error, rate = errors(answer_of(core, core.add_state(START + k * MS, states[k - 4])))
        assert np.abs(error - OFFSET).max() < 1e-8 and np.abs(rate).max() < 1e-5


def test_a_state_before_every_reference_has_no_answer(motion):
    references, states = motion
    core = controller()
    assert not core.add_state(START - MS, states[0])
    core.add_reference(START, references[0])
    assert not core.add_state(START - MS // 2, states[0])
    assert core.add_state(START, states[0])


def test_in_lockstep_a_state_waits_for_the_sample_of_its_stamp(motion):
    references, states = motion
    core = controller('lockstep')
    core.add_reference(START, references[0])
    assert not core.add_state(START + 2 * MS, states[2])
    assert not core.add_reference(START + MS, references[1])
    sample = answer_of(core, core.add_reference(START + 2 * MS, references[2]))
    assert np.array_equal(errors(sample)[0], references[2].position - states[2].position)
    assert not core.add_reference(START + 3 * MS, references[3])


def test_in_lockstep_the_order_of_arrival_does_not_matter(motion):
    references, states = motion
    late = controller('lockstep')
    answers = []
    for k in range(20):
        assert not late.add_state(START + k * MS, states[k])
        answers.append(answer_of(late, late.add_reference(START + k * MS, references[k])).torque)
    assert np.array_equal(answers, run(controller('lockstep'), motion, range(20)))


@pytest.mark.parametrize('back', [0, 1, 5])
def test_a_state_that_repeats_or_goes_back_is_left_out(back, motion):
    core, untouched = controller(), controller()
    run(core, motion, range(10)), run(untouched, motion, range(10))
    assert not core.add_state(START + (9 - back) * MS, motion[1][9 - back])
    assert core.counts == {'state stamps that repeat or go back': 1}
    after = run(core, motion, range(10, 20)), run(untouched, motion, range(10, 20))
    assert np.array_equal(*after)


@pytest.mark.parametrize('back', [0, 1, 5])
def test_a_reference_that_repeats_or_goes_back_is_left_out(back, motion):
    core = controller()
    run(core, motion, range(10))
    core.add_reference(START + (9 - back) * MS, motion[0][9 - back])
    assert core.counts == {'reference stamps that repeat or go back': 1}
    error, _ = errors(answer_of(core, core.add_state(START + 10 * MS, motion[1][10])))
    assert np.abs(error - OFFSET).max() < 1e-5


@pytest.mark.parametrize('jump', [-(10**9), 10**9, 10**18])
def test_a_new_run_of_the_plant_starts_with_a_new_memory(jump, motion):
    fresh = run(controller(), motion, range(20))
    core = controller()
    assert np.array_equal(run(core, motion, range(20)), fresh)
    assert not np.array_equal(fresh[0], fresh[10])
    assert np.array_equal(run(core, motion, range(20), START + jump), fresh)
    assert core.counts['new runs of the plant'] == 1


def test_states_are_answered_within_the_age_that_is_allowed_on_both_sides_of_the_clock(motion):
    references, states = motion
    core = controller(**{'safety.state_age': 0.01})
    layout = layouts.joint_state(core.configuration.loop.joints)
    core.expect(layout, [0, 1, 2])
    ages = {9: ANSWERED, 11: OLD, -9: ANSWERED, -11: AHEAD, 0: ANSWERED}  # ms
    for k, (age, expected) in enumerate(ages.items()):
        stamp = START + k * MS
        core.add_reference(stamp, references[k])
        code = core.answer(layout.encode(stamp, **states[k]._asdict()), now=stamp + age * MS)
        assert min(code, ANSWERED) == expected  # with an answer, it has further bits


def test_a_state_whose_age_is_not_known_is_no_young_one(motion):
    """As the first one of another layout; then states come in pairs, 3 or 4 ms old."""
    references, states = motion
    core = controller()
    layout = layouts.joint_state(core.configuration.loop.joints)
    run(core, motion, [0])
    core.expect(layout, [0, 1, 2])
    for k in range(1, 20):
        stamp, late = START + k * MS, 4 * MS if k % 2 else 3 * MS
        core.add_reference(stamp, references[k])
        assert core.answer(layout.encode(stamp, **states[k]._asdict()), now=stamp + late) > 0


def test_the_period_is_the_time_between_two_stamps(motion):
    """A constant error integrates to error times time, however far apart the states are."""
    references, states = motion
    integrals = []
    for step in (1, 2):
        core = controller()
        core.set_start(START)
        for k in (0, step, 2 * step):
            core.add_reference(START + k * MS, references[0])
            sample = answer_of(core, core.add_state(START + k * MS, states[0]))
        integrals.append((sample.telemetry.coupled_error[0] - errors(sample)[0]) / 0.9)
    ring = 2 * OFFSET - np.roll(OFFSET, 1) - np.roll(OFFSET, -1)
    assert np.abs(integrals[1] - 4e-3 * ring).max() < 1e-15
    assert np.abs(integrals[0] - 2e-3 * ring).max() < 1e-15


@pytest.mark.parametrize('theta', [[0.0, np.pi, -np.pi / 2], [-2.5, 0.5, 3.0]])
def test_a_state_without_a_pose_is_a_fault_that_is_counted(theta, motion):
    core = controller()
    core.add_reference(START, motion[0][0])
    lost = answer_of(
        core, core.add_state(START, JointSample(np.array(theta), np.full(3, 0.1), np.zeros(3)))
    )
    assert np.allclose(lost.torque, -4.0) and core.counts.total() == 1
    assert set(core.counts) == {lost.status.fault.text} == {FAULTS[core.fault].text}


def test_references_that_stop_are_extrapolated_for_a_moment_then_a_fault(motion):
    references, states = motion
    core = controller(**{'safety.residual_limit': 0.0})  # it does not move as it is asked to
    core.add_reference(START, references[0])
    for k in range(0, 900, 10):
        moved = states[0].position + 1e-3 * k * states[0].velocity
        sample = answer_of(
            core, core.add_state(START + k * MS, states[0]._replace(position=moved))
        )
        assert (sample.status.fault == FAULTS[REFERENCE_STALE]) == (k > 500)
    assert np.array_equal(sample.torque, -40.0 * states[0].velocity)


def test_in_lockstep_a_copy_of_a_state_is_not_answered_twice(motion):
    references, states = motion
    core = controller('lockstep')
    assert not core.add_state(START, states[0])
    assert core.add_reference(START, references[0])
    assert not core.add_state(START, states[0])


def test_wrong_gains_of_a_law_that_is_not_active_are_refused_at_once():
    values = config.resolve('paper_circle', {'super_twisting.k2': -1.0})
    with pytest.raises(InputError, match='super_twisting'):
        configure(values)
    with pytest.raises(InputError, match='super_twisting'):
        controller().prepare_change({'super_twisting.k2': -1.0})


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
@pytest.mark.parametrize('kind', ['states', 'references', 'trip'])
def test_a_fault_that_no_answer_brought_about_is_told_with_the_next(kind, mode, motion):
    references, states = motion
    core = controller(mode)
    run(core, motion, range(10))
    assert not core.code & STATUS
    if kind == 'states':
        assert not core.add_state(START + 9 * MS, states[0])
    elif kind == 'references' and mode == 'wall':
        core.add_reference(START + 9 * MS, references[0])
    else:
        core.trip(EMERGENCY_STOP)
    assert core.fault
    run(core, motion, [10])
    assert core.code & STATUS and core.status.fault == FAULTS[core.fault]
    run(core, motion, [11])
    assert not core.code & STATUS


@pytest.mark.parametrize(('states', 'over'), [(100, True), (60, False)])
def test_states_that_end_with_the_run_are_no_fault(states, over, motion, monkeypatch):
    core = controller(duration=0.16)  # less 0.1 s
    run(core, motion, range(states))
    assert not core.finish()  # the states are still coming
    later = time.monotonic_ns() + 10**10
    monkeypatch.setattr(time, 'monotonic_ns', lambda: later)
    assert core.finish() == over and not core.finish()
    assert core.watch() != over and (core.fault == faults.NONE) == over
    run(core, motion, range(1), START + 10**9)  # of another run
    assert (core.fault == faults.NONE) == over


@pytest.mark.parametrize(('stall', 'at_once'), [(50, 5), (200, 20), (340, 20)])
def test_states_that_were_held_up_and_come_all_at_once_make_no_jump(stall, at_once):
    """The robot moves on under the last torque; then old states come, many in a ms, in order.

    A torque that goes on by `ramp_rate` at each of them would jump by as many N m.
    """
    begin, answered, torque, torques, queue = 1500, 0, np.zeros(3), [], []
    core = controller()
    plant = Simulator(configure_plant(config.resolve('paper_circle')))
    layout = layouts.joint_state(core.configuration.loop.joints)
    samples = trajectory_of(config.resolve('paper_circle')).sample(
        np.arange(begin + stall + 300) * 1e-3
    )
    for k, row in enumerate(
        zip(samples.position, samples.velocity, samples.acceleration, strict=True)
    ):
        core.add_reference(START + k * MS, JointReference(*row))
        seen = plant.measurement()
        queue.append((START + k * MS, JointSample(seen.position, seen.velocity, torque)))
        for i in range(0 if begin <= k < begin + stall else at_once):
            if queue:
                stamp, state = queue.pop(0)
                now = START + k * MS + (i + 1) * MS // (at_once + 1)
                answered += core.answer(layout.encode(stamp, **state._asdict()), now=now) > 0
                torque = np.array(core.state.torque)
        torques.append(torque)
        plant.advance(torque)
    after = np.array(torques)[begin:]
    assert core.fault == faults.NONE and answered < begin + 300 + 5
    assert np.abs(after).max() < 10.0
    assert np.abs(np.diff(after, axis=0)).max() < 3.0
    assert np.abs(samples.position[-1] - plant.measurement().position).max() < 1e-3
