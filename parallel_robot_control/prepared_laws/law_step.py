"""One step of a law, whose gains and memory the control cycle knows by their address alone."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    arrays_of,
    composed,
    present,
    propose,
    read_row,
    vectors_of,
)
from parallel_robot_model.robots.contract import Model


class LawParts(NamedTuple):
    """What a step of a law takes.

    Attributes:
        gains: Gains of the law, boxed.
        memory: Its memory, a KeptValue.
        like: A memory, for its type.
    """

    gains: Any
    memory: int
    like: Any


class Asked(NamedTuple):
    """What a law asks for: torque [N m], sliding variable, e_c [rad], each shape (n,)."""

    torque: Array
    sliding_variable: Array
    coupled_error: Array


def update(
    gains: Any,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    memory: Any,
    dt: float,
) -> ControlOutput:
    """Update of the law, see :class:`parallel_robot_control.contract.Law`."""
    raise NotImplementedError


def step(
    law: LawParts, model: Model, reference: JointReference, feedback: Feedback, dt: float
) -> Asked:
    """Update a law; its next memory is proposed."""
    memory = present(law.memory, law.like)
    output = update(law.gains, model, reference, feedback, memory, dt)
    propose(law.memory, output.memory, law.like)
    return Asked(output.torque, output.sliding_variable, output.coupled_error)


def step_with_arrays(
    law: LawParts, model: Model, reference: JointReference, feedback: Feedback, dt: float
) -> Asked:
    """The same for a law that works with arrays: its update gets copies of the vectors."""
    memory = arrays_of(present(law.memory, law.like))
    output = update(
        law.gains, arrays_of(model), arrays_of(reference), arrays_of(feedback), memory, dt
    )
    propose(law.memory, vectors_of(output.memory, law.like), law.like)
    row = feedback.position
    return Asked(
        read_row(output.torque, 0, row),
        read_row(output.sliding_variable, 0, row),
        read_row(output.coupled_error, 0, row),
    )


@functools.cache
def stepping(update: Any, arrays: bool) -> Any:
    """The step of a law with an update, compiled for the law; `arrays`: that with arrays."""
    return composed(step_with_arrays if arrays else step, update=update)
