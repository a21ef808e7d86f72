"""Node processes: what they are told, and what is told of their end."""

import os
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest
from rclpy.context import Context
from rclpy.node import Node
from ros_fixtures import PATIENCE, until

from parallel_robot_model.common.errors import RunError
from parallel_robot_model.processes import child_process
from parallel_robot_model.processes import node_processes as processes
from parallel_robot_model.processes.user_directory import user_directories

pytest_plugins = ['ros_fixtures']  # for `until`

SCRIPTS = {
    'fails': "import sys; print('the reason', file=sys.stderr); sys.exit(3)",
    'ends': 'pass',
    'dies': 'import os, signal; os.kill(os.getpid(), signal.SIGKILL)',
    'reports': """
import sys
from rclpy.logging import get_logger
get_logger('recorder').fatal('cannot write bag: No space left on device')
for topic in ('joint_states', 'reference'):
    get_logger('recorder').info(f'{topic}: received 1, written 1, lost 0')
sys.exit(1)
""",
}
TEXTS = {
    'fails': 'node ended with exit code 3: the reason',
    'ends': 'node ended with exit code 0',
    'dies': 'node ended with signal SIGKILL',
    'reports': 'node ended with exit code 1: cannot write bag: No space left on device',
}


@pytest.fixture(params=['forked', 'fresh'])
def node(request, tmp_path, monkeypatch):
    """Make a node of a script; it is forked, or has an interpreter of its own."""
    monkeypatch.setattr(child_process, 'can_fork', lambda: request.param == 'forked')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    monkeypatch.syspath_prepend(tmp_path)

    def make(text, name='node'):
        lines = textwrap.indent(text, '    ')
        (tmp_path / f'a_{name}.py').write_text(
            f"def main():\n{lines}\n\nif __name__ == '__main__':\n    main()\n"
        )
        monkeypatch.setitem(processes.MODULES, name, f'a_{name}')
        monkeypatch.setattr(processes, 'STOP_ORDER', (tuple(processes.MODULES),))

    return make


@pytest.mark.parametrize('name', SCRIPTS)
def test_the_end_of_a_node_is_reported_with_its_reason(name, node):
    node(SCRIPTS[name])
    with processes.NodeProcesses({'node': {}}) as running:
        running._processes['node'].wait(PATIENCE)
        with pytest.raises(RunError) as caught:
            running.check()
    assert str(caught.value) == TEXTS[name]


def test_of_several_that_ended_the_one_that_was_killed_is_named(node):
    for name in ('fails', 'dies', 'ends'):
        node(SCRIPTS[name], name)
    with processes.NodeProcesses({'fails': {}, 'ends': {}, 'dies': {}}) as running:
        for process in running._processes.values():
            process.wait(PATIENCE)
        with pytest.raises(RunError, match=r'^dies ended with signal SIGKILL$'):
            running.check()


def test_a_node_that_was_stopped_ends_all_the_same(node):
    node(
        'import os, signal, sys\n'
        'signal.signal(signal.SIGINT, lambda *_: sys.exit(7))\n'
        'os.kill(os.getpid(), signal.SIGSTOP)\n'
        'signal.pause()'
    )
    with processes.NodeProcesses({'node': {}}) as running:
        process = running._processes['node']
        state = Path(f'/proc/{process.pid}/stat')
        until(lambda: state.read_text().rpartition(')')[2].split()[0] == 'T')
    assert process.returncode == 7  # not killed


def test_a_node_that_compiles_is_known_and_goes_on_with_its_log(node, tmp_path):
    node(f"""
import pathlib, sys, time
print({processes.NOTICE!r}, flush=True)
while not pathlib.Path({str(tmp_path / 'go')!r}).exists():
    time.sleep(0.01)
print('as long as the notice, so that it would hide it if it were written over it: ' + 50 * '.')
sys.exit(3)
""")
    with processes.NodeProcesses({'node': {}}) as running:
        until(lambda: running.compiling('node'))
        done = running.work('node')
        assert 0.0 <= done.ran < 60.0 and done.waited >= 0.0
        (tmp_path / 'go').write_text('')
        running._processes['node'].wait(PATIENCE)
        assert running.compiling('node')
        with pytest.raises(RunError, match='exit code 3: as long as the notice'):
            running.check()
        assert running.work('node') == (0.0, 0.0)  # it has ended


def test_time_in_which_a_node_has_no_processor_is_known():
    """Two processes on one processor, so that each waits for the other."""
    core = min(os.sched_getaffinity(0))
    code = f'import os; os.sched_setaffinity(0, [{core}]); print(flush=True)\nwhile True: pass'
    pair = [
        subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE) for _ in range(2)
    ]
    try:
        for process in pair:
            process.stdout.readline()
        before = processes.work(pair[0].pid)
        until(lambda: processes.work(pair[0].pid).waited - before.waited > 0.2)
        until(lambda: processes.work(pair[0].pid).ran > before.ran)
    finally:
        for process in pair:
            process.kill()
            process.communicate()


@pytest.mark.parametrize(
    'value',
    [
        True, 7, 10.0, 1e-9, 1e22, 'text', 'a "b" \\ c\'', '', 'ä', 'yes', '1.0',
        [1.0, 2.5], [0, 0.5, 0.5], [1, 2], ['a', 'b "c"'],
    ],
    ids=repr,
)  # fmt: skip
def test_a_node_gets_the_value_it_is_sent(value):
    assert received(['--ros-args', '-p', f'key:={processes.as_yaml(value)}'], 'key') == value


def test_a_value_that_is_too_long_for_a_command_line_is_sent_in_a_file(tmp_path, monkeypatch):
    (tmp_path / 'idle.py').write_text('import signal; signal.pause()')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    monkeypatch.setitem(processes.MODULES, 'node', 'idle')
    monkeypatch.setattr(processes, 'STOP_ORDER', (('node',),))
    many = [k / 7.0 for k in range(20_000)]
    assert len(processes.as_yaml(many)) > 131_071
    with processes.NodeProcesses({'node': {'few': 1.5, 'many': many}}) as running:
        words = running._processes['node'].args
        words = words[words.index('--ros-args') :]
        assert (received(words, 'few'), received(words, 'many')) == (1.5, many)
    assert not Path(words[-1]).exists()


def received(words, key):
    """Value of a parameter of a node that is started with some words."""
    context = Context()
    context.init(words)
    node = Node(
        'reader', context=context, automatically_declare_parameters_from_overrides=True,
        start_parameter_services=False, enable_rosout=False,
    )  # fmt: skip
    try:
        found = node.get_parameter(key).value
        return found if isinstance(found, (str, bool, int, float)) else list(found)
    finally:
        node.destroy_node()
        context.try_shutdown()


TRAPS = {
    'fifo': os.mkfifo,
    'link': lambda path: path.symlink_to(path.with_name('precious')),
    'directory': Path.mkdir,
}


@pytest.mark.parametrize('trap', TRAPS)
def test_a_lock_is_a_file_of_ones_own_or_none(trap, tmp_path, monkeypatch):
    """What lies in its place neither holds a run up nor is written to; there is another place."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.setattr(tempfile, 'gettempdir', lambda: str(tmp_path / 'temporary'))
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    first, second = (place / 'domain_42.lock' for place in user_directories())
    TRAPS[trap](first)
    with processes.domain_lock():
        assert second.is_file() and not first.with_name('precious').exists()
        with pytest.raises(RunError, match='another run uses ROS domain 42'):
            processes.domain_lock().__enter__()
    second.unlink()
    TRAPS[trap](second)
    with pytest.raises(RunError, match=r'domain_42\.lock'):
        processes.domain_lock().__enter__()
