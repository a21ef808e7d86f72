"""A process that is forked: a stranger to what its parent holds, and ended as any other."""

import json
import signal
import subprocess
import sys
import textwrap

import pytest
from ros_fixtures import PATIENCE

PARENT = """
import atexit, logging, os, signal, socket, sys, tempfile, threading, time
from parallel_robot_model.processes import child_process

atexit.register(print, 'the parent ends')
logging.basicConfig(format='the parent says %(message)s')
os.environ['OF_PARENT'] = 'kept'
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, lambda *_: print('a handler of the parent'))
held, folder = socket.socket(), tempfile.TemporaryDirectory()
print('said once')
log = tempfile.TemporaryFile()
process = child_process.ForkedProcess('a_name', 'a_node', ['-x', 'y'], log, {'GIVEN': 'new'})
"""
NODE = """
import json, logging, os, signal, sys

def main():
    logging.getLogger().warning('to nobody but the last resort')
    print(json.dumps({
        'argv': sys.argv, 'name': open('/proc/self/comm').read().strip(),
        'leads': os.getsid(0) == os.getpid(), 'stdin': os.readlink('/proc/self/fd/0'),
        'open': sorted(os.listdir('/proc/self/fd'))[:-1],  # the last one is that of the list
        'handlers': [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)],
        'blocked': [*signal.pthread_sigmask(signal.SIG_BLOCK, ())],
        'variables': [os.environ[name] for name in ('OF_PARENT', 'GIVEN')],
    }))
    sys.exit(5)
"""


def parent(tmp_path, node, text):
    """What a program writes that forks a node, by its last lines."""
    (tmp_path / 'a_node.py').write_text(node)
    done = subprocess.run(
        [sys.executable, '-c', PARENT + textwrap.dedent(text)],
        env={'PYTHONPATH': f'{":".join(filter(None, sys.path))}:{tmp_path}'},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert not done.stderr
    return done.stdout.splitlines()


def test_it_has_nothing_of_its_parent_but_what_is_imported(tmp_path):
    first, code, there, warned, told, last = parent(
        tmp_path,
        NODE,
        f"""
        print(process.wait({PATIENCE}), os.path.isdir(folder.name), sep='\\n')
        log.seek(0)
        sys.stdout.write(log.read().decode())
    """,
    )
    assert (first, code, there, last) == ('said once', '5', 'True', 'the parent ends')
    assert warned == 'to nobody but the last resort'
    assert json.loads(told) == {
        'argv': ['a_node', '-x', 'y'],
        'name': 'a_name',
        'leads': True,
        'stdin': '/dev/null',
        'open': ['0', '1', '2'],
        'handlers': [signal.SIG_DFL] * 3,
        'blocked': [],
        'variables': ['kept', 'new'],
    }


@pytest.mark.parametrize(
    ('text', 'code'),
    [
        ('pass', 0),
        ('return 3', 3),
        ('raise SystemExit', 0),
        ("raise SystemExit('a reason')", 1),
        ('raise ValueError', 1),
        ('import os, signal; os.kill(os.getpid(), signal.SIGKILL)', -signal.SIGKILL),
    ],
)
def test_its_exit_code_is_that_of_any_program(text, code, tmp_path):
    _, told, _ = parent(tmp_path, f'def main():\n    {text}\n', f'print(process.wait({PATIENCE}))')
    assert int(told) == code


def test_a_signal_at_its_birth_ends_it(tmp_path):
    """Whatever handler its parent has."""
    lines = parent(
        tmp_path,
        'def main():\n    import os, signal\n    signal.pause()\n',
        """
        process.kill()
        codes = set()
        for k in range(200):
            process = child_process.ForkedProcess('a_name', 'a_node', [], log, {})
            process.send_signal(signal.SIGTERM)
            codes.add(process.wait(100.0))
        print(codes)
        process.send_signal(signal.SIGTERM)  # to none
    """,
    )
    assert lines[1] == str({-int(signal.SIGTERM)})


def test_no_process_with_threads_or_with_code_that_may_have_some_is_forked(tmp_path):
    lines = parent(
        tmp_path,
        'def main(): pass\n',
        """
        print(child_process.can_fork())
        thread = threading.Thread(target=time.sleep, args=(0.5,))
        thread.start()
        print(child_process.can_fork())
        thread.join()
        print(child_process.can_fork())
        for name in ('rclpy', 'parallel_robot_custom_a_law'):
            sys.modules[name] = None
            print(child_process.can_fork())
            del sys.modules[name]
    """,
    )
    assert lines[1:6] == ['True', 'False', 'True', 'False', 'False']
