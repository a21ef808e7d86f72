"""The process of a foreign law, and the memory through which kernels ask it."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import subprocess
import tempfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_control.foreign import exchange
from parallel_robot_control.foreign.exchange import DESCRIPTOR, ENDED, GOT, HEAD, LATE, POLLED
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.compiler import Space
from parallel_robot_model.processes.child_process import command, trial_ending

PROCESS = 'parallel_robot_control.foreign.process'
LOADING = 60.0  # s, within which a law must be loaded
ENDING = 5.0  # s, for a process that is told to end


class Channel:
    """A foreign law for a number of joints, in a process that ends with this one.

    Attributes:
        space: Its memory: HEAD words, a question, an answer.
        period: The period that the law must have [s]; 0 if it takes any.
        multiples: Whether multiples of it will do, too.
        aged: Whether the law takes the age of the state, with the reference of now.
    """

    def __init__(self, file: str, names: Mapping[str, Any], joints: int) -> None:
        """Start it.

        Args:
            file: The file of the law.
            names: What an FMU calls what, see :mod:`parallel_robot_control.foreign.names`.
            joints: Number of the joints, n.

        Raises:
            InputError: the law cannot be loaded, or is for another number of joints.
        """
        self._task = {'file': file, 'names': dict(names), 'joints': joints}
        self._folder = tempfile.TemporaryDirectory(prefix='parallel_robot_law_')
        self._begin = exchange.question(joints) + HEAD
        words = max(exchange.answer(joints), exchange.TEXT // exchange.WORD)
        self.space = Space(self._begin + words)
        self._sizes = exchange.answer(joints) * exchange.WORD
        self._fault = self._begin + exchange.FAULT * joints
        self._chosen: dict[int, tuple[float, ...]] = {}
        self._owner = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self.ready()

    def ready(self) -> None:
        """Start the process, unless it runs."""
        if self.runs:
            return
        self.space.floats[GOT] = ENDED  # it does not run until it has said that it does
        if self._owner == os.getpid():
            self._end()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        task = json.dumps(self._task | {'folder': self._folder.name})
        with theirs:
            self._process = subprocess.Popen(
                command(PROCESS, str(theirs.fileno()), task),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,  # what users read is ours
                pass_fds=(theirs.fileno(),),
            )
        self._socket, self._owner = ours, os.getpid()
        said = self._first_words(ours)
        for session in self._chosen:
            self._tell(session)
        self.period = float(said['period'])
        self.multiples, self.aged = bool(said['multiples']), bool(said['aged'])
        floats = self.space.floats
        floats[[DESCRIPTOR, GOT]] = ours.fileno(), self._sizes
        floats[POLLED : POLLED + 1].view(np.int32)[:] = ours.fileno(), select.POLLIN

    @property
    def runs(self) -> bool:
        """Whether the process runs and is well; that of a copy of this process does not."""
        if self._process is None or self._owner != os.getpid():
            return False
        return self._well and self._process.poll() is None

    def choose(self, session: int, gains: tuple[float, ...]) -> None:
        """Have gains of the law itself for one who asks.

        Args:
            session: Its number.
            gains: In the order of the law; at most exchange.MOST_GAINS.
        """
        self._chosen[session] = gains
        self.ready()
        self._tell(session)

    def _tell(self, session: int) -> None:
        assert self._socket is not None
        with contextlib.suppress(ConnectionError):  # why it has ended is told at the next question
            self._socket.send(exchange.told_gains(session, self._chosen[session]))

    def _first_words(self, ours: socket.socket) -> dict[str, Any]:
        """What the process says of the law that it has loaded.

        Raises:
            InputError: it could not.
        """
        ours.settimeout(LOADING)
        try:
            words = ours.recv(1 << 16)
        except TimeoutError:
            self._end()
            raise InputError(f'is not loaded within {LOADING:g} s') from None
        except ConnectionResetError:
            words = b''
        if not words:
            raise InputError(f'the law {self._how()} when it is loaded')
        said: dict[str, Any] = json.loads(words)
        if 'refused' in said:
            self._end()
            raise InputError(str(said['refused']))
        ours.setblocking(True)
        return said

    @property
    def _well(self) -> bool:
        return bool(self.space.floats[GOT] == self._sizes)

    def _how(self) -> str:
        """How the process has ended."""
        assert self._process is not None
        try:
            return trial_ending(self._process.wait(ENDING))
        except subprocess.TimeoutExpired:
            return 'gives no answer'

    def _end(self) -> None:
        """End the process, whatever it does."""
        if self._socket is not None:
            self._socket.close()
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
            self._process.wait()

    def failure(self, limit: float) -> str:
        """Why the last answer had no torque; empty if it had one, finite or not.

        Args:
            limit: Time that it had [s].
        """
        got = int(self.space.floats[GOT])
        if got == self._sizes:
            fault = self.space.floats[self._fault]
            return f'the law is in a fault of its own, {fault:.9g}' if fault else ''
        if got == LATE:
            return f'the law gives no answer within {limit:g} s'
        if got == ENDED:
            return f'the law {self._how()}'
        text = self.space.floats[self._begin :].tobytes()[:got]
        return printable(text.decode(errors='replace').strip())
