"""Code that a bag holds runs when its user says so, and never else."""

import hashlib
import io
import os
import shutil
import sys

import pytest
from custom_law import LAW
from mcap.writer import Writer

from parallel_robot.bags import bag_reader, trust
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.processes import custom_module

DIGEST = hashlib.sha256(LAW.encode()).hexdigest()
MARK = '\nimport pathlib\npathlib.Path(__file__).with_name("ran").touch()\n'


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """A directory with a bag that holds a law of one's own; the file of the law is gone."""
    directory = tmp_path_factory.mktemp('recorded')
    law = directory / 'law' / 'mine.py'
    law.parent.mkdir()
    law.write_text(LAW)
    words = ['--duration', '0.02', '--set', f'custom_laws=[{law}]', '--law', 'mine']
    assert main(['simulate', 'paper_circle', *words, '--out', str(directory / 'bag')]) == 0
    shutil.rmtree(law.parent)
    return directory


@pytest.fixture
def bag(recorded, tmp_path, monkeypatch, capsys):
    """The bag, alone in a directory that takes the temporary files, too."""
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'config'))
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path))
    monkeypatch.setattr(sys, 'stdin', io.StringIO())
    shutil.copytree(recorded / 'bag', tmp_path / 'bag')
    capsys.readouterr()
    return tmp_path / 'bag'


