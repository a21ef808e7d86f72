"""The period of states, and how many are missing, from their stamps alone."""

import numpy as np
import pytest

from parallel_robot_control.joint_states import HeldCommands, MissingStates, StateRhythm

MS = 10**6  # ns
START = 10**9  # ns


def found(steps, parts=1):
    """The rhythm of states under a controller that is told 1 ms, from their steps [ms]."""
    rhythm = StateRhythm(MS)
    stamps = START + np.concatenate([[0], np.cumsum(np.multiply(steps, MS).astype(np.int64))])
    for part in np.array_split(stamps, parts):
        rhythm.note(part)
        rhythm.look()
    return rhythm


@pytest.mark.parametrize('parts', [1, 7, 300])
def test_what_is_missing_is_counted_once(parts):
    steps = np.where(np.arange(2000) % 10, 1, 4)
    rhythm = found(steps, parts)
    assert (rhythm.skipped, rhythm.period, rhythm.warning) == (3 * 200, MS, '')


@pytest.mark.parametrize('spread', [0.01, 0.3])
def test_stamps_that_are_not_on_a_grid_are_not_missing(spread):
    """0.99 ms after the last one, nothing is skipped, nor less than nothing."""
    at = np.arange(3000) + np.random.default_rng(2).uniform(-spread, spread, 3000)
    rhythm = found(np.diff(at))
    assert rhythm.skipped == 0 and not rhythm.warning
    assert found(np.full(3000, 0.99)).skipped == found(np.full(3000, 1.04)).skipped == 0


@pytest.mark.parametrize(('period', 'rate'), [(2, 500), (4, 250), (0.5, 2000), (1.25, 800)])
def test_another_period_is_told_and_is_that_of_which_states_are_missing(period, rate):
    steps = np.full(1000, float(period))
    steps[[100, 200]] *= 3
    rhythm = found(steps, 3)
    assert rhythm.skipped == 4
    assert rhythm.warning == (
        f'joint states come at {rate} Hz, the period says 1000 Hz: '
        f'give the controller the period {period / 1000:g}'
    )


def test_the_period_that_is_told_is_a_whole_number_of_microseconds_in_spite_of_jitter():
    at = 2.0 * np.arange(500) + np.random.default_rng(2).uniform(0.0, 0.1, 500)
    rhythm = found(np.diff(at))
    assert rhythm.period == 2 * MS and rhythm.skipped == 0


def test_another_run_and_commands_that_answer_no_state_are_no_states():
    rhythm = found([*[1] * 50, 700, *[1] * 50, -500, *[1] * 50])
    rhythm.note(np.zeros(5, np.int64))
    rhythm.look()
    assert rhythm.skipped == 0 and not rhythm.warning


@pytest.mark.parametrize(
    ('steps', 'taken', 'never', 'sent'),
    [
        ([1] * 1000, 0, '', ''),
        ([1] * 990 + [2] * 5, 0, '', ''),  # of 1000 five, as beside any work
        (
            [1, 1, 1, 2] * 200,
            0,
            '20 % never sent, gap up to 2 ms: ros2_control_node needs chrt',
            '',
        ),
        ([1] * 970 + [30], 0, '2.9 % never sent, gap up to 30 ms: ros2_control_node', ''),
        ([1] * 9000 + [30], 0, '0.32 % never sent, gap up to 30 ms: ros2_control_node', ''),
        ([1, 1, 1, 2] * 200, 200, '', '20 % sent in vain, gap up to 2 ms: this node or the net'),
        ([1] * 900 + [51], 50, '', ''),  # told as the states that were not answered
    ],
)
def test_missing_states_are_told_with_the_likely_cause(steps, taken, never, sent):
    missing = MissingStates(0.02)
    missing.look(found(steps).last, taken, 0.0)
    for text, told in ((never, missing.never_sent), (sent, missing.sent)):
        assert bool(text) == bool(told)
        assert told.startswith(text and f'joint states: {text}')
    assert len(missing.never_sent[:90].partition('chrt -f 25')[1]) == (10 if never else 0)  # top
    missing.look((0, 0, 0), taken, 0.0)
    assert bool(missing.never_sent) == bool(never) and not missing.sent  # not told at each look


def test_states_that_come_late_are_told_beside_those_that_are_missing():
    missing = MissingStates(0.02)
    missing.look(found([1, 1, 1, 2] * 200).last, 0, 0.342)
    assert missing.never_sent.endswith('; others come up to 342 ms late')
    assert missing.figures == '20 %, longest gap 2 ms'


RANDOM = np.random.default_rng(3)
ASKED = RANDOM.normal(size=(1000, 3))  # N m


def held(efforts, commands=ASKED, parts=100):
    """What is told of efforts, and of the commands that answer them."""
    looked = HeldCommands()
    for rows in zip(np.array_split(efforts, parts), np.array_split(commands, parts), strict=True):
        looked.note(*rows)
    looked.look()
    return looked.warning


@pytest.mark.parametrize('every', [2, 4, 10])
def test_commands_that_act_for_several_states_are_told(every):
    efforts = ASKED[np.arange(1000) // every * every]
    come = np.arange(1000) % 100 != 50  # one in a hundred is missing
    assert held(efforts[come], ASKED[come]).startswith(f'efforts change with 1 of {every} states')


@pytest.mark.parametrize(
    ('efforts', 'commands'),
    [
        (ASKED, ASKED),
        (np.full_like(ASKED, np.nan), ASKED),  # not reported
        (ASKED[np.arange(1000) // 4 * 4] + 1e-3 * RANDOM.normal(size=(1000, 3)), ASKED),  # noisy
        (ASKED[np.arange(1000) // 4 * 4],) * 2,  # nothing else was commanded
        (ASKED[np.maximum.accumulate(np.arange(1000) * (RANDOM.uniform(size=1000) < 0.4))], ASKED),
        (np.zeros_like(ASKED), ASKED),  # off
        (ASKED[:20] * np.eye(20)[:, :1], ASKED[:20]),
    ],
    ids=['each', 'none', 'noise', 'slow_law', 'late', 'off', 'few'],
)
def test_other_efforts_are_not_called_held(efforts, commands):
    assert held(efforts, commands) == ''
