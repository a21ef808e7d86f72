"""A file of a user's that ends its process or hangs: one line, in every command."""

import hashlib
import logging
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from custom_law import LAW
from ros_fixtures import until

from parallel_robot.cli.command_line import main
from parallel_robot_model.processes import cache_directory, child_process, custom_module
from parallel_robot_model.processes.node_processes import MODULES, command

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
ROBOT = (ROOT / 'docs' / 'example_robot.py').read_text()
TRAJECTORY = (ROOT / 'docs' / 'example_trajectory.py').read_text()
TEXTS = {'custom_laws': LAW, 'custom_robots': ROBOT, 'custom_trajectories': TRAJECTORY}
SHORT = ['--duration', '0.1']
ENDS = {
    'leaves': ('os._exit(0)', 'its import ends the process with code 0'),
    'fails': ('os._exit(7)', 'its import ends the process with code 7'),
    'killed': ('os.kill(os.getpid(), 9)', 'its import ends the process with SIGKILL'),
    'lies': ('os.write(1, b\'["returned", null]\'); os._exit(0)', 'ends the process with code 0'),
    'exits': ('sys.exit()', 'SystemExit'),
    'interrupts': ('raise KeyboardInterrupt', 'KeyboardInterrupt'),
    'raises': ('class Odd(BaseException): pass\nraise Odd("no")', 'Odd: no'),
    'recursive': ('def f(): f()\nf()', 'RecursionError: maximum recursion depth exceeded'),
    'odd': ('os.kill(os.getpid(), 40)', 'its import ends the process with signal 40'),
    'parses': ('import argparse; sys.argv[:] = [""]; argparse.ArgumentParser().error("no")',
               'SystemExit: 2'),
    'asks': ('input()', 'EOFError'),
}  # fmt: skip


def written(folder, name, first, text=LAW):
    """A file that begins with some lines."""
    file = folder / f'{name}.py'
    file.write_text(f'import os, subprocess, sys, time\n{first}\n{text}')
    return file


