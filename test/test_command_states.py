"""Which command answers which state, by the order of the records and their log times alone."""

import numpy as np
import pytest

from parallel_robot_bags.command_states import align
from parallel_robot_bags.message_arrays import Samples

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
