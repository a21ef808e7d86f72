"""Which command answers which state, by the order of the records and their log times alone."""

import numpy as np
import pytest

from parallel_robot.bags.command_states import align
from parallel_robot.bags.message_arrays import Samples

MS = 1_000_000  # ns
COUNT, EACH = 1003, 10  # commands, records in a message


def messages(ends):
    """Messages of records, logged at these times [ms], each with what came since the last one.

    Record k is of state k + 1, whose command is logged at k ms; the last one answers no state.
    """
    stamps = np.append(np.arange(1, COUNT), 0) * MS
    for begin, time in enumerate(ends):
        rows = stamps[EACH * begin :][:EACH]
        numbers = {'data': np.repeat(rows, 3)[np.newaxis]}
        yield Samples((), np.array([int(time * MS)]), np.zeros(1, int), numbers)


@pytest.mark.parametrize('late', [0.0, 1.5])
@pytest.mark.parametrize('lost', [None, 500])
def test_the_last_command_may_be_logged_after_its_record(late, lost):
    """A controller that ends sends zero torque, and its records: one may overtake the other."""
    heard = np.arange(COUNT) * MS
    expected = np.append(np.arange(1, COUNT), 0) * MS
    ends = np.append(np.arange(EACH, COUNT, EACH) - 0.5, COUNT - 0.5 - late)
    sure = np.ones(COUNT, bool)
    if lost:  # the others of its message may be taken for one another
        sure[lost : lost + EACH] = False
        heard, expected, sure = (np.delete(row, lost) for row in (heard, expected, sure))
    found = align(heard, list(messages(ends)))
    assert np.array_equal(found.states[sure], expected[sure])


def test_where_nothing_is_lost_log_times_do_not_matter():
    """A recorder that joins hears records at once, and 320 commands of that time later."""
    heard = np.maximum(np.arange(COUNT), 320) * MS
    ends = np.append(np.arange(EACH, COUNT, EACH) - 0.5, COUNT - 0.5)
    found = align(heard, list(messages(ends)), complete=True)
    assert np.array_equal(found.states, np.append(np.arange(1, COUNT), 0) * MS)
    assert found.lost == found.gaps == 0
    assert align(heard, list(messages(ends))).lost  # else they might be


@pytest.mark.parametrize('stop', [0, 300, 800])
@pytest.mark.parametrize('lost', [0, 40])
def test_a_recorder_that_stood_still_lost_nothing_by_that(stop, lost):
    """All that came while it did has the log time of its end, in one order or another."""
    heard = np.arange(COUNT) * MS
    heard[stop : stop + 150] = (stop + 150) * MS + np.arange(150) * MS // 100
    ends = np.append(np.arange(EACH, COUNT, EACH) - 0.5, COUNT - 0.5)
    late = (ends > stop) & (ends < stop + 150)
    ends[late] = stop + 150 + 0.01 * np.arange(late.sum())  # some before the commands, some after
    states = np.append(np.arange(1, COUNT), 0) * MS
    kept = np.ones(COUNT, bool)
    kept[620 : 620 + lost] = False  # while it ran
    found = align(heard[kept], list(messages(ends)))
    sure = np.abs(np.arange(COUNT) - 620) > lost + 2 * EACH
    assert np.array_equal(found.states[sure[kept]], states[kept & sure])
    assert found.lost == lost
