"""Trials of custom code that are forked from warm parents: they cost a tenth of a start.

A parent is an interpreter in the environment of its trials. It has imported their modules, and has
compiled once, so that the compiler is ready. The tests of the start itself do without.
"""

import array
import functools
import importlib
import json
import os
import select
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from parallel_robot_model.processes import cache_directory, child_process
from parallel_robot_model.processes.child_process import START, die_with_parent

ROOT = Path(__file__).parents[1]
SETTINGS = ('NUMBA_BOUNDSCHECK', 'NUMBA_CACHE_DIR')  # of a parent, which Numba reads once
MODULES = (
    'parallel_robot_model.processes.custom_module',
    'parallel_robot_control.law_trial',
    'parallel_robot_model.robots.registry',
    'trajectory_gen.shape_trial',
)
MOST = 200_000  # bytes of a request


@pytest.fixture(scope='module')
def warm_trials():
    """Let this process fork its trials instead of starting an interpreter for each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child_process, 'subprocess', SimpleNamespace(**vars(subprocess)))
        patch.setattr(child_process.subprocess, 'Popen', _popen)
        yield


def _popen(words, env, pass_fds, **others):
    """Fork a trial, unless its parent would serve it alone: then start it."""
    settings = tuple(env.get(name, '') for name in SETTINGS)
    if settings[1] not in ('', cache_directory.subdirectory('checked')):
        return subprocess.Popen(words, env=env, pass_fds=pass_fds, **others)
    return WarmTrial(_parent(settings), words[words.index(START) + 2 :], env, pass_fds)


class WarmTrial:
    """A trial that was forked; what `child_process` uses of `subprocess.Popen`."""

    def __init__(self, parent, words, environment, descriptors):
        self._answers, theirs = socket.socketpair()
        with theirs:
            request = json.dumps([words, environment, os.getcwd()]).encode()
            given = array.array('i', [theirs.fileno(), *descriptors])
            rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, given)]
            assert parent.sendmsg([request], rights) == len(request) < MOST
        self._lines = self._answers.makefile()
        self.pid = int(next(self._lines))
        self._code = None

    def poll(self):
        """Exit code; None while it runs."""
        if self._code is None and select.select([self._answers], [], [], 0.0)[0]:
            self.wait()
        return self._code

    def wait(self, seconds=None):
        """Wait for the end; returns the exit code."""
        if self._code is None:
            if not select.select([self._answers], [], [], seconds)[0]:
                raise subprocess.TimeoutExpired('trial', seconds)
            self._code = int(next(self._lines))
            self._lines.close()
            self._answers.close()
        return self._code


@functools.cache
def _parent(settings):
    """Socket to the parent with these settings; it ends when the socket is closed."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    chosen = {name: value for name, value in zip(SETTINGS, settings, strict=True) if value}
    path = os.pathsep.join([str(ROOT), str(ROOT / 'test')])
    with theirs:
        subprocess.Popen(
            [sys.executable, __file__, str(theirs.fileno())],
            env={**os.environ, 'PYTHONPATH': path, **chosen},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(),),
            start_new_session=True,
        )
    return ours


def serve(requests):
    """Fork what is asked for, one after the other: its answers are its pid and how it ended."""
    while True:
        request, rights, *_ = requests.recvmsg(MOST, socket.CMSG_SPACE(8))
        if not request:
            return
        answers, descriptor = array.array('i', rights[0][2])
        pid = os.fork()
        if not pid:
            os.close(answers)
            requests.close()
            _be_trial(descriptor, *json.loads(request))
        os.close(descriptor)
        with socket.socket(fileno=answers) as channel:
            channel.sendall(f'{pid}\n'.encode())
            code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
            channel.sendall(f'{code}\n'.encode())


def _be_trial(descriptor, words, environment, folder):
    """Be the trial that was started with these words, its second the descriptor."""
    try:
        os.setsid()
        die_with_parent()
        silence = os.open(os.devnull, os.O_RDWR)
        for number in range(3):
            os.dup2(silence, number)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        sys.argv = [words[0], str(descriptor), *words[2:]]
        child_process.serve_trial(importlib.import_module(words[0])._trial)
    finally:
        os._exit(1)


def _warm():
    """Import what trials import; where code is run, try a law, so that the compiler is ready."""
    from custom_law import LAW

    for name in MODULES:
        importlib.import_module(name)
    if SETTINGS[0] not in os.environ:
        return
    with tempfile.TemporaryDirectory() as folder, open(os.devnull, 'wb') as silence:
        file = Path(folder, 'law.py')
        file.write_text(LAW)
        child_process._channels.append(silence.fileno())
        task = {'file': str(file), 'gains': [1.0, 1.0, 1.0], 'joints': 3}
        importlib.import_module('parallel_robot_control.law_trial')._trial(task)
        child_process._channels.clear()


if __name__ == '__main__':
    _warm()
    serve(socket.socket(fileno=int(sys.argv[1])))
