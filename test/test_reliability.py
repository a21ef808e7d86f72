"""What the benchmarks of faults and endurance compute, without ROS."""

import numpy as np
import pytest
from assembly import simulated
from reliability import endurance, page
from reliability.effects import Effect, Line
from reliability.judging import BOUND, QUIET, Outcome, Record, is_well, judge, recovery_time

from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import simulation_bag
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts

TIME = np.arange(300) * 0.01  # s
MS = 1e-3  # s
LIMIT = 200.0  # N m


def line(**effect):
    made = Line(seed=1)
    made.change(Effect(**effect), 0.0)
    return made


def test_a_share_of_the_messages_is_lost_the_same_in_every_run():
    runs = [
        [line.due(k * MS) for k in range(10_000)] for line in (line(drop=0.05), line(drop=0.05))
    ]
    assert runs[0] == runs[1]
    assert runs[0].count(None) == pytest.approx(500, abs=70)
    assert all(due in (None, k * MS) for k, due in enumerate(runs[0]))


def test_delayed_messages_pass_in_order_also_when_the_delay_ends():
    delayed = line(delay=0.02)
    assert delayed.due(1.0) == pytest.approx(1.02)
    delayed.change(Effect(), 1.001)
    assert delayed.due(1.001) == pytest.approx(1.02)
    assert delayed.due(1.03) == 1.03


def test_a_burst_holds_everything_up_and_lets_it_pass_at_once():
    held = line(burst=0.05, every=0.5)
    dues = [held.due(k * MS) for k in range(1000)]
    assert dues[:50] == pytest.approx([0.05] * 50)
    assert dues[50:500] == [k * MS for k in range(50, 500)]
    assert dues[500:550] == pytest.approx([0.55] * 50)


@pytest.mark.parametrize('shift', [0.1, -0.1, 10.0, -10.0])
def test_a_stamp_is_shifted_and_nothing_else(shift):
    layout = layouts.joint_state(('a', 'b'))
    values = {'position': [1.0, 2.0], 'velocity': [3.0, 4.0], 'effort': [5.0, 6.0]}
    stamp = 10**18 + 5
    shifted = line(shift=shift).falsify(layout.encode(stamp, **values))
    assert shifted == layout.encode(stamp + round(shift * 1e9), **values)
    assert line().falsify(shifted) == shifted


def test_recovery_counts_from_the_end_of_the_fault_to_the_first_half_second_below_the_bound():
    distance = np.full(300, 0.5 * BOUND)
    assert recovery_time(TIME, distance, 1.0) == 0.0
    distance[50:150] = 2 * BOUND  # to 1.49 s
    distance[170] = 2 * BOUND  # before it was below for long enough
    distance[280] = 2 * BOUND  # long after
    assert recovery_time(TIME, distance, 1.0) == pytest.approx(0.7)
    distance[200:280:40] = np.nan
    assert recovery_time(TIME, distance, 1.0) is None
    assert recovery_time(TIME[:0], distance[:0], 0.0) is None


def test_a_loop_is_well_after_half_a_second_below_the_bound():
    distance = np.full(300, 0.5 * BOUND)
    assert is_well(TIME, distance)
    distance[300 - round(QUIET / 0.01) + 2] = 2 * BOUND
    assert not is_well(TIME, distance)
    assert not is_well(TIME[:20], distance[:20])
    assert not is_well(TIME[:0], distance[:0])


def record(**changes):
    distance = np.full(300, 0.5 * BOUND)
    distance[20:60] = 3e-3
    return Record(TIME, distance, 0.3, np.full((5, 3), -LIMIT), True)._replace(**changes)


def test_a_fault_that_was_cleared_is_no_failure():
    found = judge('cut', record(faults=('stale', 'stale', 'jump'), notes=('plant: x',)), LIMIT)
    assert found.reaction == 'fault: stale; fault: jump; plant: x'
    assert found.failures == ()
    assert (found.worst, found.torque) == (3e-3, LIMIT)
    assert found.recovery == pytest.approx(0.29)
    assert judge('cut', record(), LIMIT).reaction == 'ridden through'


@pytest.mark.parametrize(
    ('changes', 'failure'),
    [
        ({'finite': False}, 'a value was not finite'),
        ({'torque': np.full((1, 3), LIMIT + 0.5)}, 'torque of 200.5 N m, limit 200 N m'),
        ({'torque': np.full((1, 3), np.nan)}, 'torque of nan N m, limit 200 N m'),
        ({'distance': np.full(300, 3e-3)}, 'error not below 0.1 mm again'),
        ({'failures': ('plant ended: boom',)}, 'plant ended: boom'),
    ],
)
def test_what_must_not_happen_fails_the_row(changes, failure):
    assert judge('cut', record(**changes), LIMIT).failures == (failure,)


