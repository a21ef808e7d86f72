"""The two graphs that are compared: the suite's, and its empty twin; each started and ended."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from checkout import ROOT
from graph_processes import end, nodes_below, start

from parallel_robot_model.messages import topics
from parallel_robot_model.processes.node_processes import MODULES

COMMAND = ('-m', 'parallel_robot.cli.command_line')
TWIN = ('benchmarks/empty_graph.py',)
LOOP = ('trajectory', 'plant', 'controller')
START_ORDER = ('recorder', 'trajectory', 'controller', 'plant')
STOP_ORDER = ('plant', 'trajectory', 'controller', 'recorder')
LOOK = 0.1  # s, between two looks at the processes
LEAD = 1.0  # s, from the common start being told to t = 0
STRAGGLERS = 1.0  # s, from the end of the motion to that of the twin
READY = 60.0  # s, for the twin to be matched


class Graph(NamedTuple):
    """A graph that runs."""

    running: Callable[[], bool]  # whether it still runs
    pids: Callable[[], Mapping[str, int]]  # process of each node, by its name


class Outcome:
    """How a graph ended."""

    def __init__(self) -> None:
        self.code: int | None = None  # exit code; None while it runs
        self.said = ''  # what the suite said on its standard error
        self.published: Counter[str] = Counter()  # messages of the twin by topic name


@contextlib.contextmanager
def command(words: Sequence[str], outcome: Outcome) -> Iterator[Graph]:
    """The suite's four nodes by ``parallel_robot run``; SIGINT if it still runs at the end."""
    with tempfile.TemporaryFile('w+') as errors:
        process = start([*COMMAND, 'run', *words], stdout=subprocess.DEVNULL, stderr=errors)
        try:
            yield Graph(lambda: process.poll() is None, lambda: nodes_below(process.pid))
        finally:
            end([process], signal.SIGINT)
        outcome.code = process.returncode
        errors.seek(0)
        outcome.said = errors.read().strip()


@contextlib.contextmanager
def nodes(assignments: Sequence[str]) -> Iterator[Graph]:
    """The suite's nodes without a recorder, in lockstep, by hand; assignments are KEY=VALUE."""
    counts = topics.subscribers(LOOP, lockstep=True)
    processes = {}
    try:
        for name in LOOP:
            words = ['time_mode=lockstep', f'subscribers={counts[name]}', *assignments]
            given = [word for pair in words for word in ('-p', pair.replace('=', ':=', 1))]
            processes[name] = start(
                ['-m', MODULES[name], '--ros-args', *given], stderr=subprocess.DEVNULL
            )
        yield _graph(processes)
    finally:
        end(list(processes.values()), signal.SIGINT)


@contextlib.contextmanager
def twin(
    lockstep: bool, samples: int, bag: Path | None, outcome: Outcome, assignments: Sequence[str]
) -> Iterator[Graph]:
    """The empty graph, with a recorder if there is a file for it.

    It has the transport and the priority of the suite's, as the `assignments` KEY=VALUE say.
    """
    roles = (*LOOP, 'recorder') if bag else LOOP
    words = ['--subscribers', json.dumps(subscribers(lockstep, bag is not None))]
    words += ['--lockstep'] if lockstep else ['--samples', str(samples)]
    words += ['--bag', str(bag)] if bag else []
    for pair in assignments:
        key, _, value = pair.partition('=')
        words += [f'--{key}', value] if key in ('middleware', 'realtime') else []
    processes: dict[str, subprocess.Popen[str]] = {}
    try:
        for role in roles:
            processes[role] = start(
                [*TWIN, role, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
        deadline = time.monotonic() + READY
        for process in processes.values():
            line = process.stdout.readline() if process.stdout else ''
            if line.strip() != 'ready' or time.monotonic() > deadline:
                raise RuntimeError('the empty graph does not start')
        stamp = round(time.time() + LEAD) * 10**9
        over = stamp * 1e-9 + samples * 1e-3 + STRAGGLERS
        for role in START_ORDER:
            if role in processes and (stream := processes[role].stdin):
                stream.write(f'{stamp}\n')
                stream.flush()
        graph = _graph(processes)
        yield Graph(lambda: graph.running() and (lockstep or time.time() < over), graph.pids)
        outcome.code = 0 if graph.running() else 1
        for role in STOP_ORDER:
            if role in processes:
                processes[role].terminate()
                said = processes[role].communicate()[0]
                outcome.published.update(json.loads(said or '{}'))
    finally:
        end(list(processes.values()), signal.SIGTERM)


def warm(directory: Path, assignments: Sequence[str]) -> None:
    """Compile what is not yet compiled, before anything is measured."""
    words = [
        'paper_circle',
        '--time-mode',
        'lockstep',
        '--duration',
        '0.1',
        *settings(assignments),
    ]
    with command([*words, '--out', str(directory / 'warm')], Outcome()) as graph:
        while graph.running():
            time.sleep(LOOK)


def settings(assignments: Sequence[str]) -> list[str]:
    """Changes of the configuration, KEY=VALUE, as words of the command line."""
    return [word for pair in assignments for word in ('--set', pair)]


def revision() -> str:
    """Commit of the checkout, with a plus when files have changed since."""
    words = ['git', '-C', str(ROOT), 'describe', '--always', '--abbrev=7', '--dirty=+']
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def _graph(processes: Mapping[str, subprocess.Popen[str]]) -> Graph:
    return Graph(
        lambda: all(process.poll() is None for process in processes.values()),
        lambda: {name: process.pid for name, process in processes.items()},
    )


def subscribers(lockstep: bool, recorded: bool) -> dict[str, int]:
    """How many subscribers each topic of the twin has."""
    counts = topics.subscriptions((*LOOP, 'recorder') if recorded else LOOP, lockstep)
    return {topic.name: count for topic, count in counts.items()}
