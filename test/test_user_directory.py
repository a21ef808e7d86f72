"""A directory of the user's own, whatever lies in its place."""

import os
import tempfile

import pytest

from parallel_robot_model.processes.user_directory import user_directories


@pytest.fixture
def places(tmp_path, monkeypatch):
    """Where it would be: in the cache, in the temporary directory."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.setattr(tempfile, 'gettempdir', lambda: str(tmp_path))
    return tmp_path / 'cache' / 'parallel_robot', tmp_path / f'parallel_robot_{os.getuid()}'


def test_they_are_made_for_the_user_alone(places):
    assert tuple(user_directories()) == places
    assert all(place.stat().st_mode & 0o777 == 0o700 for place in places)


def test_a_file_in_its_place_is_left_out(places):
    places[0].parent.mkdir()
    places[0].write_text('mine')
    assert tuple(user_directories()) == places[1:]


@pytest.mark.skipif(os.getuid() != 0, reason='only root gives files away')
@pytest.mark.parametrize('what', ['directory', 'link', 'target'])
def test_what_is_somebody_elses_is_left_out(what, places, tmp_path):
    other = tmp_path / 'other'
    if what == 'directory':
        places[1].mkdir()
        os.chown(places[1], 12345, 12345)
    else:
        other.mkdir()
        places[1].symlink_to(other)
        given = {'link': places[1], 'target': other}[what]
        os.chown(given, 12345, 12345, follow_symlinks=False)
    assert tuple(user_directories()) == places[:1]


@pytest.mark.parametrize(
    ('mode', 'above', 'private'),
    [
        (0o755, 0o755, True),
        (0o777, 0o755, False),
        (0o1777, 0o755, False),
        (0o700, 0o777, False),
        (0o700, 0o1777, True),
        (0o775, 0o755, False),
    ],
)
def test_what_others_may_write_is_left_out(mode, above, private, places):
    places[0].mkdir(parents=True)
    if mode == 0o775 and os.getuid() == 0:
        os.chown(places[0], 0, 12345)
    places[0].chmod(mode)
    places[0].parent.chmod(above)
    assert (places[0] in user_directories()) == private


def test_a_user_without_a_home_has_the_temporary_one(places, monkeypatch):
    monkeypatch.delenv('XDG_CACHE_HOME')
    monkeypatch.setattr(os.path, 'expanduser', lambda path: path)  # no HOME, an unknown uid
    assert tuple(user_directories()) == places[1:]
