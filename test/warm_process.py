"""A process forked from the warm parent, used as one of `subprocess`."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
from multiprocessing import forkserver
from pathlib import Path

from parallel_robot_model.processes.node_processes import MODULES


class WarmProcess:
    """A module of the suite in a process of its own; what is used of `subprocess.Popen`."""

    def __init__(self, module, words, folder, environment, files):
        """Start it.

        Args:
            module: Its name.
            words: Its arguments.
            folder: Its current directory.
            environment: Its environment.
            files: Paths of the files for its output and for its errors.
        """
        import warm_parent

        context = multiprocessing.get_context('forkserver')
        context.set_forkserver_preload(['warm_parent'])
        with _path():
            forkserver.ensure_running()
        given = (module, words, folder, environment, files)
        self._process = context.Process(target=warm_parent.run, args=given, daemon=True)
        self._process.start()
        self.pid = self._process.pid

    def poll(self):
        """Exit code; None while it runs."""
        return self._process.exitcode

    def wait(self, seconds=None):
        """Wait for the end; returns the exit code."""
        self._process.join(seconds)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired('process', seconds)
        return self._process.exitcode

    def send_signal(self, number):
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # it has just ended
                os.kill(self.pid, number)

    def kill(self):
        """Kill it."""
        self.send_signal(signal.SIGKILL)


@contextlib.contextmanager
def _path():
    """Let the fork server, an interpreter of its own, import what this one can."""
    before = os.environ.get('PYTHONPATH')
    os.environ['PYTHONPATH'] = os.pathsep.join(entry for entry in sys.path if entry)
    try:
        yield
    finally:
        del os.environ['PYTHONPATH']
        if before is not None:
            os.environ['PYTHONPATH'] = before


def children(pid):
    """Nodes that a process has forked: module to pid."""
    found = {}
    with contextlib.suppress(OSError):  # it has ended
        for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split():
            with contextlib.suppress(OSError):
                name = Path(f'/proc/{child}/comm').read_text().strip()
                if name in MODULES:
                    found[MODULES[name]] = int(child)
    return found
