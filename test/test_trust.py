"""Code that a bag holds runs when its user says so, and never else."""

import hashlib
import io
import shutil
import sys

import pytest
from custom_law import LAW

from parallel_robot_cli.command_line import main

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


@pytest.mark.parametrize('command', ['analyze', 'report', 'export', 'recover'])
def test_other_commands_run_no_code(command, recorded, bag, capsys):
    law = recorded / 'law' / 'mine.py'
    law.parent.mkdir(exist_ok=True)
    law.write_text(LAW + MARK)
    out = {'report': 'report.html', 'export': 'table.csv', 'recover': 'recovered'}.get(command)
    words = ['--out', str(bag.with_name(out))] if out else []
    main([command, str(bag), *words])
    assert not law.with_name('ran').exists() and 'runs the code' not in capsys.readouterr().err
