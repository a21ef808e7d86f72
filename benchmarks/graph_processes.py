"""Processes of a graph: started, found, their processor time, ended; and a busy machine."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from checkout import ROOT

from parallel_robot_analysis.processes import MODULES

TICKS = os.sysconf('SC_CLK_TCK')
GRACE = 60.0  # s, for a process to end by itself
PR_SET_PDEATHSIG = 1  # Linux prctl: signal to this process when its parent dies


def start(words: Sequence[str], **options: Any) -> subprocess.Popen[str]:
    """Start Python with some words, in the checkout; it ends with this process."""
    return subprocess.Popen(
        [sys.executable, *words],
        cwd=ROOT,
        text=True,
        preexec_fn=_die_with_parent,
        **options,
    )


def end(processes: Sequence[subprocess.Popen[str]], number: int = signal.SIGINT) -> None:
    """Send a signal to processes that still run, and wait for all; kill what does not end."""
    for process in processes:
        process.send_signal(number)
    for process in processes:
        try:
            process.wait(GRACE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def nodes_below(parent: int) -> dict[str, int]:
    """Process of each node of the suite among the descendants of a process, by node name."""
    children: dict[int, list[int]] = {}
    for path in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):
            children.setdefault(int(_stat(int(path.name))[1]), []).append(int(path.name))
    found = {}
    waiting = children.get(parent, [])
    while waiting:
        pid = waiting.pop()
        waiting += children.get(pid, [])
        with contextlib.suppress(OSError):
            words = Path(f'/proc/{pid}/cmdline').read_bytes().decode().split('\0')
            found |= {name: pid for name in MODULES if _runs(words, name)}
    return found


def processor_seconds(pid: int) -> float:
    """Processor time of a process, user and system.

    Raises:
        OSError: it has ended.
    """
    fields = _stat(pid)
    return (int(fields[11]) + int(fields[12])) / TICKS


def machine_seconds() -> float:
    """Processor time of everything on the machine, stolen by its host included."""
    fields = [int(word) for word in Path('/proc/stat').read_text().split('\n', 1)[0].split()[1:9]]
    return (sum(fields) - fields[3] - fields[4]) / TICKS  # without idle and waiting for disks


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep every core busy with some processes of normal priority that do nothing else."""
    loops = [
        start(['-S', '-c', 'while True: pass'])
        for _ in range(count * len(os.sched_getaffinity(0)))
    ]
    try:
        yield
    finally:
        end(loops, signal.SIGKILL)


def _runs(words: Sequence[str], name: str) -> bool:
    """Whether a command line starts a node: as module, as code that names it, or as executable."""
    own = words[: words.index('--ros-args')] if '--ros-args' in words else words
    return any(MODULES[name] in word or Path(word).name == name for word in own)


def _stat(pid: int) -> list[str]:
    """What /proc/PID/stat says after the name of the process."""
    return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
