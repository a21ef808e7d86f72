"""The publisher heard first is used; no message of another one is, however rare or close."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from parallel_robot_model.nodes.joint_reader import PERIODS, RUN, SETTLED, SILENCE, SinglePublisher

PERIOD = 1e-3  # s
FIRST, SECOND = 'first', 'second'


class Topic:
    """A topic on which some publish, and what its reader uses."""

    def __init__(self):
        self.now, self.publishers, self.used, self.several = 100.0, 1, [], False
        self._watch = SinglePublisher(lambda: self.publishers == 1, lambda: self.now)

    def hear(self, number, after=PERIOD, who=FIRST):
        """Hear a message some time after the last one."""
        self.now += after
        if not self._watch.is_unknown(number):
            self.used.append((who, number))
        else:
            self.several |= self._watch.several()

    def hear_all(self, numbers, after=PERIOD, who=FIRST):
        for number in numbers:
            self.hear(number, after, who)

    @property
    def silence(self):
        return self._watch.silence

    @property
    def lost(self):
        return self._watch.lost

    def contradicted(self, shared):
        return self._watch.contradicted(shared)

    def numbers(self, who=FIRST):
        return [number for one, number in self.used if one == who]


def stream(who, first, period, start, end, lost=()):
    """Messages as (time, publisher, number)."""
    for k in itertools.count():
        time = start + k * period
        if time > end:
            return
        if k not in lost:
            yield time, who, first + k


@pytest.mark.parametrize('period', [1.0, 0.1, 1e-3, 2e-4])
@pytest.mark.parametrize(
    'numbers',
    [
        range(1, 100),
        range(700, 800),  # heard late
        [*range(1, 50), *range(60, 90), *range(91, 200, 2), 90_000],  # losses
        [0] * 100,  # a middleware without numbers
    ],
)
def test_one_publisher_passes(numbers, period):
    topic = Topic()
    topic.hear_all(numbers, period)
    assert topic.numbers() == list(numbers) and not topic.several


@pytest.mark.parametrize('ghost', [False, True])
@pytest.mark.parametrize('period', [1.0, 0.1, 1e-3, 2e-4])
@pytest.mark.parametrize('away', [0.0, 3.0])
def test_a_publisher_that_is_started_again_passes_after_a_silence(period, away, ghost):
    topic = Topic()
    topic.hear_all(range(10_001, 10_201), period)
    topic.publishers += ghost  # of the one that was killed
    count = round(10.0 / period)
    topic.hear(1, away + period)
    topic.hear_all(range(2, count), period)
    held = count - len(topic.numbers()[200:])
    silence = max(SILENCE, PERIODS * period if ghost else 0.0) - away
    assert topic.numbers()[200:] == list(range(held, count)) and not topic.several
    assert held <= max(RUN, silence / period + 1)


def test_what_was_sent_and_did_not_come_is_counted():
    topic = Topic()
    for after, number in ((PERIOD, 7), (PERIOD, 8), (PERIOD, 10), (0.1, 60), (PERIOD, 61)):
        topic.hear(number, after)
    assert topic.lost == 1 + 49 and topic.numbers() == [7, 8, 10, 60, 61]


def test_how_long_one_was_silent_is_known_when_another_takes_its_place():
    topic = Topic()
    topic.hear_all(range(500, 600))
    topic.publishers = 2  # one of them was killed
    topic.hear(1, 2.0, SECOND)
    topic.hear_all(range(2, 50), who=SECOND)
    assert topic.silence == pytest.approx(2.0, abs=0.01) and topic.numbers(SECOND)


def test_numbers_may_wrap():
    topic = Topic()
    topic.hear_all(range(2**32 - 100, 2**32))
    topic.hear_all(range(1000))  # the first of them is that of a middleware without numbers
    assert topic.numbers()[-400:] == list(range(600, 1000))


@pytest.mark.parametrize('numbers', [range(1, 100), [*range(1, 100, 7), *range(300, 400)]])
def test_losses_are_not_called_a_second_publisher_where_others_are_told_apart(numbers):
    """On a topic with the states of a gripper, too, the middleware counts two publishers."""
    topic = Topic()
    topic.publishers = 2
    topic.hear_all(numbers)
    topic.hear(10_000)
    assert topic.used and not topic.several and not topic.contradicted(shared=True)
    for number in range(10_001, 10_601):
        topic.hear_all([number, number + 5000])
    assert topic.contradicted(shared=True)


@pytest.mark.parametrize('stall', [0.05, 0.3])
def test_a_reader_that_stood_still_uses_what_waited_beside_a_second_publisher(stall):
    """What waited comes at once: some of it, then the newest."""
    topic = Topic()
    topic.hear_all(range(1, 1000))
    topic.publishers = 2
    missed = round(stall / PERIOD)
    numbers = [1000, 1000 + missed // 2, 1000 + missed, *range(1001 + missed, 2000)]
    topic.hear(numbers[0], stall)
    topic.hear_all(numbers[1:3], 1e-4)
    topic.hear_all(numbers[3:])
    assert topic.numbers()[999:] == numbers


def test_a_slow_reader_uses_what_it_hears_beside_a_second_publisher():
    topic = Topic()
    topic.hear_all(range(1, 1000))
    topic.publishers = 2
    topic.hear_all(range(1003, 9000, 4), 4 * PERIOD)
    assert topic.numbers()[999:] == list(range(1003, 9000, 4))


@pytest.mark.parametrize('burst', [1, 7, 100])
@pytest.mark.parametrize('lead', [-90_000, -5000, -300, 300, 5000])
def test_of_two_publishers_the_first_alone_is_used(lead, burst):
    topic = Topic()
    topic.hear_all(range(100_000, 100_100))
    topic.publishers = 2
    for k in range(100_100, 101_500, burst):
        topic.hear_all(range(k + lead, k + lead + burst), PERIOD / 2, SECOND)
        topic.hear_all(range(k, k + burst), PERIOD / 2)
    assert topic.used == [(FIRST, k) for k in range(100_000, k + burst)] and topic.several


@given(
    period=st.sampled_from([1e-3, 1.1e-3, 0.9e-3, 0.01, 0.3, 1.2]),
    ahead=st.one_of(st.integers(-1400, 3000), st.integers(-9, 9)),
    start=st.floats(0.5, 2.0),
    lost=st.sets(st.integers(0, 4000), max_size=400),
    stalls=st.lists(st.floats(0.0, 4.0), max_size=2),
)
def test_no_message_of_a_second_publisher_is_used(period, ahead, start, lost, stalls):
    """Whatever its rate and its numbers, when messages are lost, and many at a time."""
    numbers = stream(FIRST, 1000, PERIOD, 0.0, 4.0, lost)
    own = [sent for sent in numbers if not any(s < sent[0] < s + 0.2 for s in stalls)]
    last = max(number for time, _, number in own if time < start)
    now = 1000 + start / PERIOD
    begins = round(now) + ahead
    if last < begins < last + 4 + 1.5 * (now - last):
        return  # its first message can be the next one of the first publisher
    topic = Topic()
    for time, who, number in sorted([*own, *stream(SECOND, begins, period, start, 4.0)]):
        topic.publishers = 1 + (time >= start)
        topic.hear(number, 100.0 + time - topic.now, who)
    assert not topic.numbers(SECOND)
    if ahead < -1000 and period >= PERIOD:  # never near
        assert topic.numbers() == [number for *_, number in own]


@pytest.mark.parametrize('lead', range(-2, 1))
def test_a_message_that_may_be_of_either_is_not_used_until_one_ends(lead):
    topic = Topic()
    topic.hear_all(range(1, 1000))
    topic.publishers = 2
    for k in range(1000, 2000):
        topic.hear(k, PERIOD / 2)
        topic.hear(k + lead, PERIOD / 2, SECOND)
    assert not topic.numbers(SECOND) and topic.several
    topic.hear_all(range(2000, 5000))  # the second was killed
    assert topic.numbers()[-1900:] == list(range(3100, 5000))


def test_one_that_now_and_then_sends_is_not_used_while_the_first_starts_again():
    topic = Topic()
    topic.hear_all(range(1, 1000))
    topic.publishers = 3  # with that of the one that was killed
    topic.hear_all(range(100, 105), 1.2, SECOND)
    for k in range(1, 2000):
        topic.hear(k)
        if k % 1200 == 0:
            topic.hear(105, 0.0, SECOND)
    assert not topic.numbers(SECOND)
    assert topic.numbers()[-1990:] == list(range(10, 2000))


def test_when_the_first_has_ended_the_other_is_used():
    topic = Topic()
    topic.hear_all(range(5000, 6000))
    topic.publishers = 2
    topic.hear_all(range(1, 2000), who=SECOND)
    silent = round(SILENCE / PERIOD)
    assert topic.numbers(SECOND) == list(range(silent, 2000)) and not topic.several


def test_the_only_publisher_is_used_however_seldom_it_sends():
    topic = Topic()
    topic.hear_all(range(5000, 6000))
    topic.hear_all(range(1, 9), 1.2)
    assert topic.numbers()[1000:] == list(range(RUN, 9))


def test_of_two_heard_at_the_start_none_is_used_while_they_take_turns():
    topic = Topic()
    topic.publishers = 2
    for k in range(1, 100):
        topic.hear(k)
        topic.hear(5000 + k, who=SECOND)
    assert not topic.used and topic.several
    topic.hear_all(range(100, 200))
    assert topic.numbers() == list(range(100 + RUN - 1, 200))


def test_strangers_are_several_publishers_when_they_come_twice_in_a_second():
    topic = Topic()
    topic.hear_all(range(5000, 6000))
    topic.publishers = 2
    for k in range(5):
        topic.hear(1 + k, who=SECOND)
        topic.hear_all(range(6000 + 1200 * k, 7200 + 1200 * k))
        assert not topic.several
    for k in range(3):
        topic.hear(6 + k, who=SECOND)
        topic.hear_all(range(12_000 + 500 * k, 12_500 + 500 * k))
    assert topic.several and len(topic.numbers()) == 8500
    topic.several = False
    topic.hear_all(range(13_500, 13_500 + round(SETTLED / PERIOD)))
    topic.hear(9, who=SECOND)
    assert not topic.several
