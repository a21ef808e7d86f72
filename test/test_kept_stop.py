"""A kept emergency stop is found again, under its own name, and nobody else's file is."""

import os
import tempfile
import time
from pathlib import Path

import pytest

from parallel_robot_model.processes.user_directory import StopRecord


@pytest.fixture
def places(tmp_path, monkeypatch):
    """Where it can be kept: in the user's state, in the temporary directory."""
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / 'state'))
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    monkeypatch.setattr(tempfile, 'gettempdir', lambda: str(tmp_path))
    return tmp_path / 'state' / 'parallel_robot', tmp_path / f'parallel_robot_{os.getuid()}'


def test_it_is_kept_until_it_is_forgotten(places):
    stop = StopRecord('/arm/controller')
    assert stop.stopped_at() is None and not stop.forget()
    before = time.time()
    assert not stop.save()
    (kept,) = places[0].iterdir()
    assert kept.name == 'stopped_7.arm.controller' and kept.stat().st_mode & 0o777 == 0o600
    assert before - 1.0 <= StopRecord('/arm/controller').stopped_at() <= time.time() + 1.0
    os.utime(kept, (1e9, 1e9))
    assert stop.stopped_at() == 1e9
    assert not stop.save() and stop.stopped_at() > 1e9  # told again
    assert not StopRecord('/arm/controller').forget() and stop.stopped_at() is None


def test_each_node_of_each_domain_has_its_own(places, monkeypatch):
    StopRecord('/controller').save()
    assert StopRecord('/arm/controller').stopped_at() is None
    assert StopRecord('/other').stopped_at() is None
    monkeypatch.setenv('ROS_DOMAIN_ID', '8')
    assert StopRecord('/controller').stopped_at() is None
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    assert StopRecord('/controller').stopped_at()


def test_it_is_kept_elsewhere_where_there_is_no_place(places):
    places[0].parent.mkdir()
    places[0].write_text('')  # a file in place of the directory
    stop = StopRecord('/controller')
    assert not stop.save() and stop.stopped_at()
    assert [path.name for path in places[1].iterdir()] == ['stopped_7.controller']


def test_it_is_told_when_it_cannot_be_kept(places):
    for place in places:
        place.parent.mkdir(exist_ok=True)
        place.write_text('')
    assert StopRecord('/controller').save() == (
        'no directory of your own for stopped_7.controller; set XDG_STATE_HOME to one'
    )


TRAPS = {
    'fifo': os.mkfifo,
    'link': lambda path: path.symlink_to(path.parents[2] / 'target'),
    'directory': Path.mkdir,
}


@pytest.mark.parametrize('what', TRAPS)
def test_what_is_no_file_is_neither_followed_nor_touched(what, places, tmp_path):
    for place in places:
        place.mkdir(parents=True)
        path, target = place / 'stopped_7.controller', tmp_path / 'target'
        target.write_text('mine')
        os.utime(target, (1e9, 1e9))
        TRAPS[what](path)
    stop = StopRecord('/controller')
    assert 'stopped_7.controller' in stop.save()
    assert stop.stopped_at() is None and not stop.forget()
    assert path.lstat() and target.stat().st_mtime == 1e9


@pytest.mark.skipif(os.getuid() != 0, reason='only root gives files away')
def test_a_file_of_another_user_stops_nobody(places):
    stop = StopRecord('/controller')
    stop.save()
    (kept,) = places[0].iterdir()
    os.chown(kept, 12345, 12345)
    assert stop.stopped_at() is None and not stop.forget() and kept.exists()
    assert not stop.save() and stop.stopped_at()  # in the other place
