"""Numba's settings come from the environment, never from the current directory."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from parallel_robot_model.processes.child_process import command

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(
    path.parent.name for path in ROOT.glob('*/__init__.py') if path.parent.name != 'test'
)
SHORT = ('--duration', '0.5', '--laws', 'pid')
SETTINGS = """
import numba
import parallel_robot_model.compiler
numba.njit(lambda x: 2.0 * x)(1.0)  # Numba looks for new settings before it compiles
found = numba.config
print(found.DEBUG, found.DISABLE_JIT, repr(found.CACHE_DIR), int(found.OPT))
"""


@pytest.fixture
def trap(tmp_path):
    """A directory whose file of settings makes every command fail."""
    folder = tmp_path / 'trap'
    folder.mkdir()
    (folder / '.numba_config.yaml').write_text(
        'debug: 1\ndisable_jit: 1\nboundscheck: 1\nopt: 0\ncache_dir: machine_code\n'
    )
    return folder


def started(words, folder, **more):
    return subprocess.run(
        words,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        env={**os.environ, 'PYTHONPATH': str(ROOT), **more},
        capture_output=True,
        text=True,
    )


def test_every_package_sees_to_it_before_it_imports_numba(tmp_path):
    code = f"""
import sys
for package in {PACKAGES}:
    __import__(package)
    assert 'numba' not in sys.modules
    del sys.modules['parallel_robot_model']
sys.meta_path.insert(0, type('Watch', (), {{'find_spec': staticmethod(lambda name, *_: (
    name == 'numba' and print('parallel_robot_model' in sys.modules)) or None)}}))
import parallel_robot_model.compiler
"""
    assert len(PACKAGES) == 5
    done = started([sys.executable, '-c', code], tmp_path)
    assert (done.stdout, done.stderr) == ('True\n', '')


@pytest.mark.parametrize('before', ['', 'import numba'])
def test_no_file_of_the_current_directory_is_read(before, trap):
    code = f'{before}\nimport parallel_robot_sim{SETTINGS}'
    assert started([sys.executable, '-c', code], trap).stdout == "0 0 '' 3\n"
    assert [path.name for path in trap.iterdir()] == ['.numba_config.yaml']


def test_the_environment_counts(trap, tmp_path):
    more = {'NUMBA_OPT': '1', 'NUMBA_CACHE_DIR': str(tmp_path / 'code')}
    done = started([sys.executable, '-c', SETTINGS], trap, **more)
    assert done.stdout == f'0 0 {str(tmp_path / "code")!r} 1\n'


NODES = """
from parallel_robot_model.common.errors import InputError
from parallel_robot_control.configuration import resolve
from parallel_robot_control.controller import Controller
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.plant_run import Simulator
whole = configure(resolve('paper_circle'))
for kind, part in ((Controller, whole), (Simulator, whole)):
    try:
        kind(part)
    except InputError as error:
        print(error)
"""


def test_nodes_do_not_start_without_the_compiler(tmp_path):
    done = started([sys.executable, '-c', NODES], tmp_path, NUMBA_DISABLE_JIT='1')
    assert done.stdout == 2 * 'NUMBA_DISABLE_JIT is set; unset it: nodes need the compiler\n'


@pytest.mark.parametrize(
    'words',
    [
        ('parallel_robot', 'show', 'paper_circle'),
        ('parallel_robot', 'compare', 'paper_line', *SHORT),
        ('parallel_robot_control.controller_node', '--ros-args', '-p', 'no_such_key:=1'),
        ('parallel_robot.studies.sweep.workers', '0'),
    ],
)
def test_no_process_of_the_suite_reads_it(words, trap):
    done = started(command(*words), trap)
    code = 2 if 'controller_node' in words[0] else 0
    assert done.returncode == code and 'Traceback' not in done.stderr
    assert len(done.stderr.splitlines()) == (code > 0)
    assert [path.name for path in trap.iterdir()] == ['.numba_config.yaml']
