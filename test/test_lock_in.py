"""The age of the states, found while the robot moves: against the truth, and in every mode."""

import numpy as np
import pytest
from assembly import simulated
from vectors import setup_of

from parallel_robot_control.assembly import assemble as assemble_control
from parallel_robot_control.configuration import configure as configure_control
from parallel_robot_control.configuration import resolve
from parallel_robot_control.estimation import lock_in
from parallel_robot_control.estimation.lock_in import (
    FOUND,
    KEPT,
    RUNNING,
    WAITING,
    LockInParameters,
    result,
)
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import (
    Boxed,
    Struct,
    as_constants,
    kernel,
    read_row,
    vector,
    write_row,
    zeros_of,
)
from parallel_robot_model.robots.contract import Model

T = 1e-3
SHORT = {
    'lock_in.frequency': 100.0,
    'lock_in.torque': 10.0,
    'lock_in.start': 0.05,
    'lock_in.duration': 0.3,
}
LABORATORY = {
    'estimator.delay': 'identify',
    'approach.duration': 0.4,
    'sensor.position_noise': 5e-6,
    'sensor.velocity_noise': 5e-3,
    'disturbance.noise': 0.5,
    'disturbance.bandwidth': 10.0,
    'seed': 5,
}


def found_by(made):
    return result(made.experiment.control.setup)


@pytest.mark.parametrize(
    ('scenario', 'law', 'kind'),
    [
        ('paper_circle', 'observer_s_fotsmc', 'auto'),
        ('paper_circle', 's_fotsmc', 'none'),
        ('serial_2r_circle', 'smc', 'none'),
        ('axes_step', 'smc', 'none'),
    ],
)
def test_the_true_delay_is_found_on_every_robot(scenario, law, kind):
    keys = {'law': law, 'estimator.kind': kind, 'duration': 2.7, **LABORATORY}
    for samples in (0, 3, 5):
        made = simulated(resolve(scenario, {**keys, 'sensor.delay': samples * T}))
        found = found_by(made)
        assert found.phase == FOUND and found.delay == pytest.approx(samples * T, abs=0.25 * T)
        assert found.end == 2600 and np.ptp(found.of_joints) < 0.5 * T
        changed = np.flatnonzero(np.diff(made.phases))
        assert changed.tolist() == [599, 2598]


def test_stamps_and_a_known_delay_of_commands_are_taken_off():
    keys = {'law': 's_fotsmc', 'estimator.kind': 'none', 'duration': 2.7, **LABORATORY}
    late = {'sensor.delay': 4 * T, 'sensor.stamp': 'measured', 'actuator.delay': 3 * T}
    told = found_by(simulated(resolve('paper_circle', {**keys, **late})))
    assert told.delay == pytest.approx(3 * T, abs=0.25 * T)  # nobody told that of the commands
    late['estimator.command_delay'] = 3 * T
    told = found_by(simulated(resolve('paper_circle', {**keys, **late})))
    assert told.phase == FOUND and told.delay < 0.25 * T
    slow = {'actuator.lag': 5 * T, 'estimator.lag': 5 * T}
    told = found_by(simulated(resolve('paper_circle', {**keys, **late, **slow})))
    assert told.phase == FOUND and told.delay < 0.25 * T


def test_joints_that_disagree_leave_the_default():
    weak = {'lock_in.torque': 1e-4, 'lock_in.delay': 1.5 * T, 'sensor.delay': 3 * T}
    keys = {'law': 's_fotsmc', 'duration': 2.7, **LABORATORY, **weak}
    made = simulated(resolve('paper_circle', keys))
    found = found_by(made)
    assert found.phase == KEPT and found.delay == 1.5 * T
    assert np.ptp(found.of_joints) > 0.5 * T
    assert made.phases[[0, 700, -1]].tolist() == [WAITING, RUNNING, KEPT]


