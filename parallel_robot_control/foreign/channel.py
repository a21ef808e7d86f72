"""The process of a foreign law, and the memory through which kernels ask it."""

from __future__ import annotations

import contextlib
import json
import os
import select
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_control.foreign import process
from parallel_robot_control.foreign.process import DESCRIPTOR, ENDED, GOT, HEAD, LATE, POLLED, WORD
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.compiler import (
    FloatBuffer,
    internal,
    kernel,
    poll,
    read_at,
    recv,
    send,
    shutdown,
    write_at,
)
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.processes.child_process import command, exit_reason
from parallel_robot_model.processes.custom_module import qualify_type_names
from parallel_robot_model.robots.contract import Model

PROCESS = 'parallel_robot_control.foreign.process'
LOADING = 60.0  # s, within which a law must be loaded
EXIT_TIMEOUT = 5.0  # s, for a process that is requested to end
FOLDER = 'parallel_robot_law_'  # and the number of the process that asks


class Channel:
    """A foreign law for a number of joints, in a process that ends with this one.

    Attributes:
        space: Its memory: HEAD words, a question, an answer.
        period: The period that the law must have [s]; 0 if it takes any.
        multiples: Whether multiples of it will do, too.
        aged: Whether the law takes the age of the state, with the reference of now.
        kinds: Joints, whether each is a slide for the law, and what says so.
    """

    def __init__(self, file: str, names: Mapping[str, Any], joints: int) -> None:
        """Start it.

        Args:
            file: The file of the law.
            names: What an FMU calls what, see :mod:`parallel_robot_control.foreign.fmu_law`.
            joints: Number of the joints, n.

        Raises:
            InputError: the law cannot be loaded, or is for another number of joints.
        """
        self._task = {'file': file, 'names': dict(names), 'joints': joints}
        self._folder = _new_folder() if file.endswith('.fmu') else None
        self._begin = process.question_length(joints) + HEAD
        words = max(process.answer_length(joints), process.TEXT // process.WORD)
        self.space = FloatBuffer(self._begin + words)
        self._sizes = process.answer_length(joints) * process.WORD
        self._fault = self._begin + process.FAULT * joints
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
        task = json.dumps(self._task | {'folder': self._folder.name if self._folder else ''})
        with theirs:
            self._process = subprocess.Popen(
                command(PROCESS, str(theirs.fileno()), task),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,  # what users read is ours
                pass_fds=(theirs.fileno(),),
            )
        self._socket, self._owner = ours, os.getpid()
        said = self._announcement(ours)
        for session in self._chosen:
            self._send_gains(session)
        self.period = float(said['period'])
        self.multiples, self.aged = bool(said['multiples']), bool(said['aged'])
        self.kinds = said['kinds']
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
            gains: In the order of the law; at most process.MOST_GAINS.
        """
        self._chosen[session] = gains
        self.ready()
        self._send_gains(session)

    def _send_gains(self, session: int) -> None:
        assert self._socket is not None
        # why it has ended is reported at the next question
        with contextlib.suppress(ConnectionError):
            self._socket.send(process.gains_message(session, self._chosen[session]))

    def _announcement(self, ours: socket.socket) -> dict[str, Any]:
        """What the process says of the law that it has loaded."""
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
            return exit_reason(self._process.wait(EXIT_TIMEOUT))
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


def _new_folder() -> tempfile.TemporaryDirectory[str]:
    """A folder of an FMU; those of processes that were killed are removed."""
    for left in Path(tempfile.gettempdir()).glob(f'{FOLDER}*_*'):
        number = left.name.removeprefix(FOLDER).partition('_')[0]
        if number.isdigit() and not Path('/proc', number).exists():
            shutil.rmtree(left, ignore_errors=True)
    return tempfile.TemporaryDirectory(prefix=f'{FOLDER}{os.getpid()}_')


# The update of a foreign law: it asks the process of the law.

NO_SIGNAL = 0x4000  # MSG_NOSIGNAL of send: a process that has ended is no signal to this one
BOTH = 2  # SHUT_RDWR of shutdown
MILLISECONDS = 1000.0


class Gains(NamedTuple):
    """What can be said of any foreign law."""

    limit: Annotated[
        float, Field('s', 'time for an answer, after which it is a fault', 0.01, 600.0)
    ] = 10.0


class Memory(NamedTuple):
    """What the suite remembers of a foreign law, which has a memory of its own."""

    channel: int  # address of the memory of its channel
    session: int  # number of who asks
    number: int  # of the next question; 0: the law begins anew


qualify_type_names(Gains, Memory)
numbers_at, answer_words = internal(process.numbers_at), internal(process.answer_length)


@internal
def exchange(channel: int, words: int, wanted: int, limit: float) -> bool:
    """Send a question, and wait for the answer; whether it is there.

    Args:
        channel: Address of a channel, whose question is written.
        words: Length of the question.
        wanted: Length of the answer.
        limit: Time for it [s].
    """
    got = float(read_at(channel, GOT, 0.0))
    if got != WORD * wanted:
        return False
    descriptor = int(read_at(channel, DESCRIPTOR, 0.0))
    there = channel + WORD * HEAD
    got = float(ENDED)
    if send(descriptor, there, WORD * words, NO_SIGNAL) == WORD * words:
        ready, left = 0, int(MILLISECONDS * limit)
        while ready <= 0 and left > 0:  # a signal to this process ends a millisecond
            ready = poll(channel + WORD * POLLED, 1, 1)
            left -= 1
        got = float(LATE)
        if ready > 0:
            most = WORD * wanted
            if most < process.TEXT:
                most = process.TEXT
            got = max(float(ENDED), float(recv(descriptor, there + WORD * words, most, 0)))
    write_at(channel, GOT, got)
    if got != WORD * wanted:
        shutdown(descriptor, BOTH)  # a late answer would be one to another question
        return False
    return True


@kernel
def update(
    gains: Gains,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    memory: Memory,
    dt: float,
) -> ControlOutput:
    """Ask the process of the law; its torque is not finite where it gives none.

    Returns:
        Torque [N m], what the law tells as sliding variable and coupled error, memory.
    """
    row = feedback.position
    n = len(row)
    rows = memory.channel + WORD * HEAD
    write_at(rows, process.POSITION, feedback.position)
    write_at(rows, process.VELOCITY, feedback.velocity)
    write_at(rows, process.REFERENCE, reference.position)
    write_at(rows, process.REFERENCE_VELOCITY, reference.velocity)
    write_at(rows, process.REFERENCE_ACCELERATION, reference.acceleration)
    write_at(rows, process.EXCESS, feedback.excess)
    write_at(rows, process.DISTURBANCE, feedback.disturbance)
    write_at(rows, process.GRAVITY, model.gravity)
    matrices = rows + WORD * process.ROWS * n
    write_at(matrices, process.INERTIA, model.M)
    write_at(matrices, process.CORIOLIS, model.Q)
    numbers = rows + WORD * numbers_at(n)
    write_at(numbers, process.SESSION, float(memory.session))
    write_at(numbers, process.COUNT, float(memory.number))
    write_at(numbers, process.DT, dt)
    write_at(numbers, process.AGE, feedback.age)
    words = numbers_at(n) + process.NUMBERS
    answer = rows + WORD * words
    torque = np.zeros_like(row) + np.nan
    error = reference.position - feedback.position
    sliding_variable, coupled_error = error, error
    there = exchange(memory.channel, words, answer_words(n), gains.limit)
    if there and read_at(answer, process.FAULT * n, 0.0) == 0.0:
        torque = read_at(answer, process.TORQUE, row)
        sliding_variable = read_at(answer, process.SLIDING_VARIABLE, row)
        coupled_error = read_at(answer, process.COUPLED_ERROR, row)
    known = Memory(memory.channel, memory.session, memory.number + 1)
    return ControlOutput(torque, sliding_variable, coupled_error, known)