def test_a_row_of_the_table_says_what_failed():
    good = Outcome('5 ms late', 'ridden through', 42e-6, 0.0, 1.84, ())
    assert page.row(good) == '| 5 ms late | ridden through | 42 µm | never above | 1.8 N m |'
    bad = good._replace(worst=0.0123, recovery=None, failures=('plant ended: a|b',))
    assert page.row(bad) == (
        '| 5 ms late | ridden through; **plant ended: a\\|b** | 12.3 mm | not | 1.8 N m |'
    )
    late = good._replace(worst=2.5e-4, recovery=1.234)
    assert page.row(late).split(' | ')[2:4] == ['250 µm', '1.23 s']
    text = page.faults([good, bad], ['period=0.002'])
    assert '`period=0.002`' in text and text.endswith('happened: 5 ms late.')
    assert page.row(bad) in text and page.row(good) not in text
    assert 'Ridden through with at most 42 µm and 1.8 N m: 5 ms late.' in text
    assert page.faults([good], []).endswith('Nothing that must not happen happened.')
    several = [good, good._replace(fault='none'), good._replace(fault='10 ms late')]
    assert page.ridden_through(several).endswith(' N m: 5, 10 ms late; none.')


def test_faults_that_led_to_the_same_are_one_row_of_the_worst():
    first = Outcome('a step by -0.1 s', 'fault: late', 0.02, 1.2, 3.0, ())
    second = first._replace(fault='a step by -10 s', worst=0.01, recovery=1.5, torque=4.0)
    other = first._replace(fault='a step by +10 s', reaction='fault: ahead')
    failed = first._replace(fault='a step by -20 s', recovery=None, failures=('it ended',))
    rows = page.together([first, other, second, failed])
    assert rows == [
        Outcome('a step by -0.1, -10 s', 'fault: late', 0.02, 1.5, 4.0, ()), other, failed,
    ]  # fmt: skip
    assert page.together([first, second._replace(recovery=None)])[0].recovery is None
    text = page.faults([first, other, second, failed], [])
    assert '| a step by -0.1, -10 s | fault: late | 20.0 mm | 1.50 s | 4.0 N m |' in text
    assert text.endswith('happened: a step by -20 s.')
    texts = ['1.7 times', 'no', '1.7 times', '2.5 times']
    assert page.joined(texts, page.NUMBER) == ['1.7, 2.5 times', 'no']
    assert page.joined(['plant late', 'states late'], page.SUBJECT) == ['plant, states late']


def test_a_section_is_written_without_touching_the_others(tmp_path):
    path = tmp_path / 'page.md'
    path.write_text(
        'a\n<!-- one -->\nold\n<!-- end of one -->\nb\n<!-- two -->\n<!-- end of two -->\n'
    )
    page.write('one', 'new \\1', path)
    page.write('two', 'more', path)
    assert path.read_text() == (
        'a\n<!-- one -->\nnew \\1\n<!-- end of one -->\n'
        'b\n<!-- two -->\nmore\n<!-- end of two -->\n'
    )
    with pytest.raises(ValueError, match='three'):
        page.write('three', '', path)
    for name in ('faults', 'soak'):
        page.replaced(page.PAGE.read_text(), name, '')


def test_memory_is_compared_after_the_first_minute_whatever_its_peaks():
    time = np.arange(600.0)
    size = 1e8 + np.where(time < 50, 5e7, 0.0) + 1e3 * time
    size[[70, 590]] += 1e8
    found = endurance.growth([*zip(time, size, strict=True)])
    assert found.first == pytest.approx(1e8 + 75e3, abs=2e3)
    assert found.growth == pytest.approx(510e3, abs=2e3)


@pytest.fixture(scope='module')
def log(tmp_path_factory):
    bag = tmp_path_factory.mktemp('soak') / 'bag'
    values = config.resolve('paper_circle', {'duration': 0.1, 'time_mode': 'lockstep'})
    simulation_bag.write(bag, values, [simulated(values)])
    return recording.read(bag).log


def flat(growth=0.0):
    return {'plant': [(float(t), 1e8 + growth * (t > 300)) for t in range(600)]}


def test_a_long_run_that_lost_nothing_is_good(log):
    lost = {'effort_controller/commands': 3}  # states that were overtaken
    found = endurance.judge(0.1, flat(1e6), log, lost, 0.1, 0)
    assert found.failures == ()
    assert (found.states, found.expected, found.answered) == (101, 101, 101)
    assert found.rate == pytest.approx(1000.0)
    assert '| states in the bag | 101 of 101 |' in page.soak(found)


@pytest.mark.parametrize(
    ('changes', 'failure'),
    [
        ({'memory': flat(2**20 + 4096)}, 'plant grew by 1.00 MB'),
        ({'duration': 0.101}, '101 states instead of 102'),
        ({'recorded': 0.1002}, '998.00 states per second instead of 1000'),
        ({'lost': {'joint_states': 2}}, '0 messages missing, 2 known to be lost'),
        ({'code': 1}, 'the run ended with exit code 1'),
    ],
)
def test_what_a_long_run_must_not_do(log, changes, failure):
    good = {'duration': 0.1, 'memory': flat(), 'log': log, 'lost': {}, 'recorded': 0.1, 'code': 0}
    assert endurance.judge(**good | changes).failures == (failure,)
