"""A topic of one publisher passes; of two that publish in turn, nothing but the first does."""

import pytest

from parallel_robot_interface.single_publisher import ROW, SETTLED, SinglePublisher

PERIOD = 1e-3  # s


def passed(numbers, period=PERIOD):
    """Numbers of the messages that are used."""
    publisher = SinglePublisher()
    return [n for k, n in enumerate(numbers) if not publisher.mixed(n, 100.0 + k * period)]


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


@pytest.mark.parametrize('lead', [0, 1, 7, 5000])
def test_two_publishers_do_not_pass(lead):
    numbers = [*range(lead + 1, lead + 100), *turns(range(1, 300), range(lead + 100, lead + 399))]
    used = passed(numbers)
    assert used[:99] == numbers[:99] and len(used) <= 99 + 3


def test_of_a_slow_second_publisher_only_the_first_message_passes():
    numbers = list(range(5000, 6000))
    for k in range(9):
        numbers.insert(100 * (k + 1), k + 1)  # 10 Hz beside 1 kHz
    used = passed(numbers)
    assert [n for n in used if n < 10] == [1]
    assert len(used) > 1000 - 9 * (ROW + 1)


def test_when_one_of_two_ends_the_other_passes_again():
    numbers = [*range(5000, 5100), *turns(range(1, 50), range(5100, 5149)), *range(50, 150)]
    assert passed(numbers)[-90:] == numbers[-90:]


def test_a_publisher_can_be_started_again_every_now_and_then():
    numbers = [*range(1, 1000)] * 3
    assert passed(numbers, SETTLED / 900) == numbers
