"""The faults, one row of the table each."""

from __future__ import annotations

import contextlib
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from graph_processes import busy
from reliability import hosts
from reliability.bench import Bench
from reliability.effects import Effect
from reliability.loop import NODES, environment

from parallel_robot.bags.run import recording
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.node_processes import MODULES, as_yaml

DISTURBED = 3.0  # s, for which the relay disturbs
HOGGED = 8.0  # s
DISK = 2**20  # bytes
ECHO = 0.1  # s, in which what a killed node has said arrives
START = 20.0  # s, within which a node that was started again must speak
SPEAKS = {
    'trajectory': topics.POSE_REFERENCE,
    'plant': topics.JOINT_STATES,
    'controller': topics.COMMANDS,
}
JOINS, AT_ONCE = 100, 5


class Row(NamedTuple):
    """A fault."""

    name: str  # how it stands in the table
    # injects it, takes as long as it lasts, and returns what is to be noted
    inject: Callable[[Bench], str]
    relay: tuple[str, ...] = ()  # the topics that go through the relay
    quick: bool = False  # whether ``--quick`` has it
    across: bool = False  # whether the controller is on another host


def disturb(effect: Effect, *keys: str) -> Callable[[Bench], str]:
    """Disturb topics by the relay."""

    def inject(bench: Bench) -> str:
        bench.loop.disturb(effect, *keys)
        time.sleep(DISTURBED)
        bench.loop.disturb(Effect(), *keys)
        return ''

    return inject


def nothing(bench: Bench) -> str:
    """Only look."""
    time.sleep(DISTURBED)
    return ''


def stand_still(name: str, seconds: float) -> Callable[[Bench], str]:
    """Stop a node for some time."""

    def inject(bench: Bench) -> str:
        bench.loop.stop(name, seconds)
        return ''

    return inject


def kill(name: str) -> Callable[[Bench], str]:
    """Kill a node, start it again at once, and wait for its first message."""

    def inject(bench: Bench) -> str:
        heard = bench.watch.heard[SPEAKS[name]]
        bench.loop.kill(name)
        time.sleep(ECHO)
        before, begun = len(heard), time.monotonic()
        bench.loop.begin(name, 0 if name == 'plant' else bench.start)
        while len(heard) == before and time.monotonic() - begun < START:
            time.sleep(0.01)
        return f'first message {time.monotonic() - begun:.1f} s after its start'

    return inject


def hog(per_core: int) -> Callable[[Bench], str]:
    """Keep all cores busy with other processes."""

    def inject(bench: Bench) -> str:
        with busy(per_core):
            time.sleep(HOGGED)
        return ''

    return inject


def fill_disk(bench: Bench) -> str:
    """Let the loop be recorded to a disk that becomes full."""
    with _small_disk(bench.folder) as (place, limit):
        parameters = {
            **bench.changed,
            'start_stamp': bench.start,
            'recorder.out': str(place / 'bag'),
        }
        words = [f'{key}:={as_yaml(value)}' for key, value in parameters.items()]
        command = [sys.executable, '-m', MODULES['recorder'], '--ros-args']
        command += [word for pair in words for word in ('-p', pair)]
        log = bench.folder / 'recorder.log'
        with log.open('wb') as file:
            process = subprocess.Popen(
                command,
                stdout=file,
                stderr=subprocess.STDOUT,
                env=environment(),
                preexec_fn=limit,
            )
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)
            process.wait()
            return 'the recorder did not notice'
        try:
            kept = f'{len(recording.read(place / "bag").log.stamps)} states kept'
        except BagError as error:
            kept = str(error)
        reason = [line for line in log.read_text().splitlines() if line.startswith('[FATAL]')]
        said = reason[-1].rpartition(': ')[2] if reason else 'no reason given'
        return f'recorder: ends with code {process.returncode}, "{said}", {kept}'


@contextlib.contextmanager
def _small_disk(folder: Path) -> Iterator[tuple[Path, Callable[[], None]]]:
    """A place for at most DISK bytes, and what a process calls before it writes there."""
    place = folder / 'disk'
    place.mkdir(exist_ok=True)
    size = f'size={DISK}'
    mount = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', size, 'tmpfs', place], capture_output=True
    )
    try:
        if mount.returncode == 0:
            yield place, lambda: None
        else:  # not permitted
            yield place, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (DISK, DISK))
    finally:
        if mount.returncode == 0:
            subprocess.run(['umount', place], check=True)


def join(bench: Bench) -> str:
    """Let fresh processes join, hear a state and leave, several at once."""
    command = [sys.executable, '-m', 'reliability.joiner', str(JOINS), str(AT_ONCE)]
    done = subprocess.run(
        command, env=environment(), cwd=bench.folder, capture_output=True, text=True, timeout=300
    )
    return '' if done.returncode == 0 else f'joiners: {done.stderr.strip()[-200:]}'


def cut(seconds: float) -> Callable[[Bench], str]:
    """Pull the cable between the hosts for some time."""

    def inject(bench: Bench) -> str:
        hosts.pull(bench.far)
        try:
            time.sleep(seconds)
        finally:
            hosts.plug(bench.far)
        return ''

    return inject


def _rows() -> Iterator[Row]:
    yield Row('none', nothing, quick=True)
    for name in NODES:
        for milliseconds in (5, 50, 500):
            text = f'{name} stands still for {milliseconds} ms (SIGSTOP)'
            yield Row(text, stand_still(name, milliseconds * 1e-3), quick=milliseconds == 50)
    for count, words in ((1, 'one busy process'), (2, 'two busy processes')):
        yield Row(f'{words} per core for {HOGGED:g} s', hog(count), quick=count == 2)
    yield Row('the disk under the recorder is full', fill_disk, quick=True)
    yield Row(f'{JOINS} processes join and leave, {AT_ONCE} at once', join)
    for name in NODES:
        yield Row(f'{name} killed and started again (SIGKILL)', kill(name), quick=True)
    for key in ('states', 'commands', 'references'):
        through = (key,)
        yield Row(f'none, {key} through the relay', nothing, through)
        for share in (0.01, 0.05, 0.2):
            effect = disturb(Effect(drop=share), key)
            yield Row(f'{100 * share:g} % of the {key} lost', effect, through, share == 0.05)
        for milliseconds in (1, 5, 10, 20) if key != 'references' else ():
            effect = disturb(Effect(delay=milliseconds * 1e-3), key)
            text = f'{key} {milliseconds} ms late'
            yield Row(text, effect, through, milliseconds == 5)
        text = f'{key} held up for 50 ms, then all at once, twice a second'
        yield Row(text, disturb(Effect(burst=0.05), key), through)
    stamped: tuple[tuple[str, ...], ...] = (('states',), ('states', 'references'))
    for keys in stamped:
        for step in (0.1, -0.1, 10.0, -10.0):
            text = f'stamps of the {" and ".join(keys)} step by {step:+g} s and back'
            yield Row(text, disturb(Effect(shift=step)), keys, step == -0.1)
    yield Row('none, controller on another host', nothing, across=True)
    for seconds in (0.2, 5.0):
        text = f'link between the hosts cut for {seconds:g} s'
        yield Row(text, cut(seconds), quick=True, across=True)


ROWS = tuple(sorted(_rows(), key=lambda row: row.relay))
