"""What is learned from turn to turn: beside an independent model, in the loop, and when not."""

import numpy as np
import pytest
from assembly import simulated
from vectors import setup_of

from parallel_robot.cli.command_line import main
from parallel_robot_control import repetition
from parallel_robot_control.configuration import resolve
from parallel_robot_control.contract import JointReference
from parallel_robot_control.laws import LAWS
from parallel_robot_control.repetition import (
    RepetitionParameters,
    repetition_memory,
    weights_of,
)
from parallel_robot_model.compiler import (
    Boxed,
    as_constants,
    kernel,
    read_row,
    vector,
    write_row,
)

T = 1e-3
N = 3
LIMIT = vector(np.full(N, 5.0))
ONE_SECOND = {'circle.rate': 2.0 * np.pi, 'circle.radius': 0.02, 'approach.duration': 0.2}
NEARLY_EXACT = (
    'continuous_twisting',
    'calm_tracking',
)  # without learning: little is left to learn
LEARNING = {'repetition.gain': 0.5, 'repetition.wait': 0.5, **ONE_SECOND}


def learner(turn, gain=0.5, lead=0.0, cutoff=50.0, wait=0.0, period=T):
    parameters = RepetitionParameters(gain, turn * period, lead, cutoff, wait)
    memory = setup_of(repetition=repetition_memory(parameters, N, turn, period))
    return setup_of(
        repetition=Boxed(as_constants(parameters)),
        safety=setup_of(torque_limit=LIMIT),
        has_model=True,
        repetition_samples=turn,
        period=period,
        memory=memory,
    )


@kernel
def _turns(learner, samples, positions, corrections, believed, alone, like):
    """What is added at each sample; the controller is new at the first one."""
    added = np.zeros_like(corrections)
    for k in range(len(samples)):
        position = read_row(positions, k, like)
        reference = JointReference(position, 0.0 * like, 0.0 * like)
        torque = repetition.recalled(learner, samples[k], k > 0, alone[k], False, reference)
        correction = read_row(corrections, k, like)
        repetition.learn(learner, samples[k], reference, torque, correction, believed[k])
        write_row(added, k, torque)
    return added


def turns(learner, corrections, samples=None, positions=None, believed=None, alone=None):
    count = len(corrections)
    samples = np.arange(count) if samples is None else samples
    if positions is None:  # the same in every turn
        positions = np.random.default_rng(1).normal(size=(learner.repetition_samples, N))
        positions = positions[np.arange(count) % learner.repetition_samples]
    yes = np.ones(count, bool)
    believed, alone = (yes if given is None else given for given in (believed, alone))
    return _turns(learner, samples, positions, corrections, believed, alone, LIMIT)


def expected(corrections, turn, gain, lead, weights, believed):
    """u(t + turn) = sum h_i (u(t + i) + gain c(t + i + lead)), sample by sample."""
    count, side = len(corrections), len(weights) - 1
    taps = np.concatenate([weights[:0:-1], weights])
    learned = np.where(believed[:, None], gain * corrections, 0.0)
    learned = np.concatenate([learned[lead:], np.zeros((lead, N))])
    added = np.zeros((count, N))
    known = np.zeros((count + side, N))  # of what was before the first sample, nothing
    for k in range(count):
        if k >= turn:
            added[k] = taps @ known[k - turn : k - turn + 2 * side + 1]
        known[side + k] = added[k] + learned[k]
    return added


