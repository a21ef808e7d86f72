"""The player without ROS."""

import threading
import time

import pytest
from bags import MS

from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.player import Player, PlayerOptions
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.messages import layouts, topics

START = 10**9  # ns
COUNT = 101  # messages, one a millisecond
LAW = layouts.text_message('s_fotsmc')


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / 'bag', [topics.POSE, topics.ACTIVE_LAW], {}) as writer:
        writer.write(topics.ACTIVE_LAW.name, START, LAW)
        for k in range(COUNT):
            writer.write(topics.POSE.name, START + k * MS, str(k).encode())
    reader = BagReader(tmp_path / 'bag')
    yield reader
    reader.close()


class Stage:
    """A player and what it has done: moments of messages and ticks [ms], law messages."""

    def __init__(self, bag, **options):
        self.events, self.laws, self.at = [], 0, {}
        self.player = Player(
            bag, list(bag.topics), PlayerOptions('', **options), self._send, self._tick
        )
        self.thread = threading.Thread(target=self.player.run, daemon=True)

    def _send(self, topic, data):
        if topic == '/pose':
            self.events.append(int(data))
            self.at.get(int(data), lambda: None)()
        else:
            self.laws += 1

    def _tick(self, moment):
        self.events.append(('clock', (moment - START) / MS))

    def until(self, condition):
        deadline = time.monotonic() + 100.0
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.001)

    def end(self):
        self.thread.join(100.0)
        assert not self.thread.is_alive()
        return self.events


@pytest.mark.parametrize(
    ('options', 'expected'),
    [
        ({}, range(COUNT)),
        ({'start': 0.05}, range(50, COUNT)),
        ({'start': 0.05, 'duration': 0.01}, range(50, 61)),
        ({'duration': 1e9}, range(COUNT)),
    ],
    ids=str,
)
def test_what_was_asked_is_sent_in_order(options, expected, bag):
    stage = Stage(bag, fast=True, **options)
    stage.player.run()
    assert stage.events == list(expected)
    assert stage.laws == 1  # also when it was latched before the start


def test_time_is_kept_without_drift(bag):
    arrivals = {}
    stage = Stage(bag, rate=0.5)
    stage.at = {k: lambda k=k: arrivals.setdefault(k, time.monotonic()) for k in range(COUNT)}
    begun = time.monotonic()
    stage.player.run()
    late = [arrivals[k] - begun - k * 2e-3 for k in arrivals]
    assert len(late) == COUNT and min(late) > -1e-4
    assert min(late[-20:]) < 0.02


def test_the_clock_has_its_own_grid_and_comes_first(bag):
    stage = Stage(bag, fast=True, clock=100.0, duration=0.02)
    stage.player.run()
    assert [event for event in stage.events if isinstance(event, tuple)] == [
        ('clock', 0.0),
        ('clock', 10.0),
        ('clock', 20.0),
    ]
    assert stage.events.index(('clock', 10.0)) == stage.events.index(10) - 1


def test_pause_step_seek_resume(bag):
    stage = Stage(bag, pause=True, clock=500.0, rate=1000.0)
    stage.thread.start()
    stage.until(lambda: stage.events.count(('clock', 0.0)) > 3)  # the clock stands
    assert all(stage.player.step() for _ in range(2))
    stage.until(lambda: 1 in stage.events)
    assert stage.player.position == pytest.approx(0.001)
    stage.player.seek(0.08)
    stage.until(lambda: ('clock', 80.0) in stage.events)
    assert [event for event in stage.events if isinstance(event, int)] == [0, 1]
    assert stage.player.paused and stage.player.position == pytest.approx(0.08)
    stage.player.resume()
    events = [event for event in stage.end() if isinstance(event, int)]
    assert events == [0, 1, *range(80, COUNT)]
    assert not stage.player.step() and stage.laws == 2


def test_a_new_rate_takes_effect_at_once_and_time_does_not_jump(bag):
    stage = Stage(bag, rate=1e-3)  # the next message would come after a second
    stage.thread.start()
    stage.until(lambda: 0 in stage.events)
    before = time.monotonic()
    was = stage.player.position
    stage.player.set_rate(1.0)
    now = stage.player.position
    assert 0.0 <= now - was <= time.monotonic() - before
    stage.until(lambda: 100 in stage.events)
    assert stage.end() == list(range(COUNT))
    assert time.monotonic() - before > 0.09


def recorded(directory, messages):
    """Open a bag of (log time [ms], topic), each message its own place."""
    with BagWriter(directory, topics.RECORDED, {}) as writer:
        for place, (moment, topic) in enumerate(messages):
            writer.write(topic.name, START + round(moment * MS), str(place).encode())
    return BagReader(directory)


