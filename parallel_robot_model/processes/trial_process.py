"""Custom code that runs in a separate process first, because it may end it or never return.

Its time is that of the processor: that a machine is slow, or compiles, is no fault of the code.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from parallel_robot_model.common.errors import first_line
from parallel_robot_model.processes.module_process import command, die_with_parent

LIMIT = 1.0  # s, of the processor, within which a function of a law or robot must return
WHOLE = 120  # s, of the processor, for all that a trial does, compiling included
MAX_WAIT = 600.0  # s, for code that waits; twenty times what a trial takes on a busy machine


class Ended(NamedTuple):
    """How a trial has ended.

    Attributes:
        returned: Whether it came to its end.
        result: What it found then, plain data.
        how: What went wrong otherwise, e.g. 'update ends the process with SIGSEGV'.
    """

    returned: bool
    result: Any
    how: str


def run(module: str, task: Mapping[str, Any], **environment: str) -> Ended:
    """Run a trial in a separate process, and end whatever it leaves behind.

    Args:
        module: Module of the suite that calls :func:`serve` when it is run.
        task: What it is given, plain data.
        environment: Variables that it has besides those of this process.
    """
    given = json.dumps([[*map(str, sys.path)], task])
    with tempfile.TemporaryFile('w+') as said:
        process = subprocess.Popen(
            command(module, str(said.fileno()), str(WHOLE), given),
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
        return Ended(True, value, '')
    return Ended(False, None, value if kind == 'raised' else f'{value} {ending(code)}')


def ending(code: int | None) -> str:
    """What an exit code says; None for a process that did not end."""
    if code is None:
        return f'does not return within {MAX_WAIT:g} s'
    if code in (-signal.SIGPROF, -signal.SIGXCPU):
        limit = LIMIT if code == -signal.SIGPROF else WHOLE
        return f'does not return within {limit:g} s of processor time'
    names = {-number: number.name for number in signal.Signals}
    how = names.get(code, f'signal {-code}') if code < 0 else f'code {code}'
    return f'ends the process with {how}'


def serve(trial: Callable[[dict[str, Any]], Any]) -> None:
    """Do what :func:`run` asks of this process, and end it.

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
def step(what: str, limit: float = 0.0) -> Iterator[None]:
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
