"""What a machine lacks, or a variable of its environment says, costs one line or nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from parallel_robot.cli import command_line
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.processes import realtime

ROOT = Path(__file__).parents[1]


@pytest.fixture
def plain(monkeypatch):
    for name in (realtime.DISCOVERY_RANGE, realtime.LOCALHOST_ONLY):
        monkeypatch.setenv(name, '')
        monkeypatch.delenv(name)
    return monkeypatch


def test_nodes_are_heard_on_this_machine_unless_told(plain):
    realtime.prepare_discovery()
    assert os.environ[realtime.DISCOVERY_RANGE] == 'LOCALHOST'
    plain.setenv(realtime.DISCOVERY_RANGE, 'SUBNET')
    realtime.prepare_discovery()
    assert os.environ[realtime.DISCOVERY_RANGE] == 'SUBNET'


def test_nodes_that_would_hear_nobody_are_not_started(plain):
    plain.setenv(realtime.DISCOVERY_RANGE, 'OFF')
    with pytest.raises(InputError, match='DISCOVERY_RANGE is OFF'):
        realtime.prepare_discovery()
    plain.setenv(realtime.LOCALHOST_ONLY, '1')  # it wins
    realtime.prepare_discovery()


def test_a_machine_without_its_own_interface(plain):
    assert not realtime._is_up('none')
    plain.setattr(realtime, '_is_up', lambda name: name != 'lo')
    with pytest.raises(InputError, match='lo is missing or down'):
        realtime.prepare_discovery()
    plain.setenv(realtime.DISCOVERY_RANGE, 'SUBNET')
    realtime.prepare_discovery()


def started(words, shell, **environment):
    """Run the command line with redirections of a shell."""
    command = [sys.executable, '-m', 'parallel_robot', *map(str, words)]
    return subprocess.run(
        ['/bin/sh', '-c', f'"$@" {shell}', 'sh', *command],
        env={**os.environ, **environment},
        cwd=ROOT,
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize('shell', ['<&- >&- 2>&-', '2>&-'])
def test_a_command_works_without_the_standard_streams(shell, tmp_path):
    out = tmp_path / 'robot.urdf'
    done = started(['urdf', 'paper_circle', '--out', out], shell)
    assert done.returncode == 0 and done.stderr == ''
    assert done.stdout == ('' if '>&- ' in shell else f'urdf    {out}, 7 links\n')
    assert out.read_text().endswith('</robot>\n')


def test_an_output_that_is_full_costs_one_line():
    done = started(['urdf', 'paper_circle'], '>/dev/full')
    assert done.returncode == 1
    assert done.stderr == ('parallel_robot urdf: the output is full: No space left on device\n')


def test_settings_of_libraries_do_not_count_where_they_would_end_a_command(tmp_path):
    words = ['show', 'paper_circle', '--plot', tmp_path / 'motion.png']
    done = started(words, '', MPLBACKEND='nonsense', NUMBA_NUM_THREADS='0')
    assert done.returncode == 0 and (tmp_path / 'motion.png').exists()
    assert done.stderr == "NUMBA_NUM_THREADS must be at least 1, not '0': it is left out\n"


def test_a_library_of_another_python_is_named(capsys, monkeypatch, tmp_path):
    (tmp_path / 'foreign.py').write_text("raise ImportError('made for\\nanother Python')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(command_line, 'module_of', lambda _: __import__('foreign'))
    assert command_line.main(['verify']) == 1
    out, err = capsys.readouterr()
    assert out == '' and err == (
        f'parallel_robot verify: ImportError: made for ({tmp_path}/foreign.py); '
        'is PYTHONPATH right?\n'
    )
