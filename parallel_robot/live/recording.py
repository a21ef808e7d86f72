"""Recording at the touch of a button: a recorder in a process of its own."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from parallel_robot.bags import output
from parallel_robot.live.source import RefusedError
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.processes.node_processes import NodeProcesses

OF_GRAPH = ('start_stamp', 'subscribers', 'law', 'preset', 'duration')  # not the recorder's own


class Recording:
    """Starts and ends a recorder; use as a context manager."""

    def __init__(self, folder: Path, parameters: Mapping[str, Any] | None = None) -> None:
        """Prepare.

        Args:
            folder: Where the bags go.
            parameters: Of the nodes of a graph that was started here; None for any other, whose
                controller says what the recorder must know.
        """
        self._folder, self._given = folder, parameters
        self._exit = ExitStack()
        self._process: NodeProcesses | None = None
        self._bag = Path()
        self._said = ''

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    def state(self) -> dict[str, Any]:
        """Whether it records, and where; or what became of the last bag."""
        if self._process is not None:
            try:
                self._process.check()
                ended = not self._process.running('recorder')
                self._said = f'{self._bag} is complete' if ended else ''
            except ParallelRobotError as error:
                ended, self._said = True, str(error)
            if ended:
                self._exit.close()
                self._process = None
        running = self._process is not None
        return {'running': running, 'bag': str(self._bag) if running else '', 'says': self._said}

    def start(self, controller: Mapping[str, Any], namespace: str) -> str:
        """Begin a new bag.

        Args:
            controller: Parameters of the controller.
            namespace: Full name of that of the robot.

        Raises:
            RefusedError: a bag is being written.
            InputError: it cannot be written there.
        """
        if self._process is not None:
            raise RefusedError(f'{self._bag} is being written')
        bag = self._folder / time.strftime('live_%Y%m%d_%H%M%S')
        output.check_directory(bag)
        parameters = dict(self._given) if self._given else _told(controller)
        for key in OF_GRAPH:
            parameters.pop(key, None)
        parameters['recorder.out'] = str(bag.absolute())
        self._bag = bag
        self._process = self._exit.enter_context(
            NodeProcesses({'recorder': parameters}, namespace)
        )
        return str(bag)

    async def stop(self) -> str:
        """End the bag.

        Raises:
            RefusedError: none is being written.
        """
        if self._process is None:
            raise RefusedError('nothing is being recorded')
        ending, self._process = self._exit.pop_all(), None
        await asyncio.to_thread(ending.close)
        self._said = f'{self._bag} is complete'
        return str(self._bag)


def _told(controller: Mapping[str, Any]) -> dict[str, Any]:
    """What a recorder must know of a graph that others started; no files that it names."""
    shared = {key for key in LoopParameters._fields if key not in config.CUSTOM}
    found = {
        key: value for key, value in controller.items() if key in shared and value is not None
    }
    if '/' in str(found.get('scenario', '')):
        del found['scenario']
    return found
