"""How a run kept its time: which torque acted when."""

import json
from pathlib import Path

import numpy as np
import pytest
from assembly import simulated
from bags import MS, streams, write_foreign
from test_replay import live

from parallel_robot.analysis import timing
from parallel_robot.bags import history
from parallel_robot.bags.history import ControllerStatus
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.cli.command_line import main
from parallel_robot_control.messages import answers_message
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts, topics

START = 1_700_000_000 * 10**9  # ns
N = 1000
FACTS = {'start_stamp': str(START), 'time_mode': 'wall', 'source': 'nodes'}
NOTHING = history.History(FACTS, (), {}, (), {}, {})
RANDOM = np.random.default_rng(8)
TORQUES = RANDOM.normal(size=(N + 1, 3))  # of state k
REST = np.zeros((N + 1, 3))


def loop(lag, skipped=(), torques=TORQUES):
    """Messages of a loop; `lag` of each step [samples], `skipped` states are not answered.

    The torque of a step is that of the state `lag` before its end, or of the newest one before
    that was answered.
    """
    answered = np.setdiff1d(np.arange(N + 1), [*skipped])
    acting = np.full(N + 1, -1)
    for k in range(1, N + 1):
        at = np.searchsorted(answered, k - lag[k], side='right') - 1
        acting[k] = max(acting[k - 1], answered[at] if at >= 0 else -1)
    effort = np.where(acting[:, np.newaxis] < 0, 0.0, torques[acting])
    found = streams(REST, REST, effort, start=START)
    stamps = START + np.arange(N + 1) * MS
    commands = layouts.float64_multi_array(3).records(len(answered), data=torques[answered])
    heard = stamps[answered] + 300_000
    found[topics.COMMANDS] = [(int(t), row.tobytes()) for t, row in zip(heard, commands)]  # noqa: B905
    found[topics.ANSWERED] = [
        (
            int(heard[rows[-1]]) + 1,
            answers_message(
                np.stack([stamps[answered[rows]]] * 3, axis=1), torques[answered[rows]]
            ),
        )
        for rows in np.array_split(np.arange(len(answered)), N // 10)
    ]
    return found, np.arange(1, N + 1) - acting[1:]


@pytest.fixture
def read(tmp_path):
    def read(found, name='bag'):
        write_foreign(tmp_path / name, found)
        return recording.read(tmp_path / name).log

    return read


def changing(start, stop, *choices):
    lag = np.ones(N + 1, int)
    lag[start:stop] = RANDOM.choice(choices, stop - start)
    return lag


LAGS = {
    'ideal': (np.ones(N + 1, int), ()),
    'constant': (np.full(N + 1, 4), ()),
    'growing': (1 + np.arange(N + 1) // 20, ()),
    'random': (changing(0, N, 1, 1, 2, 3, 8), ()),
    'a stall': (changing(500, 530, 30), range(500, 530)),
    'states skipped': (np.ones(N + 1, int), RANDOM.choice(N, 300, replace=False) + 1),
    'all at once': (changing(0, N, 1, 1, 2, 9), RANDOM.choice(N, 500, replace=False) + 1),
}


@pytest.mark.parametrize('name', LAGS)
def test_the_lag_is_that_of_the_torque_that_acted(name, read):
    lag, skipped = LAGS[name]
    found, true = loop(lag, skipped)
    timed = timing.evaluate(read(found), NOTHING)
    assert np.array_equal(timed.lag, true)
    for share, figure in zip((0.5, 0.99, 1.0), timed.lag_percentiles(), strict=True):
        assert (true < figure).mean() < share <= (true <= figure).mean()
    assert timed.uncommanded == N - len(true)
    assert (timed.answered, timed.skipped) == (N + 1 - len(skipped), len(skipped))
    assert np.allclose(timed.delay, 0.0)


@pytest.mark.parametrize(('silent', 'held'), [(2, True), (8, True), (30, False)])
def test_steps_before_the_first_command_are_late_ones(silent, held, read):
    """The brake is released at state 0; the controller answers its first state later."""
    found, _ = loop(np.ones(N + 1, int), range(silent))
    effort = TORQUES[np.r_[0, 0:N]]
    effort[: silent + 1] = 0.0
    found[topics.JOINT_STATES] = streams(REST, REST, effort, start=START)[topics.JOINT_STATES]
    timed = timing.evaluate(read(found), NOTHING._replace(facts=FACTS))
    assert timed.uncommanded == 0 and timed.realtime == held
    expected = [*[1] * (N - silent), *range(2, silent + 2)]
    assert np.array_equal(np.sort(timed.lag), expected)


def test_torques_that_are_cut_off_or_stand_still_are_found(read):
    """Saturation, and a torque that is the same for a while: the lag goes on as it was."""
    torques = 150.0 * TORQUES
    torques[300:400] = torques[300]
    found, true = loop(np.full(N + 1, 2), (), torques)
    states = np.clip(torques, -200.0, 200.0)
    assert (states != torques).any()
    cut, _ = loop(np.full(N + 1, 2), (), states)
    timed = timing.evaluate(read(found | {topics.JOINT_STATES: cut[topics.JOINT_STATES]}), NOTHING)
    assert np.array_equal(timed.lag, true)


def test_what_nobody_commanded_is_counted_apart(read):
    """The motors' safe action for 50 ms, then the loop goes on; the lag is of the other steps."""
    found, _ = loop(np.ones(N + 1, int))
    effort = TORQUES[np.r_[0, 0:N]]
    effort[0], effort[400:450] = 0.0, 0.125
    found[topics.JOINT_STATES] = streams(REST, REST, effort, start=START)[topics.JOINT_STATES]
    timed = timing.evaluate(read(found), NOTHING)
    assert timed.uncommanded == 50 and len(timed.lag) == N - 50 and (timed.lag == 1).all()
    (remark,) = timing.remarks(timed, NOTHING)
    assert timed.realtime and 'in 50 steps the torque answered no state' in remark
    said = (ControllerStatus(START, 's_fotsmc', 'speed', 'too fast', ()),)
    assert 'in a fault' in timing.remarks(timed, NOTHING._replace(statuses=said))[1]


def test_verdicts(read):
    held = timing.evaluate(read(loop(np.ones(N + 1, int))[0]), NOTHING)
    assert timing.verdict(held) == 'real time: held (lag p99 1 sample)'
    assert timing.verdict(held._replace(lag=held.lag + 1)) == (
        'real time: held (lag p99 2 samples)'
    )
    lag, _ = LAGS['growing']
    late = timing.evaluate(read(loop(lag)[0], 'late'), NOTHING)
    assert timing.verdict(late).startswith(
        'real time: not held, the machine was busy: lag up to 51 ms; the metrics below are'
    )
    few = timing.evaluate(read(loop(lag, range(1, 81))[0], 'few'), NOTHING)
    assert '8 % of the states unanswered, lag up to ' in timing.verdict(few)
    assert 'use --time-mode lockstep' in timing.verdict(few)


@pytest.mark.parametrize(
    ('answered', 'lags', 'held'),
    [
        (1000, {1: 900, 5: 90, 20: 10}, True),
        (899, {1: 1000}, False),
        (900, {1: 1000}, True),
        (1000, {3: 501, 1: 499}, False),
        (1000, {1: 980, 6: 20}, False),
        (1000, {1: 999, 21: 1}, False),
    ],
)
def test_real_time_is_held_up_to_the_bounds(answered, lags, held):
    lag = np.repeat([*lags], [*lags.values()])
    timed = timing.Timing(1000, answered, 1e-3, lag, 0, np.zeros(1), {})
    assert timed.realtime is held
    slow = timed._replace(period=0.01, lag=np.minimum(lag, 2))  # two samples are always allowed
    assert slow.realtime is (answered >= 900)


@pytest.mark.parametrize(
    ('lost', 'told'), [(0, '10 % never sent, gap up to 5 ms: ros2'), (100, '')]
)
def test_states_that_were_never_sent_are_told_with_the_likely_cause(lost, told, read):
    """Those that the recorder lost are none."""
    found, _ = loop(np.ones(N + 1, int))
    away = {*range(100, 104), *range(200, 392, 2)}
    states = found[topics.JOINT_STATES]
    found[topics.JOINT_STATES] = [each for k, each in enumerate(states) if k not in away]
    log, past = read(found), NOTHING._replace(lost={'/joint_states': lost})
    timed = timing.evaluate(log, past)
    assert timing.as_json(timed)['longest_gap_s'] == 0.005
    lines = timing.never_sent(timed, log.messages, past)
    assert len(lines) == bool(told) and ''.join(lines).startswith(told and f'joint states: {told}')
    assert not timing.never_sent(timed._replace(delay=np.zeros(0)), log.messages, past)  # lockstep


def test_lags_and_delays_are_told_in_milliseconds():
    lag, delay = np.arange(1, 101), 1e-3 * np.arange(101)
    told = timing.as_json(timing.Timing(1000, 990, 2e-3, lag, 0, delay, {}))
    milliseconds = {key: value for key, value in told.items() if key.endswith('_ms')}
    assert milliseconds == pytest.approx(
        {
            'lag_p50_ms': 100.0,
            'lag_p99_ms': 198.0,
            'lag_max_ms': 200.0,
            'delay_p50_ms': 50.0,
            'delay_p99_ms': 99.0,
            'delay_max_ms': 100.0,
        }
    )


def test_a_bag_that_begins_and_ends_in_the_midst(read):
    """A recorder that came late and was killed: records and commands do not begin together."""
    found, _ = loop(np.full(N + 1, 2), range(40, 60))
    for topic in (topics.JOINT_STATES, topics.COMMANDS, topics.REFERENCE):
        found[topic] = [entry for entry in found[topic] if entry[0] > START + 333 * MS]
    found[topics.ANSWERED] = [
        entry for entry in found[topics.ANSWERED] if START + 333 * MS < entry[0] < START + 805 * MS
    ]
    log = read(found)
    timed = timing.evaluate(log, NOTHING._replace(facts={}))
    answered = np.flatnonzero(~np.isnan(log.answer[:, 0]))
    rows = np.rint(log.time[answered] * 1e3).astype(int) + 334
    assert np.array_equal(log.answer[answered], TORQUES[rows])
    assert timed.skipped == 0 and (timed.lag == 2).all()
    assert log.messages['effort_controller/commands'].missing == 0


def test_commands_that_are_lost_and_states_that_are_skipped_are_told_apart(read):
    found, _ = loop(np.ones(N + 1, int), range(100, 150))
    del found[topics.COMMANDS][500:503]
    log = read(found)
    assert log.messages['effort_controller/commands'].missing == 3
    timed = timing.evaluate(log, NOTHING)
    assert timed.skipped in (50, 53)  # where exactly they were lost, nobody knows


def test_records_that_are_lost_are_no_lost_commands(read):
    found, _ = loop(np.ones(N + 1, int))
    del found[topics.ANSWERED][40]
    log = read(found)
    assert log.messages['effort_controller/commands'].missing == 0
    assert log.messages['controller/answered'].missing == 1
    assert np.isnan(log.answer).any(axis=1).sum() == 10
    assert np.array_equal(log.answer[600:700], TORQUES[600:700])


def test_log_times_out_of_order_change_nothing(read):
    found, _ = loop(np.ones(N + 1, int), range(200, 220))
    late = RANDOM.random(len(found[topics.COMMANDS])) < 0.05
    found[topics.COMMANDS] = [
        (log_time + (3 * MS // 5 if k % 10 == 5 and late[k] else 0), data)
        for k, (log_time, data) in enumerate(found[topics.COMMANDS])
    ]
    log = read(found)
    answered = ~np.isnan(log.answer[:, 0])
    assert np.array_equal(log.answer[answered], TORQUES[answered]) and answered.sum() == N + 1 - 20


def test_telemetry_of_skipped_states_is_not_missing(read):
    found, _ = loop(np.ones(N + 1, int), range(95, 124))
    layout = layouts.joint_state(('joint1', 'joint2', 'joint3'), ('position',))
    due = [k for k in range(0, N + 1, 10) if k not in (100, 110, 120)] + [124]
    for topic, left_out in ((topics.SLIDING_VARIABLE, ()), (topics.ERROR, (500, 510))):
        found[topic] = [
            (START + k * MS, layout.encode(START + k * MS)) for k in due if k not in left_out
        ]
    log = read(found)
    assert log.messages['controller/sliding_variable'].missing == 0
    assert log.messages['controller/error'].missing == 2


@pytest.mark.parametrize('old', [{}, {'sensor.delay': 0.004, 'sensor.stamp': 'measured'}])
def test_a_simulation_has_no_verdict_and_the_ideal_lag(old, tmp_path):
    values = config.resolve('paper_circle', {'duration': 0.3, 'time_mode': 'lockstep', **old})
    simulation_bag.write(tmp_path / 'bag', values, [simulated(values)])
    log, past, _ = recording.read(tmp_path / 'bag')
    timed = timing.evaluate(log, past)
    assert timed.realtime is None and timing.verdict(timed) == '' and not timed.delay.size
    steps = 296 if old else 300  # the last ones are in states that were not told any more
    assert (timed.lag == 1).all() and len(timed.lag) == steps and timed.uncommanded == 0
    assert (timed.answered, timed.skipped) == (301, 0)


def test_analyze_prints_the_verdict_above_the_metrics(tmp_path, capsys):
    bag = live(tmp_path / 'bag', {}, skipped={*range(100, 140)})
    assert main(['analyze', str(bag), '--json', str(tmp_path / 'run.json')]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith('real time: not held') and '10 % of the states unanswered' in first
    found = json.loads((tmp_path / 'run.json').read_text())['timing']
    assert (found['answered'], found['skipped'], found['realtime']) == (361, 40, False)
    assert (found['lag_p50_ms'], found['lag_max_ms']) == (1.0, 41.0)


def test_an_older_bag_says_nothing_about_lost_commands(tmp_path, capsys):
    found, _ = loop(np.ones(N + 1, int))
    del found[topics.ANSWERED], found[topics.COMMANDS][10]
    write_foreign(tmp_path / 'bag', found)
    log = recording.read(tmp_path / 'bag').log
    timed = timing.evaluate(log, NOTHING)
    assert timed.realtime is None and timed.answered is None and timing.as_json(timed)
    assert main(['analyze', str(tmp_path / 'bag')]) == 2  # its angles are of no robot
    assert Path(tmp_path / 'bag').exists() and 'forward kinematics' in capsys.readouterr().err


@pytest.mark.parametrize(('facts', 'states'), [(FACTS, N + 1), ({}, 501)])
def test_a_controller_that_falls_silent_has_not_held_real_time(facts, states, read):
    """In a motion that was planned; nodes that were started by hand may be ended one by one."""
    found, _ = loop(np.ones(N + 1, int), range(501, N + 1))
    effort = TORQUES[np.r_[0, 0:N]]
    effort[0], effort[502:] = 0.0, 0.125  # the safe action of the motors
    found[topics.JOINT_STATES] = streams(REST, REST, effort, start=START)[topics.JOINT_STATES]
    timed = timing.evaluate(read(found), NOTHING._replace(facts=facts))
    assert (timed.answered, timed.states) == (501, states)
    assert timed.realtime is (not facts)
