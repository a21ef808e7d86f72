"""The process of a foreign law: it loads the law, says so, and answers questions to its end."""

from __future__ import annotations

import contextlib
import ctypes
import json
import math
import os
import resource
import select
import shutil
import signal
import socket
import struct
import sys
import threading
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from parallel_robot_model.common.errors import ParallelRobotError, first_line

# What the suite and the process of a foreign law say to each other: a message of floats each way.
#
# A question has rows of n numbers, two matrices, then numbers; an answer has rows, then a number.
# Gains of the law itself go before the questions of a session, in a message with a byte beside its
# words.

WORD = 8  # bytes
(
    POSITION,
    VELOCITY,
    REFERENCE,
    REFERENCE_VELOCITY,
    REFERENCE_ACCELERATION,
    EXCESS,
    DISTURBANCE,
    GRAVITY,
) = range(8)
ROWS = 8
INERTIA, CORIOLIS = range(2)  # M and Q, after the rows
SESSION, COUNT, DT, AGE = range(4)  # after the matrices
NUMBERS = 4
TORQUE, SLIDING_VARIABLE, COUPLED_ERROR, FAULT = range(4)  # of the answer; the fault is a number

# Words of a channel before the messages: descriptor, what poll takes, length of the last answer.
DESCRIPTOR, POLLED, GOT, HEAD = range(4)
ENDED, LATE = 0, -1  # as a length: there is none

MOST = 64  # joints, of a foreign law
MOST_GAINS = 10  # of its own: with their session they are shorter than a question of one joint
TEXT = 512  # bytes, of why a process gives no answer, which it sends in its place


def gains_message(session: int, gains: Sequence[float]) -> bytes:
    """The message that tells the gains of a session."""
    return struct.pack(f'={1 + len(gains)}dx', session, *gains)


def numbers_at(joints: int) -> int:
    """Where the numbers of a question begin [words]."""
    return (ROWS + 2 * joints) * joints


def question_length(joints: int) -> int:
    """Length of a question [words]."""
    return numbers_at(joints) + NUMBERS


def answer_length(joints: int) -> int:
    """Length of an answer [words]."""
    return FAULT * joints + 1


KINDS = {'.so': 'c_law', '.fmu': 'fmu_law'}  # modules, each with a Loaded, by suffix of the file


class Loaded(Protocol):
    """A foreign law that is loaded."""

    period: float  # the period that it must have [s]; 0 if it takes any
    multiples: bool  # whether multiples of it will do, too
    aged: bool  # whether it takes the age of the state, with the reference of now
    # of a joint, by its 0-based index, whether it is a slide, and what says so
    kinds: Sequence[tuple[int, bool, str]]

    def update(self, begins: bool, dt: float, age: float, gains: Sequence[float]) -> float:
        """Answer the question in memory: the number of a fault of its own, 0 without one.

        Args:
            begins: Whether it must forget all that was before.
            dt: Time since the last state [s].
            age: Of the state at the moment at which the torque acts [s]; 0 if not asked for.
            gains: Those of the law itself; none: its own defaults.
        """


def _error_text(error: BaseException) -> str:
    known = isinstance(error, ParallelRobotError)
    return str(error) if known else first_line(error)


def _watch(channel: socket.socket, folder: str) -> None:
    """End this process, whatever the law is doing, when the one that asks has ended."""
    watched = select.poll()
    watched.register(channel, 0)  # its end alone
    watched.poll()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(0)


def main() -> None:
    """Serve."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the one that asks
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    channel = socket.socket(fileno=int(sys.argv[1]))
    channel.set_inheritable(False)
    task: dict[str, Any] = json.loads(sys.argv[2])
    threading.Thread(target=_watch, args=(channel, task['folder']), daemon=True).start()
    joints, file = task['joints'], Path(task['file'])
    question = (ctypes.c_double * question_length(joints))()
    answer = (ctypes.c_double * answer_length(joints))()
    try:
        kind = import_module(f'parallel_robot_control.foreign.{KINDS[file.suffix]}')
        law: Loaded = kind.load(task, question, answer)
        said = {key: getattr(law, key) for key in ('period', 'multiples', 'aged', 'kinds')}
        channel.send(json.dumps(said).encode())
    except BaseException as error:  # whatever a law raises
        channel.send(json.dumps({'refused': _error_text(error)}).encode())
        os._exit(1)
    with contextlib.suppress(ConnectionError):  # it has ended before it read an answer
        _serve(channel, law, joints, question, answer)
    shutil.rmtree(task['folder'], ignore_errors=True)
    os._exit(0)


def _serve(channel: socket.socket, law: Loaded, joints: int, question: Any, answer: Any) -> None:
    """Answer until nobody asks."""
    numbers = numbers_at(joints)
    expected = (0.0, 0.0)
    chosen: dict[float, list[float]] = {}  # gains by session
    while got := channel.recv_into(question):
        if got % WORD:
            chosen[question[0]] = question[1 : got // WORD]
            continue
        call = question[numbers + SESSION], question[numbers + COUNT]
        begins = call[1] == 0.0
        try:
            if not begins and call != expected:
                raise ParallelRobotError(
                    'two runs ask the same process of a law: it has one memory'
                )
            _preset(joints, question, answer)
            dt, age = question[numbers + DT], question[numbers + AGE]
            fault = law.update(begins, dt, age, chosen.get(call[0], ()))
            answer[FAULT * joints] = fault
        except BaseException as error:
            text = _error_text(error).encode()[:TEXT]
            channel.send(text + b' ' * (len(text) in (0, WORD * len(answer))))
            return
        expected = call[0], call[1] + 1.0
        channel.send(answer)


def _preset(n: int, question: Any, answer: Any) -> None:
    """Write what stands where a law of n joints says nothing: no torque, and the error."""
    for k in range(n):
        error = question[REFERENCE * n + k] - question[POSITION * n + k]
        answer[TORQUE * n + k] = math.nan
        answer[SLIDING_VARIABLE * n + k] = answer[COUPLED_ERROR * n + k] = error


if __name__ == '__main__':
    main()
