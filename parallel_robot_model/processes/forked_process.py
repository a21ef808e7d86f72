"""A process forked from this one: what is imported here costs it nothing.

Only a process without other threads may be forked: the copy lacks them, and waits for ever where
one of them held a lock. The import of rclpy starts some, of its tracing; that of a custom module
may start any.
"""

from __future__ import annotations

import contextlib
import gc
import inspect
import logging
import math
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import IO

from parallel_robot_model.processes.cache_directory import PREFIX
from parallel_robot_model.processes.ending_signals import ending_signals
from parallel_robot_model.processes.module_process import die_with_parent, set_name

PAUSE = 0.01  # s, between two looks whether it has ended


def possible() -> bool:
    """Whether this process can be forked."""
    strange = any(name == 'rclpy' or name.startswith(PREFIX) for name in sys.modules)
    return not strange and threading.active_count() == 1


class ForkedProcess:
    """A module of the suite in a process of its own; what is used of `subprocess.Popen`.

    Attributes:
        pid: Its number.
        returncode: Exit code, or minus the number of the signal that ended it; None while it runs.
    """

    def __init__(
        self,
        name: str,
        module: str,
        words: Sequence[str],
        output: IO[bytes],
        environment: Mapping[str, str],
    ) -> None:
        """Fork it.

        Args:
            name: Its name, as `ps -e` shows it.
            module: The module, whose ``main`` it runs.
            words: Its arguments.
            output: File of what it writes.
            environment: Variables that it has besides those of this process.
        """
        self.returncode: int | None = None
        inspect.stack()  # looks at all modules once: the first line of a node's log does so, too
        for stream in (sys.stdout, sys.stderr):
            stream.flush()  # else both would write what waits
        # None is lost in between.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ending_signals())
        try:
            self.pid = os.fork()
            if not self.pid:

                def run() -> object:
                    _settle(name, output.fileno(), before)
                    os.environ.update(environment)
                    sys.argv = [module, *words]
                    return import_module(module).main()

                _live(run)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def poll(self) -> int | None:
        """Exit code; None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float = math.inf) -> int:
        """Wait for its end.

        Raises:
            subprocess.TimeoutExpired: it still runs after this time [s].
        """
        deadline = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(PAUSE)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it."""
        self.send_signal(signal.SIGKILL)


def _settle(name: str, output: int, mask: set[int]) -> None:
    """Become what a process is that was started: nothing of the parent's stays in use."""
    gc.freeze()  # what the parent holds is not closed here by the way
    os.setsid()
    die_with_parent()
    set_name(name)
    for number in ending_signals():
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for descriptor in (1, 2):
        os.dup2(output, descriptor)
    for descriptor in map(int, os.listdir('/proc/self/fd')):
        if descriptor > 2:
            with contextlib.suppress(OSError):  # that of the list is closed already
                os.close(descriptor)
    sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
    logging.getLogger().handlers.clear()


def _live(run: Callable[[], object]) -> None:
    """Run something to the end of this process, which never returns to what the parent does."""
    code: object = 1
    try:
        code = run()
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(code if isinstance(code, int) else code is not None)