def test_filter_passes_slow_things_without_phase_and_half_the_power_at_its_cutoff():
    for cutoff in (5.0, 10.0, 60.0):
        weights = weights_of(cutoff, T)
        taps = np.zeros(20_000)  # symmetric about 0: its transform is real
        taps[: len(weights)], taps[-len(weights) + 1 :] = weights, weights[:0:-1]
        gain, frequency = np.fft.fft(taps), np.fft.fftfreq(len(taps), T)
        assert np.abs(gain.imag).max() < 1e-12
        assert gain.real.min() > -0.01 and gain.real.max() < 1.0 + 1e-12
        at = np.interp(cutoff, frequency[: len(taps) // 2], gain.real[: len(taps) // 2])
        assert at == pytest.approx(np.sqrt(0.5), abs=2e-3)
        assert gain.real[np.abs(frequency) < 0.2 * cutoff].min() > 0.995


@pytest.mark.parametrize(('gain', 'lead'), [(0.5, 0), (1.0, 0), (0.3, 4)])
def test_what_is_added_is_the_formula(gain, lead):
    turn, random = 90, np.random.default_rng(3)
    corrections = random.normal(size=(5 * turn + 17, N))
    believed = random.random(len(corrections)) < 0.9
    made = learner(turn, gain, lead * 0.1, 0.6, period=0.1)  # of 0.1 s: it fades in at once
    told = expected(corrections, turn, gain, lead, weights_of(0.6, 0.1), believed)
    found = turns(made, corrections, believed=believed)
    assert not found[:turn].any() and np.abs(found[turn:]).max() > 0.1
    np.testing.assert_allclose(found, told, atol=1e-12)


def test_absolute_samples_do_not_matter():
    corrections = np.random.default_rng(5).normal(size=(400, N))
    first = turns(learner(100), corrections)
    later = turns(learner(100), corrections, samples=10**12 + 37 + np.arange(400))
    assert first[200:].any() and np.array_equal(first, later)


def test_it_comes_in_without_a_jump_and_only_where_the_motion_repeats():
    turn = 300
    corrections = np.ones((4 * turn, N))
    positions = np.random.default_rng(1).normal(size=(turn, N))[np.arange(4 * turn) % turn]
    found = turns(learner(turn), corrections, positions=positions)
    assert found[turn + 150] == pytest.approx(0.5) and found[-150] == pytest.approx(1.5)
    assert np.abs(np.diff(found, axis=0)).max() < 0.05
    positions[2 * turn + 150 :] += 0.1  # another motion
    other = turns(learner(turn), corrections, positions=positions)
    assert np.array_equal(other[: 2 * turn + 150], found[: 2 * turn + 150])
    assert not other[2 * turn + 251 : 3 * turn + 150].any()
    assert np.abs(np.diff(other, axis=0)).max() < 0.05 and other[3 * turn + 260 :].all()


def test_what_limits_cut_off_is_not_learned_and_no_more_than_the_limit():
    corrections, turn = np.full((12 * 200, N), 8.0), 200
    assert not turns(learner(turn), corrections, believed=np.zeros(12 * turn, bool)).any()
    most = turns(learner(turn), corrections)
    assert most[-100] == pytest.approx(5.0) and most.max() < 5.1  # a filter may overshoot


def test_a_start_forgets_and_a_way_back_waits():
    turn, corrections = 200, np.ones((1000, N))
    made = learner(turn, wait=0.1)
    first = turns(made, corrections)
    assert not first[:300].any() and first[-1].all()
    assert np.array_equal(turns(made, corrections), first)  # the next run knows nothing of it
    alone = np.ones(1000, bool)
    alone[620:640] = False
    after = turns(made, corrections, alone=alone)
    assert np.array_equal(after[:620], first[:620])
    assert not after[620:739].any()  # the wait is over at 739
    assert after[745].all() and after[850] == pytest.approx(first[650], rel=0.1)


def test_states_that_are_left_out_leave_what_was_learned():
    turn, corrections = 200, np.ones((1400, N))
    whole = turns(learner(turn), corrections)
    samples = np.delete(np.arange(1400), np.arange(820, 920))
    positions = np.random.default_rng(1).normal(size=(turn, N))[samples % turn]
    found = turns(learner(turn), corrections[: len(samples)], samples, positions)
    of = dict(zip(samples.tolist(), found, strict=True))
    assert np.array_equal(found[:820], whole[:820])
    assert whole[1070] == pytest.approx(whole[870] + 0.5, abs=1e-3)
    assert of[1070] == pytest.approx(whole[870], abs=1e-3)  # as one turn before
    assert of[970] == pytest.approx(whole[970], abs=1e-3)


def of_turns(values):
    """Rms error of x and y in each second [m]."""
    made = simulated(values)
    error = (made.run.pose - made.reference.pose)[:-1, :2]
    return np.sqrt((error**2).sum(axis=1).reshape(-1, 1000).mean(axis=1)), made


@pytest.mark.parametrize('frequency', [2.0, 5.0])
def test_errors_of_a_sine_fall_as_the_theory_says(frequency):
    """Computed torque on the exact robot: T = (Kd s + Kp) / (s^2 + Kd s + Kp)."""
    exact = {
        'law': 'computed_torque', 'friction.coulomb': 0.0, 'friction.viscous': 0.0,
        'disturbance.amplitude': 1.0, 'disturbance.frequency': frequency,
        'circle.radius': 0.002, 'duration': 9.0, 'repetition.lead': 0.004,
    }  # fmt: skip
    values = resolve('paper_circle', {**LEARNING, **exact})
    s = 2j * np.pi * frequency
    kp, kd = values['computed_torque.Kp'], values['computed_torque.Kd']
    law = (kd * s + kp) / (s**2 + kd * s + kp)
    weights = weights_of(values['repetition.cutoff'], T)
    q = weights[0] + 2.0 * weights[1:] @ np.cos(abs(s) * T * np.arange(1, len(weights)))
    factor = q * (1.0 - 0.5 * law * np.exp(0.004 * s))

    def sines(gain):
        made = simulated({**values, 'repetition.gain': gain})
        error = (made.reference.position - made.run.joints)[:-1].reshape(-1, 1000, N)
        return np.einsum('tki,k->ti', error, np.exp(-s * T * np.arange(1000)))

    stays = (1.0 - q) / (1.0 - factor)
    left = sines(0.5)[3:] / sines(0.0)[-1] - stays
    ratios = left[1:4] / left[:3]
    np.testing.assert_allclose(ratios, factor, atol=0.02)


def test_a_turn_in_which_nothing_is_known_has_the_bits_of_no_learning():
    given = {**LEARNING, 'duration': 2.0, 'law': 'lqg_tracking'}
    learns = simulated(resolve('paper_circle', given)).run.command
    without = simulated(resolve('paper_circle', {**given, 'repetition.gain': 0.0})).run.command
    assert np.array_equal(learns[:1000], without[:1000])
    assert np.abs(learns - without)[1600:].max() > 0.01


@pytest.mark.parametrize('law', LAWS)
def test_laws_gain_where_a_disturbance_comes_back(law):
    given = {**LEARNING, 'law': law, 'disturbance.ripple': 0.5, 'duration': 10.0}
    learns, made = of_turns(resolve('paper_circle', given))
    without, _ = of_turns(resolve('paper_circle', {**given, 'repetition.gain': 0.0}))
    assert not made.fault
    assert learns[-1] < (0.8 if law in NEARLY_EXACT else 0.36) * without[-1]


@pytest.mark.parametrize('scenario', ['five_bar_circle', 'serial_2r_circle', 'delta_circle'])
def test_other_robots_gain(scenario):
    turn = {'five_bar_circle': 1.0, 'serial_2r_circle': 6.0, 'delta_circle': 2.0}[scenario]
    given = {
        'law': 'computed_torque', 'approach.duration': 0.2, 'repetition.wait': 0.5,
        'duration': 6.0 * turn,
    }  # fmt: skip

    def last(gain):
        made = simulated(resolve(scenario, {**given, 'repetition.gain': gain}))
        error = (made.run.pose - made.reference.pose)[-round(turn / T) :]
        return np.sqrt((error**2).mean())

    assert last(0.5) < 0.3 * last(0.0)


def test_a_fault_is_survived_and_what_was_learned_comes_back():
    hazards = [
        {'what': 'motors_off', 'at': 5.3, 'for': 0.4},
        {'what': 'clear_fault', 'at': 6.0},
    ]
    given = {**LEARNING, 'law': 'pid', 'duration': 12.0}
    errors, made = of_turns(resolve('paper_circle', {**given, 'hazards': hazards}))
    without, _ = of_turns(resolve('paper_circle', {**given, 'repetition.gain': 0.0}))
    assert [bool(text) for _, text in made.faults] == [True, False]
    assert errors[8] < 0.1 * without[8]  # what is learned anew has a half


@pytest.mark.parametrize(
    ('scenario', 'given', 'said'),
    [
        ('paper_line', 'repetition.gain=0.5', 'trajectory.shape line does not repeat'),
        ('paper_circle', 'repetition.gain=1.5', 'repetition.gain must be from 0 to 1'),
        ('paper_circle', 'repetition.gain=0.5 circle.rate=2.0', 'speed_factor 0.99987'),
        ('paper_circle', 'repetition.gain=0.5 repetition.period=5.0', 'not repeat after 5 s'),
        ('paper_circle', 'repetition.gain=0.5 repetition.period=60.0 circle.rate=1.0', 'repeat'),
        ('paper_circle', 'repetition.gain=0.5 repetition.period=600.0', '0.001 to 60 s'),
        ('paper_circle', 'repetition.gain=0.5 repetition.period=0.0', '0.001 to 60 s'),
        ('paper_circle', 'repetition.gain=0.5 repetition.period=nan', 'repetition.period'),
        ('paper_circle', 'repetition.gain=0.5 repetition.period=turn', 'repetition.period'),
        ('paper_circle', 'repetition.gain=0.5 repetition.cutoff=0.5', 'must be at least'),
        ('paper_circle', 'repetition.gain=0.5 hold.pose=[] trajectory.shape=hold', 'not repeat'),
    ],
)  # fmt: skip
def test_what_cannot_be_learned_costs_one_line(scenario, given, said, tmp_path, capsys):
    sets = [word for each in given.split() for word in ('--set', each)]
    out = tmp_path / 'bag'
    words = ['simulate', scenario, '--duration', '0.1', '--out', str(out), *sets]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert said in told and told.count('\n') == 1 and not out.exists()


def test_the_speed_factor_that_is_named_makes_turns_whole(tmp_path, capsys):
    words = ['simulate', 'paper_circle', '--duration', '0.1', '--set', 'circle.rate=2.0',
             '--set', 'repetition.gain=0.5', '--out', str(tmp_path / 'bag')]  # fmt: skip
    assert main(words) == 2
    factor = capsys.readouterr().err.split('trajectory.speed_factor ')[1].split()[0]
    assert main([*words, '--set', f'trajectory.speed_factor={factor}']) == 0
