"""Many rows of numbers, of which some are read, beside numpy's sorting of all at once."""

from pathlib import Path

import numpy as np
import pytest

from parallel_robot.bags import limits
from parallel_robot.bags.limits import SortedRows
from parallel_robot_model.common.errors import InputError

RANDOM = np.random.default_rng(7)
COUNT = 1000


@pytest.mark.parametrize('most', [None, 1, 37, COUNT - 1, COUNT, 2 * COUNT])
@pytest.mark.parametrize('times', ['rising', 'equal', 'mixed'])
@pytest.mark.parametrize('kind', [np.float64, np.int64])
def test_rows_are_those_that_numpy_sorts(most, times, kind, monkeypatch):
    monkeypatch.setattr(limits, 'HELD', 2000)
    found = RANDOM.integers(0, 300, COUNT) + (1 << 53 if kind is np.int64 else 0.5)
    found = {'rising': np.arange(COUNT) + found[0], 'equal': np.sort(found), 'mixed': found}[times]
    found, rows = found.astype(kind), RANDOM.normal(size=(COUNT, 3))
    kept = SortedRows('the poses')
    for part in np.split(np.arange(COUNT), [0, 10, 11, 500]):
        kept.add(found[part], rows[part])
    wanted = np.argsort(found, kind='stable')
    if most is not None and most < COUNT:
        wanted = wanted[np.linspace(0, COUNT - 1, most).astype(int)]
    assert kept.count == COUNT
    for one, other in zip(kept.evenly(most), (found[wanted], rows[wanted]), strict=True):
        assert one.dtype == other.dtype and np.array_equal(one, other)


def test_rows_for_which_the_disk_has_no_room_cost_one_line(monkeypatch):
    with Path('/dev/full').open('wb+', buffering=0) as full:
        monkeypatch.setattr(limits.tempfile, 'SpooledTemporaryFile', lambda _: full)
        with pytest.raises(InputError, match=r'cannot keep the poses .* TMPDIR'):
            SortedRows('the poses').add(np.arange(3.0), np.zeros((3, 2)))
