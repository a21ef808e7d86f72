"""What is written is complete or not there, and never in place of what is there."""

import errno
from pathlib import Path

import pytest

from parallel_robot.bags import output
from parallel_robot_model.common.errors import BagError, InputError

OURS, THEIRS = b'ours', b'theirs'


def grown(path, content):
    with output.growing(path) as stream:
        stream.write(content)


def overtaken(path, content):
    with output.growing(path) as stream:
        stream.write(content)
        path.write_bytes(THEIRS)


def gathered(path, content):
    output.save_directory(path, {'a': content, 'sub/b': content})


def kept(path, content):
    with output.written(path, content):
        pass


WRITERS = {
    'save': output.save,
    'growing': grown,
    'save_directory': gathered,
    'written': kept,
}
THERE = {
    'a file': lambda path: path.write_bytes(THEIRS),
    'a directory': Path.mkdir,
    'a link to nothing': lambda path: path.symlink_to('nowhere'),
}


def tree(place):
    """What is in a place: the bytes of files, where links lead, None of directories."""

    def content(path):
        if path.is_symlink():
            return path.readlink()
        return path.read_bytes() if path.is_file() else None

    return {str(path.relative_to(place)): content(path) for path in place.rglob('*')}


@pytest.fixture(params=[True, False], ids=['links', 'no links'])
def hard_links(request, monkeypatch):
    """A file system with and without hard links."""

    def refuse(*_):
        raise OSError(errno.EPERM, 'Operation not permitted')

    if not request.param:
        monkeypatch.setattr(Path, 'hardlink_to', refuse)


@pytest.mark.usefixtures('hard_links')
@pytest.mark.parametrize('write', WRITERS.values(), ids=WRITERS)
def test_what_is_new_is_there_with_nothing_beside_it(write, tmp_path):
    write(tmp_path / 'out', OURS)
    files = {'out': None, 'out/a': OURS, 'out/sub': None, 'out/sub/b': OURS}
    assert tree(tmp_path) == (files if write is gathered else {'out': OURS})


@pytest.mark.usefixtures('hard_links')
@pytest.mark.parametrize('make', THERE.values(), ids=THERE)
@pytest.mark.parametrize('write', WRITERS.values(), ids=WRITERS)
def test_what_is_there_stays_as_it_is(write, make, tmp_path):
    make(tmp_path / 'out')
    before = tree(tmp_path)
    with pytest.raises(InputError, match=r'cannot write .*/out: File exists'):
        write(tmp_path / 'out', OURS)
    assert tree(tmp_path) == before


@pytest.mark.usefixtures('hard_links')
def test_a_file_that_comes_while_another_grows_stays(tmp_path):
    with pytest.raises(InputError, match='File exists'):
        overtaken(tmp_path / 'out', OURS)
    assert tree(tmp_path) == {'out': THEIRS}


@pytest.mark.parametrize('write', WRITERS.values(), ids=WRITERS)
def test_the_folder_of_what_is_new_is_made(write, tmp_path):
    output.check_new(tmp_path / 'a' / 'b' / 'out', '--out')
    assert tree(tmp_path) == {}
    write(tmp_path / 'a' / 'b' / 'out', OURS)
    assert {'a': None, 'a/b': None}.items() < tree(tmp_path).items()
    (tmp_path / 'file').write_bytes(THEIRS)
    for act in (write, output.check_new):
        with pytest.raises(InputError, match=r'cannot write .*: Not a directory'):
            act(tmp_path / 'file' / 'b' / 'out', OURS)


@pytest.mark.parametrize('folder', ['.', 'a/b'])
@pytest.mark.parametrize('write', [output.growing, lambda path: output.written(path, OURS)])
def test_what_fails_leaves_nothing(write, folder, tmp_path):
    with pytest.raises(KeyboardInterrupt), write(tmp_path / folder / 'out'):
        raise KeyboardInterrupt
    assert tree(tmp_path) == {}


def test_a_folder_in_which_somebody_else_writes_meanwhile_stays(tmp_path):
    with pytest.raises(InputError, match='File exists'):
        overtaken(tmp_path / 'a' / 'b' / 'out', OURS)
    assert tree(tmp_path) == {'a': None, 'a/b': None, 'a/b/out': THEIRS}


def test_what_is_refused_is_named_as_it_was_given(tmp_path):
    with pytest.raises(InputError, match='choose another --json'):
        output.check_new(tmp_path, '--json')
    with pytest.raises(BagError, match=r'choose another recorder\.out'):
        output.check_directory(tmp_path, 'recorder.out')