def test_until_it_has_ended_the_default_is_used_and_afterwards_what_was_found():
    keys = {'law': 'observer_s_fotsmc', **LABORATORY, 'duration': 5.0, 'sensor.delay': 4 * T}

    def steady(delay):
        made = simulated(resolve('paper_circle', {**keys, 'estimator.delay': delay}))
        error = (made.run.pose - made.reference.pose)[3600:, :2]
        return made, np.sqrt((error**2).sum(axis=1).mean())

    identified, error = steady('identify')
    wanted, rates = (
        identified.reference,
        identified.run.telemetry.error_rate + identified.run.velocity,
    )
    delays = np.median((wanted.velocity - rates) / wanted.acceleration, axis=1)[[1, 2599, 2600]]
    assert delays == pytest.approx([2 * T, 2 * T, 4 * T], abs=0.25 * T)
    assert delays[:2] == pytest.approx(2 * T, rel=1e-6)
    assert error < 1.05 * steady(4 * T)[1] < 0.5 * steady(2 * T)[1]
    known, _ = steady(2 * T)
    assert np.array_equal(identified.run.command[:600], known.run.command[:600])
    difference = np.abs(identified.run.command - known.run.command)[600:2600]
    assert 1.0 < difference.max() < 4.0


@kernel
def _observe(setup, model, torques, measured, samples, like):
    for i in range(len(samples)):
        k = samples[i]
        lock_in.reset(setup, k, i > 0, False)
        torque, error = read_row(torques, k, like), read_row(measured, k, like)
        lock_in.observe(setup, k, model, error, torque, 0.0, False)


@kernel
def _added(setup, count, torques):
    lock_in.reset(setup, 0, False, False)
    for k in range(count):
        write_row(torques, k, lock_in.added(setup, k))


def test_a_delay_of_part_of_a_period_is_that_of_the_closed_form():
    """Two masses under the sine alone; every ninth state is lost."""
    inertia, delay, count = np.diag([1.5, 0.7]), 2.4 * T, 700
    parameters = LockInParameters((2.0, 1.0), 50.0, 0.1, 0.5, 0.0)
    torques, like = np.zeros((count, 2)), vector(np.zeros(2))
    setup = setup_of(
        lock_in=Boxed(as_constants(parameters)),
        estimator=setup_of(delay=0.0, command_delay=0.0, lag=0.0),
        memory=setup_of(lock_in=Struct(zeros_of(lock_in.LockInMemory, like))),
        identifies=True,
        period=T,
    )
    _added(setup, count, torques)
    assert np.abs(torques).max(axis=0) == pytest.approx([2.0, 1.0], rel=0.02)
    accelerations = np.linalg.solve(inertia, torques.T).T
    rate, place = np.zeros((count, 2)), np.zeros((count, 2))
    for k in range(1, count):
        place[k] = place[k - 1] + T * rate[k - 1] + T * T / 2 * accelerations[k - 1]
        rate[k] = rate[k - 1] + T * accelerations[k - 1]
    whole = np.maximum(np.arange(count) - 3, 0)
    rest = 3 * T - delay  # from the sample before the measurement to it
    late = place[whole] + rest * rate[whole] + rest**2 / 2 * accelerations[whole]
    model = Model(vector(inertia), vector(np.zeros((2, 2))), like)
    samples = np.array([k for k in range(count) if k % 9 != 4 or k in (0, 599)])
    slow = np.linspace(0.0, 1.0, count)[:, np.newaxis] * 1e-4  # of the law: no oscillation
    _observe(setup, model, torques, late + slow, samples, like)
    found = result(setup)
    assert found.phase == FOUND and found.delay == pytest.approx(delay, abs=0.02 * T)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        (
            {'lock_in.torque': 20.0, 'safety.torque_limit': 30.0},
            'at most 15 N m at joint 1, not 20',
        ),
        ({'safety.torque_rate': 1000.0}, r'of safety.torque_rate, 1000'),
        ({'safety.speed_limit': 0.001}, r'of safety.speed_limit, 0.001'),
        ({'period': 0.01}, r'lock_in.frequency must be at most 25 Hz, 4 samples'),
        ({'lock_in.duration': 0.1}, r'lock_in.duration must be at least 0.4 s, 20 oscillations'),
        ({'lock_in.delay': 0.06}, r'lock_in.delay and estimator.command_delay .* not 0.06'),
        ({'estimator.delay': 'identity'}, r'a number or one of stamp, identify, not .identity.'),
    ],
)
def test_a_sine_for_which_there_is_no_room_is_refused(changes, reason):
    values = resolve('paper_circle', {'estimator.delay': 'identify', **changes})
    with pytest.raises(InputError, match=reason):
        assemble_control(configure_control(values))


def test_without_it_nothing_of_it_is_refused_or_told():
    values = resolve('paper_circle', {'estimator.delay': 'stamp', 'safety.torque_limit': 1.0})
    setup = assemble_control(configure_control(values)).setup
    assert setup.estimator.delay == 0.0 and not setup.identifies
