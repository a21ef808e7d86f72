"""Child processes: modules of the suite, forked ones, and trials of custom code."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import inspect
import json
import logging
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import IO, Any, NamedTuple

from parallel_robot_model.common.errors import first_line
from parallel_robot_model.processes.cache_directory import PREFIX
from parallel_robot_model.processes.termination_signals import termination_signals

# Modules of the suite in separate processes: their command lines, and their end.

# Linux prctl: signal to this process when its parent dies; its name
PR_SET_PDEATHSIG, PR_SET_NAME = 1, 15

# As ``python -m``, but without the current directory first on the path, so that nothing in it is
# imported. The folder of the code of this process goes there, unless it is on the path anyway.
START = (
    'import sys; sys.path[:1] = [entry for entry in sys.path[:1] if entry]; '
    'root = sys.argv.pop(1); root in sys.path or sys.path.insert(0, root); '
    "import runpy; runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)


def command(module: str, *words: str) -> list[str]:
    """Command line that runs a module of the suite, the same code as here, from anywhere."""
    root = Path(__file__).parents[2]  # as on the path, not resolved
    return [sys.executable, '-c', START, str(root), module, *words]


def die_with_parent() -> None:
    """Let this process end with its parent; for ``preexec_fn`` of a child."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def set_name(name: str) -> None:
    """Name this process, as `ps -e` shows it; 15 letters at most."""
    ctypes.CDLL(None).prctl(PR_SET_NAME, name.encode())


# A process forked from this one: what is imported here costs it nothing.
#
# Only a process without other threads may be forked: the copy lacks them, and waits for ever where
# one of them held a lock. The import of rclpy starts some, of its tracing; that of a custom module
# may start any.

PAUSE = 0.01  # s, between two looks whether it has ended


def can_fork() -> bool:
    """Whether this process can be forked."""
    strange = any(name == 'rclpy' or name.startswith(PREFIX) for name in sys.modules)
    return not strange and threading.active_count() == 1


class ForkedProcess:
    """A module of the suite in a process of its own; what is used of `subprocess.Popen`."""

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        output: IO[bytes],
        environment: Mapping[str, str],
    ) -> None:
        """Fork it.

        Args:
            name: Its name, as `ps -e` shows it.
            module: The module, whose ``main`` it runs.
            arguments: Its arguments.
            output: File of what it writes.
            environment: Variables that it has besides those of this process.
        """
        # exit code, or minus the number of the signal that ended it; None while it runs
        self.returncode: int | None = None
        inspect.stack()  # looks at all modules once: the first line of a node's log does so, too
        for stream in (sys.stdout, sys.stderr):
            stream.flush()  # else both would write what waits
        # None is lost in between.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, termination_signals())
        try:
            self.pid = os.fork()  # its number
            if not self.pid:

                def run() -> object:
                    _detach(name, output.fileno(), before)
                    os.environ.update(environment)
                    sys.argv = [module, *arguments]
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


def _detach(name: str, output: int, mask: set[int]) -> None:
    """Become what a process is that was started: nothing of the parent's stays in use."""
    gc.freeze()  # what the parent holds is not closed here by the way
    os.setsid()
    die_with_parent()
    set_name(name)
    for number in termination_signals():
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


# Custom code that runs in a separate process first, because it may end it or never return.
#
# Its time is that of the processor: that a machine is slow, or compiles, is no fault of the code.

CALL_LIMIT = 1.0  # s, of the processor, within which a function of a law or robot must return
TOTAL_LIMIT = 120  # s, of the processor, for all that a trial does, compiling included
MAX_WAIT = 600.0  # s, for code that waits; twenty times what a trial takes on a busy machine


class TrialResult(NamedTuple):
    """How a trial has ended."""

    returned: bool  # whether it came to its end
    result: Any  # what it found then, plain data
    how: str  # what went wrong otherwise, e.g. 'update ends the process with SIGSEGV'


def run_trial(module: str, task: Mapping[str, Any], **environment: str) -> TrialResult:
    """Run a trial in a separate process, and end whatever it leaves behind.

    Args:
        module: Module of the suite that calls :func:`serve_trial` when it is run.
        task: What it is given, plain data.
        environment: Variables that it has besides those of this process.
    """
    given = json.dumps([[*map(str, sys.path)], task])
    with tempfile.TemporaryFile('w+') as said:
        process = subprocess.Popen(
            command(module, str(said.fileno()), str(TOTAL_LIMIT), given),
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,  # what the code reads and writes is not for the user
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(said.fileno(),),
            start_new_session=True,
            preexec_fn=die_with_parent,
        )
        try:
            process.wait(MAX_WAIT)
        except subprocess.TimeoutExpired:
            pass
        finally:
            code = process.poll()
            with contextlib.suppress(ProcessLookupError):  # nothing is left
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        said.seek(0)
        lines = [json.loads(line) for line in said]
    kind, value = lines[-1] if lines else ('step', 'its trial')
    if kind == 'returned':
        return TrialResult(True, value, '')
    return TrialResult(False, None, value if kind == 'raised' else f'{value} {exit_reason(code)}')


def exit_reason(code: int | None) -> str:
    """What an exit code says; None for a process that did not end."""
    if code is None:
        return f'does not return within {MAX_WAIT:g} s'
    if code in (-signal.SIGPROF, -signal.SIGXCPU):
        limit = CALL_LIMIT if code == -signal.SIGPROF else TOTAL_LIMIT
        return f'does not return within {limit:g} s of processor time'
    names = {-number: number.name for number in signal.Signals}
    how = names.get(code, f'signal {-code}') if code < 0 else f'code {code}'
    return f'ends the process with {how}'


def serve_trial(trial: Callable[[dict[str, Any]], Any]) -> None:
    """Do what :func:`run_trial` asks of this process, and end it.

    Args:
        trial: Function of the task; what it returns is plain data.
    """
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    whole = int(sys.argv[2])
    resource.setrlimit(resource.RLIMIT_CPU, (whole, whole + 1))
    _channels.append(int(sys.argv[1]))
    os.set_inheritable(_channels[0], False)
    path, task = json.loads(sys.argv[3])
    sys.path[:] = path  # so that the code imports what it would there
    try:
        _say('returned', trial(task))
    except BaseException as error:  # custom code may raise anything
        _say('raised', first_line(error))
    os._exit(0)  # whatever threads the code has started


@contextlib.contextmanager
def trial_step(what: str, limit: float = 0.0) -> Iterator[None]:
    """Say what is done within the context, and end this process if it takes too long.

    Nothing but a signal can stop compiled code.

    Args:
        what: Function of the custom code, for messages.
        limit: Processor time that it may take [s]; 0: that of the whole trial.
    """
    _say('step', what)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


_channels: list[int] = []  # the file descriptor that serve() answers to


def _say(kind: str, value: Any) -> None:
    os.write(_channels[0], json.dumps([kind, value]).encode() + b'\n')
