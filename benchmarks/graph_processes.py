"""Processes of a graph: started, found, ended; a busy machine, and its processor time."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from checkout import ROOT

from parallel_robot_model.processes import node_processes as processes
from parallel_robot_model.processes.node_processes import MODULES, die_with_parent, process_status

end = functools.partial(processes.end, timeout=60.0)  # s: `run` waits for its own children


def start(words: Sequence[str], **options: Any) -> subprocess.Popen[str]:
    """Start Python with some words, in the checkout; it ends with this process."""
    return subprocess.Popen(
        [sys.executable, *words],
        cwd=ROOT,
        text=True,
        preexec_fn=die_with_parent,
        **options,
    )


def nodes_below(parent: int) -> dict[str, int]:
    """Process of each node of the suite among the descendants of a process, by node name."""
    children: dict[int, list[int]] = {}
    for path in Path('/proc').glob('[0-9]*'):
        with contextlib.suppress(OSError):
            children.setdefault(int(process_status(int(path.name))[1]), []).append(int(path.name))
    found = {}
    waiting = children.get(parent, [])
    while waiting:
        pid = waiting.pop()
        waiting += children.get(pid, [])
        with contextlib.suppress(OSError):
            own = Path(f'/proc/{pid}/comm').read_text().strip()  # of those that `run` has forked
            words = Path(f'/proc/{pid}/cmdline').read_bytes().decode().split('\0')
            found |= {name: pid for name in MODULES if name == own or _runs(words, name)}
    return found


def memory(pid: int) -> float:
    """Resident memory of a process [B]."""
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return float(pages * os.sysconf('SC_PAGE_SIZE'))


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
