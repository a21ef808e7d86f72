"""The update of a foreign law: it asks the process of the law."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_control.foreign import exchange
from parallel_robot_control.foreign.exchange import (
    DESCRIPTOR,
    ENDED,
    GOT,
    HEAD,
    LATE,
    POLLED,
    WORD,
)
from parallel_robot_model.compiler import (
    inner,
    kernel,
    poll,
    read_at,
    recv,
    send,
    shutdown,
    write_at,
)
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.processes.custom_module import distinguish
from parallel_robot_model.robots.contract import Model

NO_SIGNAL = 0x4000  # MSG_NOSIGNAL of send: a process that has ended is no signal to this one
BOTH = 2  # SHUT_RDWR of shutdown
MILLISECONDS = 1000.0


class Gains(NamedTuple):
    """What can be said of any foreign law."""

    limit: Annotated[
        float, Field('s', 'time for an answer, after which it is a fault', 0.01, 600.0)
    ] = 10.0


class Memory(NamedTuple):
    """What the suite remembers of a foreign law, which has a memory of its own.

    Attributes:
        channel: Address of the memory of its channel.
        session: Number of who asks.
        number: Of the next question; 0: the law begins anew.
    """

    channel: int
    session: int
    number: int


distinguish(Gains, Memory)
numbers_at, answer_words = inner(exchange.numbers_at), inner(exchange.answer)


@inner
def asked(channel: int, words: int, wanted: int, limit: float) -> bool:
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
            if most < exchange.TEXT:
                most = exchange.TEXT
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
    write_at(rows, exchange.POSITION, feedback.position)
    write_at(rows, exchange.VELOCITY, feedback.velocity)
    write_at(rows, exchange.REFERENCE, reference.position)
    write_at(rows, exchange.REFERENCE_VELOCITY, reference.velocity)
    write_at(rows, exchange.REFERENCE_ACCELERATION, reference.acceleration)
    write_at(rows, exchange.EXCESS, feedback.excess)
    write_at(rows, exchange.DISTURBANCE, feedback.disturbance)
    write_at(rows, exchange.GRAVITY, model.gravity)
    matrices = rows + WORD * exchange.ROWS * n
    write_at(matrices, exchange.INERTIA, model.M)
    write_at(matrices, exchange.CORIOLIS, model.Q)
    numbers = rows + WORD * numbers_at(n)
    write_at(numbers, exchange.SESSION, float(memory.session))
    write_at(numbers, exchange.COUNT, float(memory.number))
    write_at(numbers, exchange.DT, dt)
    write_at(numbers, exchange.AGE, feedback.age)
    words = numbers_at(n) + exchange.NUMBERS
    answer = rows + WORD * words
    torque = np.zeros_like(row) + np.nan
    error = reference.position - feedback.position
    sliding_variable, coupled_error = error, error
    there = asked(memory.channel, words, answer_words(n), gains.limit)
    if there and read_at(answer, exchange.FAULT * n, 0.0) == 0.0:
        torque = read_at(answer, exchange.TORQUE, row)
        sliding_variable = read_at(answer, exchange.SLIDING_VARIABLE, row)
        coupled_error = read_at(answer, exchange.COUPLED_ERROR, row)
    known = Memory(memory.channel, memory.session, memory.number + 1)
    return ControlOutput(torque, sliding_variable, coupled_error, known)
