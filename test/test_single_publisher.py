"""A topic of one publisher passes; of two that publish in turn, nothing but the first does."""

import pytest

from parallel_robot_ros.single_publisher import SETTLED, SinglePublisher

PERIOD = 1e-3  # s


def passed(numbers, period=PERIOD):
    """Numbers of the messages that are used."""
    now = 0.0
    publisher = SinglePublisher(lambda: now)
    used = []
    for k, number in enumerate(numbers):
        now = 100.0 + k * period
        if not publisher.mixed(number):
            used.append(number)
    return used


def turns(*streams):
    """Numbers of messages of several publishers, one after the other."""
    return [number for numbers in zip(*streams, strict=True) for number in numbers]


@pytest.mark.parametrize(
    'numbers',
    [
        range(1, 100),
        range(700, 800),  # heard late
        [*range(1, 50), *range(60, 90), *range(91, 200, 2)],  # losses
        [*range(500, 600), *range(1, 100)],  # started again
        [0] * 100,  # a middleware without numbers
    ],
)
def test_one_publisher_passes(numbers):
    assert passed(numbers) == list(numbers)


@pytest.mark.parametrize('burst', [1, 7, 100])
@pytest.mark.parametrize('lead', [0, 1, 7, 5000])
def test_two_publishers_do_not_pass(lead, burst):
    numbers = list(range(lead + 1, lead + 100))
    for first in range(1, 1000, burst):
        numbers += [
            *range(first, first + burst),
            *range(lead + 99 + first, lead + 99 + first + burst),
        ]
    used = passed(numbers)
    assert used == numbers[: len(used)] and len(used) <= 99 + 2 * burst


def test_a_slow_second_publisher_is_not_used_again():
    numbers = list(range(5000, 6000))
    for k in range(9):
        numbers.insert(100 * (k + 1), k + 1)  # 10 Hz beside 1 kHz
    assert [n for n in passed(numbers) if n < 10] == [1]


def test_when_one_of_two_ends_the_other_passes_again():
    together = turns(range(1, 50), range(5100, 5149))
    numbers = [*range(5000, 5100), *together, *range(50, 2000)]
    settled = round(SETTLED / PERIOD)
    assert passed(numbers)[-900:] == numbers[-900:]
    assert len(passed(numbers)) <= len(numbers) - settled


def test_a_publisher_can_be_started_again_every_now_and_then():
    numbers = [*range(1, 1000)] * 3
    assert passed(numbers, SETTLED / 900) == numbers
