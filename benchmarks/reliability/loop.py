"""The processes of a loop in real time: nodes that can be stopped, killed and started again."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from reliability.effects import TOPICS, Effect, relayed

from parallel_robot_model.configuration.loop import WAIT
from parallel_robot_model.processes.node_processes import MODULES, as_yaml, die_with_parent

NODES = ('trajectory', 'plant', 'controller')
READERS = {'states': 'controller', 'references': 'controller', 'commands': 'plant'}
GRACE = 10.0  # s, from SIGINT to SIGKILL


class Loop:
    """Trajectory, plant and controller, and a relay if there is something to relay."""

    def __init__(
        self,
        folder: Path,
        changed: Mapping[str, Any],
        relay: Sequence[str] = (),
        prefixes: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Start the processes; they wait to be given their common start.

        Args:
            folder: For their output.
            changed: Configuration that differs from the defaults.
            relay: The topics that go through the relay, keys of TOPICS.
            prefixes: Words that stand before the command of a node, by its name.
        """
        self._folder = folder
        self._changed = dict(changed)
        self._relay = tuple(relay)
        self._prefixes = prefixes or {}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}  # the processes by name
        if relay:
            command = [sys.executable, '-m', 'reliability.relay_node', *relay]
            self.processes['relay'] = self._start('relay', command, subprocess.PIPE)
        for name in NODES:
            self.begin(name)

    def begin(self, name: str, start: int = WAIT) -> None:
        """Start a node; `start` is the stamp of t = 0 [ns], 0 for a motion of its own."""
        subscribers = 1 if name == 'trajectory' else 2
        parameters = {**self._changed, 'start_stamp': start, 'subscribers': subscribers}
        command = [*self._prefixes.get(name, ()), sys.executable, '-m', MODULES[name]]
        command += ['--ros-args']
        for key, value in parameters.items():
            command += ['-p', f'{key}:={as_yaml(value)}']
        for key in self._relay:
            if READERS[key] == name:
                command += ['-r', f'{TOPICS[key].name}:={relayed(key)}']
        self.processes[name] = self._start(name, command)

    def disturb(self, effect: Effect, *keys: str) -> None:
        """Let the relay do something to some of its topics, or to all."""
        pipe = self.processes['relay'].stdin
        assert pipe is not None
        for key in keys or (None,):
            pipe.write(json.dumps({'topic': key, **effect._asdict()}).encode() + b'\n')
        pipe.flush()

    def stop(self, name: str, seconds: float) -> None:
        """Let a process stand still for some time."""
        process = self.processes[name]
        process.send_signal(signal.SIGSTOP)
        try:
            time.sleep(seconds)
        finally:
            process.send_signal(signal.SIGCONT)

    def kill(self, name: str) -> None:
        """Kill a process as the system does when memory runs out."""
        self.processes[name].kill()
        self.processes[name].wait()

    def dead(self) -> dict[str, str]:
        """Processes that have ended, with their last line."""
        return {
            name: self._last_line(name)
            for name, process in self.processes.items()
            if process.poll() is not None
        }

    def close(self) -> None:
        """End all processes, the controller first."""
        for name in sorted(self.processes, key=lambda name: name != 'controller'):
            process = self.processes[name]
            if process.stdin is not None:
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.close()
            process.send_signal(signal.SIGINT)
        for process in self.processes.values():
            try:
                process.wait(GRACE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _start(
        self, name: str, command: Sequence[str], stdin: int = subprocess.DEVNULL
    ) -> subprocess.Popen[bytes]:
        with (self._folder / f'{name}.log').open('ab') as log:
            return subprocess.Popen(
                command,
                stdin=stdin,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=self._folder,
                env=environment(),
                start_new_session=True,
                preexec_fn=die_with_parent,
            )

    def _last_line(self, name: str) -> str:
        lines = (self._folder / f'{name}.log').read_text(errors='replace').splitlines()
        last = next((line.strip() for line in reversed(lines) if line.strip()), 'no output')
        return re.sub(r'^\[\w+\] \[[\d.]+\] \[\w+\]: ', '', last)  # level, time and node


def environment() -> dict[str, str]:
    """Environment of the processes: this folder's package can be imported."""
    here = str(Path(__file__).parents[1])
    paths = [here, *filter(None, os.environ.get('PYTHONPATH', '').split(os.pathsep))]
    return {
        'AMENT_PREFIX_PATH': sys.prefix,
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        **os.environ,
        'PYTHONPATH': os.pathsep.join(paths),
    }
