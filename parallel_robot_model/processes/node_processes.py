"""Node processes: started together, watched, stopped in order, never left behind."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

from parallel_robot_model.common.errors import RunError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.yaml_file import MARK
from parallel_robot_model.processes import child_process
from parallel_robot_model.processes.cache_directory import NOTICE
from parallel_robot_model.processes.child_process import ForkedProcess, command, die_with_parent
from parallel_robot_model.processes.user_directory import CACHE, open_private, user_directories

MODULES = {
    'trajectory': 'trajectory_gen.trajectory_node',
    'plant': 'parallel_robot_sim.plant_node',
    'controller': 'parallel_robot_control.controller_node',
    'recorder': 'parallel_robot.bags.writing.recorder_node',
}
# The plant ends first, at a state; what the others still publish is recorded.
STOP_ORDER = (('plant', 'controller', 'trajectory'), ('recorder',))
WATCH = 'watch'  # end of the name of a node's logger for what is odd
WARNING_LINE = re.compile(rf'^\[WARN\] \[[\d.]+\] \[[\w.]+\.{WATCH}\]: (.*)$', re.MULTILINE)
MAX_VALUE_LENGTH = 100_000  # characters of a value on a command line, of which Linux takes 131 071
END_TIMEOUT = 30.0  # s, from SIGINT to SIGKILL


class Work(NamedTuple):
    """What a process has done."""

    ran: float  # processor time that it has used [s]
    waited: float  # time in which it could have run, but others had the processors [s]


Process = subprocess.Popen[Any] | ForkedProcess


class NodeProcesses:
    """The processes of one run; use as a context manager.

    They are forked from this one where that is possible, and else start an interpreter.
    """

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]], namespace: str = '') -> None:
        """Prepare to start the nodes named by the keys, each with its parameters.

        Args:
            parameters: Name of each node to its parameters.
            namespace: Full name of the namespace of all of them; empty for none.
        """
        self._parameters = parameters
        self._remapped = ['-r', f'__ns:={namespace}'] if namespace else []
        self._processes: dict[str, Process] = {}
        self._logs: dict[str, IO[bytes]] = {}
        self._directory = tempfile.TemporaryDirectory()  # of values too long for a command line

    def __enter__(self) -> NodeProcesses:
        """Start all processes."""
        try:
            for name, parameters in self._parameters.items():
                self._logs[name] = tempfile.TemporaryFile()
                words = ['--ros-args', *self._remapped]
                long = []
                for key, value in parameters.items():
                    text = as_yaml(value)
                    if len(text) > MAX_VALUE_LENGTH:
                        long.append(f'    {key}: {text}')
                    elif value != []:  # rcl has no type for it
                        words += ['-p', f'{key}:={text}']
                if long:
                    file = Path(self._directory.name, f'{name}.yaml')
                    file.write_text('\n'.join(['/**:', f'  {MARK}:', *long]))
                    words += ['--params-file', str(file)]
                self._processes[name] = _start(name, words, self._logs[name])
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop all processes."""
        self.stop()
        for log in self._logs.values():
            log.close()
        self._directory.cleanup()

    def running(self, name: str) -> bool:
        """Whether a process still runs."""
        return self._processes[name].poll() is None

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a process, if it still runs."""
        self._processes[name].send_signal(number)

    def compiling(self, name: str) -> bool:
        """Whether a node has logged that it compiles."""
        return NOTICE in self._output(name)

    def work(self, name: str) -> Work:
        """What a node has done so far; nothing when it has ended."""
        try:
            return work(self._processes[name].pid)
        except OSError:
            return Work(0.0, 0.0)

    def check(self) -> None:
        """Check that all processes run; only the recorder may have ended, without an error.

        Raises:
            RunError: one has ended; with its reason. If several have, it names the one that was
                killed: the others may have ended because of it.
        """
        codes = {name: process.poll() for name, process in self._processes.items()}
        if codes.get('recorder') == 0:
            del codes['recorder']
        ended = [(code, name) for name, code in codes.items() if code is not None]
        if ended:
            code, name = min(ended)
            how = f'signal {signal.Signals(-code).name}' if code < 0 else f'exit code {code}'
            reason = self._last_line(name)
            raise RunError(f'{name} ended with {how}' + (f': {reason}' if reason else ''))

    def warnings(self) -> list[str]:
        """What the nodes have warned of that concerns who started them, each once."""
        files = [
            f'{name}: {text}'
            for name in self._logs
            for text in WARNING_LINE.findall(self._output(name))
        ]
        return list(dict.fromkeys(files))

    def stop(self) -> None:
        """End all processes that still run, in order, waiting for them."""
        for names in STOP_ORDER:
            processes = [self._processes[name] for name in names if name in self._processes]
            end(processes, signal.SIGINT, signal.SIGCONT)  # even those that were stopped

    def _output(self, name: str) -> str:
        """All that a node has written."""
        log = self._logs[name].fileno()
        # Not by a seek: the node writes on at the offset, which it shares.
        return os.pread(log, os.fstat(log).st_size, 0).decode(errors='replace')

    def _last_line(self, name: str) -> str:
        lines = [line.strip() for line in self._output(name).splitlines()]
        fatal = [line for line in lines if line.startswith('[FATAL]')]
        last = next((line for line in reversed(fatal or lines) if line), '')
        return re.sub(r'^\[\w+\] \[[\d.]+\] \[[\w.]+\]: ', '', last)  # level, time and node


def _start(name: str, arguments: list[str], log: IO[bytes]) -> Process:
    """Start a node in a session of its own, which ends with this process."""
    environment = {'AMENT_PREFIX_PATH': sys.prefix, **os.environ}
    if child_process.can_fork():
        return ForkedProcess(name, MODULES[name], arguments, log, environment)
    return subprocess.Popen(
        command(MODULES[name], *arguments),
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=subprocess.STDOUT,
        env=environment,
        start_new_session=True,
        preexec_fn=die_with_parent,
    )


def end(processes: Collection[Process], *signals: int, timeout: float = END_TIMEOUT) -> None:
    """Send signals to those processes that still run, wait for all, kill what does not end."""
    for process in processes:
        for number in signals:
            process.send_signal(number)  # to none that has ended
    for process in processes:
        try:
            process.wait(timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def process_status(pid: int) -> list[str]:
    """Fields of /proc/PID/stat after the name of the process: state, parent, ...

    Raises:
        OSError: it has ended.
    """
    return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()


def processor_seconds(pid: int) -> float:
    """Processor time of a process [s], user and system.

    Raises:
        OSError: it has ended.
    """
    fields = process_status(pid)
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def work(pid: int) -> Work:
    """What a process has done.

    Raises:
        OSError: it has ended.
    """
    waited = 0
    for task in Path(f'/proc/{pid}/task').iterdir():
        with contextlib.suppress(OSError):  # it has just ended, or the kernel does not say
            waited += int((task / 'schedstat').read_text().split()[1])
    return Work(processor_seconds(pid), waited / NANOSECONDS)


@contextlib.contextmanager
def domain_lock(namespace: str = '') -> Iterator[None]:
    """Keep other runs of this machine off a namespace of the ROS domain.

    Args:
        namespace: Its full name; empty for none.

    Raises:
        RunError: another run has it.
    """
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    space = namespace.replace('/', '.')  # which no name of ROS has in it
    with open_private(f'domain_{domain}{space}.lock', user_directories(), CACHE) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RunError(
                f'another run uses {f"namespace {namespace} of " if namespace else ""}ROS domain '
                f'{domain}; set ROS_DOMAIN_ID to another number or choose another --namespace'
            ) from None
        yield


def as_yaml(value: Any) -> str:
    """A value as YAML for ``-p key:=value``: lists of one type, floats with a decimal point."""
    if isinstance(value, (list, tuple)):
        mixed = any(isinstance(item, float) for item in value)
        items = [float(item) if mixed and type(item) is int else item for item in value]
        return '[' + ', '.join(map(as_yaml, items)) + ']'
    if isinstance(value, float):
        text = repr(value)
        return text if any(mark in text for mark in '.ni') else text.replace('e', '.0e')
    return json.dumps(value, ensure_ascii=False)