AHEAD = [  # a run in real time, as it is recorded: each state has a time of its own
    (0.0, topics.ACTIVE_LAW), (0.1, topics.REFERENCE), (0.2, topics.JOINT_STATES),
    (0.5, topics.COMMANDS), (0.9, topics.REFERENCE), (1.3, topics.JOINT_STATES),
    (1.4, topics.REFERENCE), (1.9, topics.COMMANDS), (2.0, topics.JOINT_STATES),
]  # fmt: skip
TOGETHER = [  # a simulation: all of a sample has one log time, and the state is not the first
    (moment, topic)
    for moment in range(4)
    for topic in (topics.STATUS, topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)
]


class Steps:
    """A player that stands, in its thread, and what it has sent and when."""

    def __init__(self, bag, names=None, **options):
        self.sent, self.arrivals, self.ticks = [], [], []
        options = PlayerOptions('', pause=True, clock=1e4, **options)
        self.player = Player(bag, names or list(bag.topics), options, self._send, self._tick)
        self.thread = threading.Thread(target=self.player.run, daemon=True)
        self.thread.start()

    def _send(self, _, data):
        self.sent.append(int(data))
        self.arrivals.append(time.monotonic())

    def _tick(self, moment):
        self.ticks.append((moment - START) / MS)

    def until_it_stands(self, moment):
        """Wait until the clock has stood at a moment [ms] for some ticks."""
        self.ticks.clear()
        deadline = time.monotonic() + 100.0
        while self.ticks[-3:] != 3 * [pytest.approx(moment)]:
            assert time.monotonic() < deadline, (self.sent, self.ticks[-3:])
            time.sleep(0.001)

    def end(self):
        self.player.stop()
        self.thread.join(100.0)
        assert not self.thread.is_alive()


@pytest.mark.parametrize(
    ('messages', 'after', 'left_out'),
    [
        (AHEAD, [5, 8], ()),
        (TOGETHER, [4, 8, 12], ()),
        (AHEAD, [1, 2, 3], ('/joint_states',)),
    ],
    ids=['real time', 'one time', 'without states'],
)
def test_a_step_is_a_sample(messages, after, left_out, tmp_path):
    bag = recorded(tmp_path / 'bag', messages)
    steps = Steps(bag, [name for name in bag.topics if name not in left_out])
    wanted = [k for k, (_, topic) in enumerate(messages) if f'/{topic.name}' not in left_out]
    for count in after:
        assert steps.player.step()
        steps.until_it_stands(messages[wanted[count - 1]][0])
        assert steps.sent == wanted[:count]
    steps.end()
    bag.close()


def test_a_step_ends_with_a_seek(tmp_path):
    bag = recorded(tmp_path / 'bag', AHEAD)
    steps = Steps(bag)
    steps.player.step()
    steps.until_it_stands(0.9)
    steps.player.seek(0.0)
    steps.until_it_stands(0.0)
    assert steps.sent == [0, 1, 2, 3, 4]
    steps.end()
    bag.close()


def test_a_step_ends_when_time_goes_on(tmp_path):
    bag = recorded(tmp_path / 'bag', AHEAD)
    steps = Steps(bag, rate=1e-2)
    steps.player.step()
    steps.until_it_stands(0.9)
    resumed = time.monotonic()
    steps.player.resume()
    steps.thread.join(100.0)
    assert steps.sent == [*range(len(AHEAD))]
    assert steps.arrivals[7] - resumed > 0.0999  # s; the state before was due after 0.04
    bag.close()


def test_a_pause_takes_effect_before_the_next_message(bag):
    stage = Stage(bag, fast=True)
    paused = []
    stage.at[40] = lambda: paused.append(stage.player.pause())
    stage.thread.start()
    stage.until(lambda: paused)
    stage.player.step()
    stage.until(lambda: 41 in stage.events)
    stage.player.stop()
    assert stage.end() == list(range(42))


def test_a_loop_begins_again_at_its_start(bag):
    stage = Stage(bag, fast=True, loop=True, start=0.09)
    rounds = []
    stage.at[100] = lambda: rounds.append(1) or len(rounds) < 3 or stage.player.stop()
    stage.player.run()
    assert stage.events == 3 * list(range(90, COUNT))


def test_moments_outside_the_bag_are_refused(bag):
    with pytest.raises(InputError, match=r'0\.1 s long'):
        Stage(bag, start=0.2)
    with pytest.raises(InputError, match=r'0\.1 s long'):
        Stage(bag).player.seek(0.2)
