"""A custom law that works with arrays: its update gets copies of the vectors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.compiler import inner, kernel, read_row, write_row
from parallel_robot_model.robots.contract import Model


class ArrayLaw(NamedTuple):
    """The update of a law, as FirstClass, and its gains."""

    update: Any
    gains: Any


@inner
def _array(x: Array) -> Array:
    """Copy of a vector, shape (n,)."""
    copy = np.empty(len(x))
    write_row(copy, 0, x)
    return copy


@inner
def _matrix(x: Array) -> Array:
    """Copy of a matrix, shape (n, n)."""
    copy = np.empty((len(x), len(x)))
    write_row(copy, 0, x)
    return copy


@kernel
def update_of_arrays(
    law: ArrayLaw,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    memory: Any,
    dt: float,
) -> ControlOutput:
    """Update of a law, see :class:`parallel_robot_control.contract.Law`."""
    output = law.update(
        law.gains,
        Model(_matrix(model.M), _matrix(model.Q), _array(model.gravity)),
        JointReference(
            _array(reference.position), _array(reference.velocity), _array(reference.acceleration)
        ),
        Feedback(
            _array(feedback.position),
            _array(feedback.velocity),
            _array(feedback.excess),
            _array(feedback.disturbance),
        ),
        memory,
        dt,
    )
    row = feedback.position
    return ControlOutput(
        read_row(output.torque, 0, row),
        read_row(output.sliding_variable, 0, row),
        read_row(output.coupled_error, 0, row),
        output.memory,
    )
