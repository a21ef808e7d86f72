"""Arrays that grow, in memory and in files: they are those that were added."""

import errno
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from parallel_robot.bags import columns
from parallel_robot.bags.columns import Columns, MotionColumns, blocks
from parallel_robot_model.common.errors import InputError
from parallel_robot_sim.motions import Motion, Motions, Poses


@pytest.fixture
def on_disk(monkeypatch, tmp_path):
    """All arrays are in files of a directory."""
    monkeypatch.setattr(columns, 'SMALL', 0)
    monkeypatch.setattr(columns, 'disk_directory', lambda: tmp_path)
    return tmp_path


@pytest.mark.parametrize('small', [0, 100, 1 << 20])
def test_parts_are_put_together(small, monkeypatch):
    monkeypatch.setattr(columns, 'SMALL', small)
    chance, found, added = np.random.default_rng(4), Columns('it'), []
    for rows in (7, 0, 30, 1):
        part = {
            'time': chance.normal(size=rows),
            'rows': chance.normal(size=(3, rows)).T,  # not in the order of memory
            'stamps': chance.integers(0, 9, rows),
            'nothing': np.zeros((rows, 0)),
        }
        found.add(part)
        added.append(part)
    for name, array in found.arrays().items():
        whole = np.concatenate([part[name] for part in added])
        assert array.dtype == whole.dtype and array.shape == whole.shape
        np.testing.assert_array_equal(array, whole)


def test_files_have_no_names_and_may_be_written_into(on_disk):
    found = Columns('it')
    found.add({'values': np.array([3.0, 1.0, 2.0])})
    values = found.arrays()['values']
    values.sort()
    assert isinstance(values, np.memmap) and [*values] == [1.0, 2.0, 3.0]
    assert not [*on_disk.iterdir()]  # nothing that a kill could leave


def test_a_disk_that_is_full_is_one_line(on_disk, monkeypatch):
    def full(**_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(columns.tempfile, 'TemporaryFile', lambda *_, **__: full())
    with pytest.raises(
        InputError, match=r'^cannot keep the motion in .*: No space left on device'
    ):
        Columns('the motion').add({'time': np.zeros(3)})


def test_a_directory_in_memory_is_no_disk(monkeypatch, tmp_path):
    mounts = tmp_path / 'mounts'
    mounts.write_text(f'/dev/sda / ext4 rw 0 0\ntmpfs {tmp_path} tmpfs rw 0 0\n')
    monkeypatch.setattr(columns, 'MOUNTS', mounts)
    disk, memory = tmp_path.parent, tmp_path / 'cache'
    memory.mkdir()
    monkeypatch.setattr(columns, 'user_directories', lambda: iter([memory, disk]))
    assert columns.disk_directory() == disk
    monkeypatch.setattr(columns, 'user_directories', lambda: iter([disk, memory]))
    assert columns.disk_directory() == disk


@given(st.integers(0, 50), st.integers(0, 50), st.integers(1, 60))
def test_blocks_follow_each_other(begin, stop, size):
    before, columns.BLOCK = columns.BLOCK, size
    try:
        rows = [*blocks(begin, stop)]
    finally:
        columns.BLOCK = before
    assert [k for each in rows for k in range(each.start, each.stop)] == [*range(begin, stop)]
    assert all(each.stop - each.start <= size for each in rows)


def test_motions_are_those_of_all_parts(on_disk):
    time = 1e-3 * np.arange(20)
    angles = np.random.default_rng(1).normal(size=(20, 3))
    true = Motion(time, angles, 2.0 * angles, 3.0 * angles, Poses(4.0 * angles, 5.0 * angles))
    whole = Motions(true, true._replace(position=-angles), 6.0 * angles)
    found = MotionColumns()
    for begin in range(0, 20, 6):
        found.add(whole.between(time[begin], time[min(begin + 6, 19)] + (begin > 13)))
    motions = found.motions()
    for one, other in ((motions.true, whole.true), (motions.seen, whole.seen)):
        assert one.poses[2:] == other.poses[2:]
        arrays = ((*each[:4], *each.poses[:2]) for each in (one, other))
        for array, expected in zip(*arrays, strict=True):
            np.testing.assert_array_equal(array, expected)
    np.testing.assert_array_equal(motions.ideal, whole.ideal)
    found.add(Motions(true, None, None))  # without ideal torque and what is seen from here on
    assert found.motions().ideal is None and found.motions().seen is None