def refused(words, capsys):
    """The one line that a command with these words costs."""
    assert main([str(word) for word in words]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1 and len(err) < 300
    return err


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A busy machine may take long, and says so."""
    monkeypatch.setattr(custom_module, 'SLOW', 1e3)


@pytest.mark.parametrize('name', ENDS)
def test_one_that_ends_its_process_costs_one_line(name, tmp_path, capsys):
    first, reason = ENDS[name]
    file = written(tmp_path, name, first)
    line = refused(['compare', 'paper_circle', *SHORT, '--set', f'custom_laws=[{file}]'], capsys)
    assert f'custom_laws: {file}: ' in line and reason in line


BOTH = ('simulate', 'compare', 'run', 'sweep', 'tune', 'show')
WORDS = {
    'sweep': ['robustness', '--runs', '1'],
    'tune': ['s_fotsmc', 'paper_circle', '--trials', '1'],
    'show': ['paper_circle'],
}


@pytest.mark.parametrize('name', BOTH)
def test_in_every_command(name, tmp_path, capsys):
    file = written(tmp_path, 'leaves', 'os._exit(0)')
    out = [] if name in ('compare', 'show') else ['--out', tmp_path / 'out']
    words = WORDS.get(name, ['paper_circle', *SHORT])
    line = refused([name, *words, '--set', f'custom_laws=[{file}]', *out], capsys)
    assert f'custom_laws: {file}: its import ends the process with code 0' in line


@pytest.mark.parametrize(
    ('node', 'key'),
    [
        ('controller', 'custom_laws'),
        ('trajectory', 'custom_robots'),
        ('plant', 'custom_robots'),
        ('trajectory', 'custom_trajectories'),
        ('controller', 'custom_trajectories'),
    ],
)
def test_in_a_node(node, key, launch, domain, tmp_path):
    file = written(tmp_path, 'leaves', 'os._exit(0)', TEXTS[key])
    words = ['--ros-args', '-p', f'{key}:=["{file}"]', '-p', 'robot_model:=leaves']
    words = words if key == 'custom_robots' else words[:3]
    process = launch(MODULES[node], *words)
    assert process.wait() == 2
    (line,) = [line for line in process.stderr.splitlines() if 'so far' not in line]
    assert line == f'parallel_robot: {key}: {file}: its import ends the process with code 0'


def test_of_a_bag(tmp_path, capsys, monkeypatch):
    file = written(tmp_path, 'moody', 'os.environ.get("DEADLY") and os._exit(0)', TRAJECTORY)
    words = ['--set', f'custom_trajectories=[{file}]', '--set', 'trajectory.shape=moody']
    out = str(tmp_path / 'bag')
    assert main(['simulate', 'paper_circle', *SHORT, *words, '--out', out]) == 0
    capsys.readouterr()
    monkeypatch.setenv('DEADLY', '1')
    monkeypatch.setattr(cache_directory, 'marked', lambda _: None)  # as on another machine
    for name in ('replay', 'rerun'):
        monkeypatch.setattr(custom_module, '_loaded', {})
        assert main([name, out, '--trust']) == 2
        *_, line = capsys.readouterr().err.splitlines()
        assert 'moody.py: its import ends the process with code 0' in line


def test_a_robot_too(tmp_path, capsys):
    for first, reason in (ENDS['leaves'], ENDS['exits']):
        file = written(tmp_path, 'machine', first, ROBOT)
        words = ['--set', f'custom_robots=[{file}]', '--set', 'robot_model=machine']
        line = refused(['simulate', 'paper_circle', *words, '--out', tmp_path / 'out'], capsys)
        assert f'custom_robots: {file}: {reason}' in line


@pytest.mark.parametrize(
    ('key', 'what', 'change'),
    [
        ('custom_laws', 'initial_memory', ('(joints):\n', '(joints):\n    os._exit(0)\n')),
        (
            'custom_laws',
            'validate_gains',
            ('@kernel', 'def validate_gains(gains):\n    os._exit(0)\n\n@kernel'),
        ),
        ('custom_robots', 'its Python', ('    return 2\n', '    os._exit(0)\n')),
    ],
)
def test_what_it_has_in_python_is_called_there_too(key, what, change, tmp_path, capsys):
    file = written(tmp_path, 'wrong', '', TEXTS[key].replace(*change))
    words = ['compare', 'paper_circle', *SHORT, '--set', f'{key}=[{file}]']
    assert f'{key}: {file}: {what} ends the process with code 0' in refused(words, capsys)


def test_one_that_exits_later_costs_one_line(tmp_path, capsys):
    change = '(joints):\n', '(joints):\n    sys.exit()\n'
    file = written(tmp_path, 'late', '', LAW.replace(*change))
    words = ['--law', 'late', '--set', f'custom_laws=[{file}]', '--out', tmp_path / 'out']
    line = refused(['simulate', 'paper_circle', *SHORT, *words], capsys)
    assert 'late: initial_memory: SystemExit' in line


def test_one_that_computes_for_ever_is_stopped(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(child_process, 'TOTAL_LIMIT', 1)
    file = written(tmp_path, 'endless', 'while True: pass')
    line = refused(['compare', 'paper_circle', '--set', f'custom_laws=[{file}]'], capsys)
    assert f'{file}: its import does not return within 1 s of processor time' in line


def test_one_that_waits_for_ever_is_named_and_stopped(tmp_path, capsys, monkeypatch, caplog):
    monkeypatch.setattr(child_process, 'MAX_WAIT', 1.0)
    monkeypatch.setattr(custom_module, 'SLOW', 0.1)
    file = written(tmp_path, 'waiting', 'time.sleep(1e4)')
    with caplog.at_level(logging.WARNING, 'parallel_robot'):
        line = refused(['compare', 'paper_circle', '--set', f'custom_laws=[{file}]'], capsys)
    assert caplog.messages == [f'loading {file} has taken 0.1 s so far']
    assert re.search(r'(its import|its trial) does not return within 1 s', line)


def test_what_it_starts_there_is_ended(tmp_path, capsys):
    mark = tmp_path / 'pid'
    start = f'open({str(mark)!r}, "w").write(str(subprocess.Popen(["sleep", "1000"]).pid))'
    file = written(tmp_path, 'busy', f'{start}; os._exit(0)')
    refused(['compare', 'paper_circle', '--set', f'custom_laws=[{file}]'], capsys)
    stat = Path('/proc', mark.read_text(), 'stat')
    until(lambda: not stat.exists() or stat.read_text().rpartition(')')[2].split()[0] == 'Z')


def test_one_that_forks_makes_no_second_command(tmp_path):
    file = written(tmp_path, 'forking', 'os.fork()\nprint("loaded")')
    words = ['compare', 'paper_circle', *SHORT, '--set', f'custom_laws=[{file}]', '--laws', 'pid']
    environment = {**os.environ, 'PYTHONUNBUFFERED': '1'}  # the copy ends without a flush
    done = subprocess.run(
        command('parallel_robot', *words), env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0 and done.stdout.count(' pid ') == 1
    assert done.stdout.count('loaded') == 2  # its own doing: once in each copy


def test_it_is_imported_as_here(tmp_path, monkeypatch, capsys):
    """With the import path of this process, and once for its source."""
    (tmp_path / 'helpers').mkdir()
    (tmp_path / 'helpers' / 'my_helper.py').write_text('FACTOR = 1.0\n')
    monkeypatch.syspath_prepend(str(tmp_path / 'helpers'))
    file = written(tmp_path, 'helped', 'from my_helper import FACTOR')
    words = ['compare', 'paper_circle', *SHORT, '--set', f'custom_laws=[{file}]', '--laws', 'pid']
    assert main(words) == 0
    monkeypatch.setattr(child_process, 'run_trial', None)
    monkeypatch.setattr(custom_module, '_loaded', {})
    words[-3] = f'custom_laws=[{shutil.copy(file, tmp_path / "again.py")}]'
    assert main(words) == 0


def test_copies_share_machine_code_unless_they_look_where_they_lie(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'modules', sys.modules.copy())
    texts = {'law': LAW, 'data': f'here = __file__\n{LAW}'}

    def name(folder, stem, text):
        (tmp_path / folder).mkdir(exist_ok=True)
        return custom_module.import_file(tmp_path / folder / f'{stem}.py', text.encode()).__name__

    assert name('a', 'law', texts['law']) == name('b', 'law', texts['law'])
    assert name('a', 'data', texts['data']) != name('b', 'data', texts['data'])
    assert name('a', 'law', texts['law']) != name('a', 'law', texts['law'] + '\n')
    assert name('a', 'law', texts['law']) != name('a', 'wal', texts['law'])


def test_what_a_file_imports_of_the_users_own_is_a_part_of_it(tmp_path, monkeypatch):
    """Else machine code would be that of the file as it was with another helper."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / 'tools').mkdir()
    (tmp_path / 'tools' / '__init__.py').write_text('from tools.deep import FACTOR\n')
    (tmp_path / 'helper_of_law.py').write_text('import numpy\nfrom tools import FACTOR\n')
    source = b'import os\nimport numpy as np\nfrom helper_of_law import FACTOR\n'
    file, names = tmp_path / 'law.py', []
    for factor in (1, 1, 2):
        (tmp_path / 'tools' / 'deep.py').write_text(f'FACTOR = {factor}.0\n')
        for name in ('tools', 'tools.deep', 'helper_of_law'):
            sys.modules.pop(name, None)
        names.append(custom_module.import_file(file, source).__name__)
    assert names[0] == names[1] != names[2]
    (tmp_path / 'tools' / 'deep.py').write_text('FACTOR = 3.0\n')  # it is imported as it was
    assert custom_module.import_file(file, source).__name__ == names[2]
    plain = custom_module.import_file(file, b'import os\nimport numpy\n').__name__
    digest = hashlib.sha256(b'import os\nimport numpy\n').hexdigest()
    assert plain.endswith(digest[:16])  # as before: what is installed does not count
