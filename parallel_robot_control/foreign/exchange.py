"""What the suite and the process of a foreign law say to each other: a message of floats each way.

A question has rows of n numbers, two matrices, then numbers; an answer has rows, then a number.
Gains of the law itself go before the questions of a session, in a message with a byte beside its
words.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

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


def told_gains(session: int, gains: Sequence[float]) -> bytes:
    """The message that tells the gains of a session."""
    return struct.pack(f'={1 + len(gains)}dx', session, *gains)


def numbers_at(joints: int) -> int:
    """Where the numbers of a question begin [words]."""
    return (ROWS + 2 * joints) * joints


def question(joints: int) -> int:
    """Length of a question [words]."""
    return numbers_at(joints) + NUMBERS


def answer(joints: int) -> int:
    """Length of an answer [words]."""
    return FAULT * joints + 1