@pytest.mark.parametrize('command', ['replay', 'rerun'])
def test_it_is_refused_in_one_line(command, bag, capsys):
    assert main([command, str(bag)]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1
    assert f'{bag} holds the code of the law mine, which would run' in err and '--trust' in err
    assert sorted(path.name for path in bag.parent.iterdir()) == ['bag']


@pytest.mark.parametrize('command', ['replay', 'rerun'])
def test_it_runs_when_the_user_says_so_or_has_noted_it(command, bag, capsys):
    out = ['--out', str(bag.with_name('again'))] if command == 'rerun' else []
    assert main([command, str(bag), '--trust', *out]) == 0
    out, err = capsys.readouterr()
    assert 'identical' in out and 'runs the code of mine, which the bag holds' in err


def test_a_law_whose_digest_is_noted_runs(bag, capsys):
    noted = bag.parent / 'config' / 'parallel_robot' / 'trusted_laws'
    noted.parent.mkdir(parents=True)
    noted.write_text(f'\n{"0" * 64} other.py\n{DIGEST}  mine')
    assert main(['replay', str(bag)]) == 0
    noted.write_text('0' * 64)
    assert main(['replay', str(bag)]) == 2


@pytest.mark.parametrize(('answer', 'code'), [('y\n', 0), ('yes\n', 0), ('\n', 2), ('', 2)])
def test_a_terminal_shows_it_and_asks(answer, code, bag, capsys, monkeypatch):
    answers = io.StringIO(answer)
    answers.isatty = lambda: True
    monkeypatch.setattr(sys, 'stdin', answers)
    monkeypatch.setattr(sys.stderr, 'isatty', lambda: True)
    assert main(['replay', str(bag), '--trust']) == code
    err = capsys.readouterr().err
    assert 'gains.Kp * e' in err and DIGEST in err


def test_a_law_of_the_suite_needs_no_code_of_the_bag(bag, capsys):
    assert main(['replay', str(bag), '--law', 'pid']) == 0
    assert 'runs the code' not in capsys.readouterr().err


@pytest.mark.parametrize('command', ['replay', 'rerun'])
def test_a_file_that_a_bag_only_names_is_not_loaded(command, recorded, bag, capsys):
    """Here, of a law that the bag does not hold, in the place where its configuration says."""
    law = recorded / 'law' / 'mine.py'
    law.parent.mkdir(exist_ok=True)
    law.write_text(LAW + MARK)
    (file,) = bag.glob('*.mcap')
    data = file.read_bytes()
    file.write_bytes(data.replace(b'custom_laws/mine', b'custom_lawz/mine'))
    assert data != file.read_bytes()
    assert main([command, str(bag)]) == 2
    assert 'does not hold the law mine' in capsys.readouterr().err
    assert not law.with_name('ran').exists()


@pytest.mark.usefixtures('page_alone')
@pytest.mark.parametrize('command', ['analyze', 'report', 'export', 'recover'])
def test_other_commands_run_no_code(command, recorded, bag, capsys):
    law = recorded / 'law' / 'mine.py'
    law.parent.mkdir(exist_ok=True)
    law.write_text(LAW + MARK)
    out = {'report': 'report.html', 'export': 'table.csv', 'recover': 'recovered'}.get(command)
    words = ['--out', str(bag.with_name(out))] if out else []
    main([command, str(bag), *words])
    assert not law.with_name('ran').exists() and 'runs the code' not in capsys.readouterr().err


CONFIG = {'robot_model': '', 'trajectory.shape': ''}


def allowed(source, directory):
    """The file that code of a bag is written to, after --trust."""
    sources = {'custom_laws': {'mine': source}}
    return trust.custom_files(directory / 'bag', sources, CONFIG, directory, True)['custom_laws']


@pytest.mark.parametrize(
    ('source', 'why'),
    [
        (b'# -*- coding: utf-7 -*-\n#+AAo-x = 1', 'encoding utf-7'),
        (b'\r# coding: latin-1\rx = "\xc3\xa9"', 'encoding iso-8859-1'),
        (b'\xef\xbb\xbf# coding: cp1252\n', 'no Python'),
        (b'# coding: rot13\n', 'encoding rot13'),
        ('x = 1'.encode('utf-16'), 'not UTF-8: byte 0'),
        (b'x = "\xed\xa0\x80"', 'not UTF-8: byte 5'),
        (b'x = 1\0\nimport os', 'no Python'),
        (b'(' * 5000, 'no Python'),
    ],
)
def test_what_cannot_be_shown_is_refused(source, why, tmp_path):
    with pytest.raises(BagError, match=why):
        allowed(source, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    'hidden',
    '\t\f\x0b\x1b\x7f\x85\xa0\xad\u034f\u115f\u200b\u202e\u2028\u2066\u2800\u3164\ufe0f\uff45\U000e0041',
)
def test_a_character_that_hides_is_an_escape(hidden):
    (line,) = trust.code_lines(f'x = 1  # {hidden}y')
    assert line.isascii() and line.isprintable() and '# \\' in line


def test_what_is_shown_names_one_code_alone():
    assert list(trust.code_lines('x = "\'"  # p\u0430ss')) == ['    1 | x = "\'"  # p\\u0430ss']
    assert list(trust.code_lines('# p\\u0430ss')) == ['    1 | # p\\\\u0430ss']


def test_a_long_line_goes_on_in_the_next_and_a_lone_carriage_return_ends_one(monkeypatch):
    monkeypatch.setenv('COLUMNS', '100')
    code = 'x = 1 ' + 5000 * ' ' + '; last()'
    shown = list(trust.code_lines(f'# quiet\rhidden()\r\n{code}'))
    assert shown[:2] == ['    1 | # quiet', '    2 | hidden()']
    assert ''.join(line[8:] for line in shown[2:]) == code
    assert shown[2].startswith('    3 | x') and shown[3].startswith('      + ')
    assert max(map(len, shown)) == 100


def test_the_bytes_that_were_shown_run(tmp_path):
    (file,) = allowed(b'"""A law."""\nVALUE = 1\n', tmp_path)
    with open(file, 'w') as stream:
        stream.write('VALUE = 2')
    with pytest.raises(custom_module.InputError, match='has changed since it was read'):
        custom_module.load(file, 'custom_laws', ['VALUE'], [], custom_module.first_line)


@pytest.mark.parametrize('line', ['import beside', 'def f():\n    from beside.more import x'])
@pytest.mark.parametrize('kind', ['module', 'package', 'folder'])
def test_a_module_beside_the_bag_is_not_imported(line, kind, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}:/other')
    place = tmp_path / ('beside.py' if kind == 'module' else 'beside')
    if kind == 'module':
        place.touch()
    else:
        place.mkdir()
    if kind == 'package':
        (place / '__init__.py').touch()
    with pytest.raises(BagError, match=f'mine.py imports beside from {tmp_path}/beside'):
        allowed(line.encode(), tmp_path)
    allowed(b'import math, numpy, parallel_robot_model', tmp_path)
    assert str(tmp_path) not in sys.path and os.environ['PYTHONPATH'] == '/other'


def test_of_two_files_of_one_name_none_is_used(tmp_path):
    for texts, left in (['a', 'a'], {'mine': b'a'}), (['a', 'b', 'a'], {}):
        bag = tmp_path / 'bag.mcap'
        with bag.open('wb') as stream:
            writer = Writer(stream)
            writer.start()
            for text in texts:
                writer.add_attachment(0, 0, 'custom_laws/mine', 'text/x-python', text.encode())
            writer.finish()
        found = bag_reader.read(bag, [], lambda topic, messages: None)
        assert found.sources['custom_laws'] == left
        assert len(found.warnings) == (not left)
