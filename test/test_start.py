"""The start: installed code wherever one stands, and nothing compiled after `make setup`."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from parallel_robot_model.processes import cache_directory
from parallel_robot_model.processes.node_processes import command

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
HOSTILE = (  # what the suite imports early or late, itself or for Numba and rclpy
    *('numba', 'numpy', 'scipy', 'yaml', 'rclpy', 'mcap', 'rosbags', 'llvmlite', 'zstandard'),
    *('runpy', 'inspect', 'json', 'argparse', 'signal', 'logging', 'queue', 'statistics'),
    *(
        'trajectory_gen',
        'parallel_robot_model',
        'parallel_robot',
    ),
    *('controller', 'simulator', 'messages'),
)
CONSOLE_SCRIPT = (
    f'#!{sys.executable}\nimport sys; from parallel_robot.__main__ import main; sys.exit(main())\n'
)


@pytest.fixture
def hostile(tmp_path):
    """A directory, a clone as it seems, in which nothing may be imported."""
    folder = tmp_path / 'clone'
    for package in ('parallel_robot_sim', 'parallel_robot_control'):
        (folder / package).mkdir(parents=True)
    trap = f'open({str(tmp_path / "imported")!r}, "a").write(__name__)\n'
    for path in (*HOSTILE, 'parallel_robot_sim/__init__', 'parallel_robot_control/__init__'):
        (folder / f'{path}.py').write_text(trap)
    (folder / '.numba_config.yaml').write_text('disable_jit: 1\ndebug: 1\ncache_dir: .\n')
    return folder


def console_script(prefix):
    """The command line as pip installs it."""
    script = prefix / 'bin' / 'parallel_robot'
    script.parent.mkdir()
    script.write_text(CONSOLE_SCRIPT)
    script.chmod(0o755)
    return script


def environment(**more):
    """As of a user who has not started Python before."""
    inherited = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
    return {**inherited, 'PYTHONPATH': str(ROOT), **more}


@pytest.mark.endurance
def test_a_run_after_the_setup_compiles_nothing_and_imports_nothing_from_where_it_is_started(
    hostile, compiled, domain, tmp_path
):
    """With a cache of its own: other tests compile meanwhile."""
    cache = tmp_path / 'cache' / 'parallel_robot'
    ours = Path(cache_directory.OWN)
    shutil.copytree(ours, cache / ours.name, ignore=shutil.ignore_patterns('*.tmp.*'))
    script = console_script(tmp_path)

    def start(*words):
        done = subprocess.run(
            [sys.executable, *words],
            cwd=hostile,
            env=environment(XDG_CACHE_HOME=str(tmp_path / 'cache')),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert done.returncode == 0, done.stderr

    def code():
        return {path for path in cache.rglob('*.nb*') if path.is_file()}

    def forget():
        for path in code():
            os.utime(path, (1.0, 1.0))

    def loaded():
        return {path for path in code() if path.suffix == '.nbc' and path.stat().st_atime > 1.0}

    motion = ('paper_circle', '--duration', '0.05', '--out')
    forget()
    makefile = (ROOT / 'Makefile').read_text().replace('\\\n', '')
    start(script, 'simulate', *motion, tmp_path / 'simulated')
    start(script, 'analyze', tmp_path / 'simulated')
    parts = re.findall(r'^(?:WARM|WARM_CONTROLLER|WARM_OTHERS) := (.*)$', makefile, re.MULTILINE)
    assert len(parts) == 3
    subprocess.run(
        [sys.executable, '-c', '; '.join(part.rstrip('; ') for part in parts)],
        cwd=tmp_path,
        env=environment(XDG_CACHE_HOME=str(tmp_path / 'cache')),
        check=True,
    )
    before, warmed = code(), loaded()
    made = sum(path.suffix == '.nbc' for path in before)
    assert made > 0.8 * cache_directory.ALL
    forget()
    start(script, 'run', *motion, tmp_path / 'bag', '--time-mode', 'lockstep')
    start(script, 'analyze', tmp_path / 'bag')
    assert code() == before
    if warmed:  # else the file system keeps no times of access
        assert loaded() <= warmed
        assert len(warmed) < 1.2 * cache_directory.ALL  # else progress ends too early
    assert not (tmp_path / 'imported').exists()


@pytest.mark.parametrize(
    'name',
    [
        pytest.param(name, marks=[pytest.mark.endurance] if name != 'controller' else [])
        for name in sorted(path.name for path in (ROOT / 'scripts').iterdir())
    ],  # test_packaging.py: they are the same text
)
def test_a_script_imports_nothing_from_where_it_is_started(name, hostile, domain, tmp_path):
    words = ('--ros-args', '-p', 'no_such_parameter:=1')
    console_script(tmp_path)
    folder = tmp_path / 'lib' / 'parallel_robot'
    folder.mkdir(parents=True)
    done = subprocess.run(
        [shutil.copy(ROOT / 'scripts' / name, folder), *words],
        cwd=hostile,
        env=environment(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2, done.stderr  # as it refuses what it is told, all is imported
    assert not (tmp_path / 'imported').exists()


@pytest.mark.parametrize('version', ['3.10', '3.11', '3.12', '3.13'])
def test_every_python_starts_a_module_without_the_current_directory(version, hostile, tmp_path):
    python = shutil.which(f'python{version}')
    if python is None or subprocess.run([python, '-V'], capture_output=True).returncode:
        pytest.skip(f'no Python {version} here')
    package = tmp_path / 'path' / 'a_package'
    package.mkdir(parents=True)
    (package / 'a_node.py').write_text(
        'import json, sys; print(json.dumps([__name__, sys.argv[1:], sys.path]))\n'
    )
    _, *words = command('a_package.a_node', '-m', 'x')
    done = subprocess.run(
        [python, *words],
        cwd=hostile,
        env={**environment(), 'PYTHONPATH': str(package.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    name, arguments, path = json.loads(done.stdout)
    assert name == '__main__' and arguments == ['-m', 'x']
    assert path[:2] == [str(ROOT), str(package.parent)]  # the code that starts it, what is asked
    assert not {'', '.', str(hostile)} & set(path)
    assert not (tmp_path / 'imported').exists()
