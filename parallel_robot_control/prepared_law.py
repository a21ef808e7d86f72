"""A law with its gains, checked and compiled."""

from __future__ import annotations

import functools
import warnings
from typing import Any, NamedTuple, cast

import numpy as np
from numba import typeof

from parallel_robot_control import law_trial
from parallel_robot_control.contract import ControlOutput, Feedback, Foreign, JointReference, Law
from parallel_robot_control.laws import LAWS
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError, first_line
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    INTERPRETED,
    OPAQUE,
    Boxed,
    FunctionValue,
    Struct,
    arrays_of,
    as_arrays,
    as_vectors,
    is_finite,
    read_row,
    reason,
    specialize,
    vector,
    vectors_of,
)
from parallel_robot_model.processes.custom_module import RAISED, qualify_type_names
from parallel_robot_model.robots.contract import Fault, Model

# One step of a law, whose gains and memory the control cycle knows by their address alone.


class LawMemory(NamedTuple):
    """What a law remembers, as a Struct."""

    current: Any  # after its last step
    first: Any  # before the first one


class LawParts(NamedTuple):
    """What a step of a law takes."""

    gains: Any  # gains of the law, boxed
    memory: Any  # its LawMemory, a Struct


class LawOutput(NamedTuple):
    """What a law demands: torque [N m], sliding variable, e_c [rad], each shape (n,)."""

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
    law: LawParts,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    anew: bool,
    dt: float,
) -> LawOutput:
    """Update a law, with its first memory if `anew`; a torque that is no number changes none."""
    memory = law.memory.first if anew else law.memory.current
    output = update(law.gains, model, reference, feedback, memory, dt)
    if is_finite(output.torque):
        law.memory.current = output.memory
    return LawOutput(output.torque, output.sliding_variable, output.coupled_error)


def step_with_arrays(
    law: LawParts,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    anew: bool,
    dt: float,
) -> LawOutput:
    """The same for a law that works with arrays: its update gets copies of the vectors."""
    before, row = law.memory.first if anew else law.memory.current, feedback.position
    memory = arrays_of(before)
    output = update(
        law.gains, arrays_of(model), arrays_of(reference), arrays_of(feedback), memory, dt
    )
    torque = read_row(output.torque, 0, row)
    if is_finite(torque):
        law.memory.current = vectors_of(output.memory, before)
    return LawOutput(
        torque, read_row(output.sliding_variable, 0, row), read_row(output.coupled_error, 0, row)
    )


@functools.cache
def stepping(update: Any, arrays: bool) -> Any:
    """The step of a law with an update, compiled for the law; `arrays`: that with arrays."""
    return specialize(step_with_arrays if arrays else step, update=update)


NO_NUMBER = faults.FAULTS[faults.TORQUE_NOT_FINITE].key


class PreparedLaw(NamedTuple):
    """A law ready to run."""

    name: str  # key of LAWS, or the name of a custom law
    gains: Any
    memory: Struct  # its LawMemory
    step: FunctionValue  # its compiled step
    law: Boxed  # what its step takes: the law as LawParts, boxed, of one type for all laws
    warnings: tuple[str, ...]  # objections of the theory to gains that are accepted all the same
    foreign: Foreign | None = None  # the foreign law that it is, if it is one
    arrays: str = ''  # why its update works with arrays; empty if it works with vectors

    def reset_memory(self) -> None:
        """Let the law remember what it does before its first step."""
        self.memory.current = self.memory.first

    def reset(self) -> None:
        """Forget what was before, as the process of a foreign law does, too."""
        self.reset_memory()
        if self.foreign is not None:
            self.foreign.start()

    def explain(self, fault: Fault) -> Fault:
        """A fault of a controller with this law, with what became of a foreign one."""
        if self.foreign is None or fault.key != NO_NUMBER:
            return fault
        return fault._replace(text=self.foreign.failure(self.gains) or fault.text)


def validate_gains(name: str, law: Law, gains: Any) -> tuple[str, ...]:
    """Ask a law to check its gains.

    Returns:
        Warnings.

    Raises:
        InputError: the theory of the law forbids them.
    """
    try:
        return tuple(f'{name}: {text}' for text in law.validate_gains(gains))
    except InputError as error:
        raise InputError(f'{name}: {error}', name) from None
    except RAISED as error:
        raise InputError(f'{name}: validate_gains: {first_line(error)}') from error


def prepare(name: str, law: Law, gains: Any, joints: int) -> PreparedLaw:
    """Check the gains of a law and compile it.

    Args:
        name: Key of LAWS, or the name of a custom law.
        law: The law.
        gains: Its gains.
        joints: Number of the actuated joints, n.

    Raises:
        InputError: the theory of the law forbids the gains, or a custom law does not compile or
            does not pass its trial.
    """
    warnings = validate_gains(name, law, gains)
    if not hasattr(law.update, 'py_func'):
        raise InputError(f'{name}: update is not compiled: put @kernel before it')
    try:
        memory = law.initial_memory(joints)
        if law.foreign is not None:
            law.foreign.choose(memory, gains)
        qualify_type_names(type(gains), type(memory))
        typeof(memory)
    except InputError as error:
        raise InputError(f'{name}: {error}') from None
    except RAISED as error:
        raise InputError(f'{name}: initial_memory: {first_line(error)}') from error
    memory = as_vectors(memory)
    if wrong := law_trial.wrong_memory(memory):
        raise InputError(f'{name}: initial_memory: {wrong}')
    row, matrix = vector(np.zeros(joints)), vector(np.eye(joints))
    parts = Boxed(LawParts(Boxed(gains), Struct(LawMemory(memory, memory))))
    try:
        own = _compiled(stepping(law.update, False), parts, *_motion(row, matrix), False, 1e-3)
        fits = INTERPRETED or own.signature().return_type == typeof(LawOutput(row, row, row))
        unfit: Exception = InputError('what it returns')
    except Exception as error:  # if it is wrong with arrays, too, that is said of it
        fits, unfit = False, error
    if not fits:
        own = _with_arrays(name, law, parts, joints)
    if name not in LAWS and law.foreign is None and not INTERPRETED:  # Python checks bounds itself
        warnings += law_trial.warnings_of(name, law, gains, joints)
    step = own.type_erased(OPAQUE)
    why = '' if fits else reason(unfit, cast(Any, law.update).py_func)
    of_any_type = Boxed(parts.value, OPAQUE)
    return PreparedLaw(name, gains, parts.memory, step, of_any_type, warnings, law.foreign, why)


def with_gains(before: PreparedLaw, law: Law, gains: Any) -> PreparedLaw | None:
    """A law that was prepared, with other gains and without the compiler.

    Args:
        before: As it was prepared.
        law: The law.
        gains: Its gains.

    Returns:
        None if it must be prepared anew: a custom law is tried with its gains.

    Raises:
        InputError: the theory of the law forbids the gains.
    """
    if gains is before.gains:
        return before
    if before.name not in LAWS:
        return None
    constants = Boxed(gains)
    parts: LawParts = before.law.value
    if typeof(constants) != typeof(parts.gains):  # a list of another length
        return None
    own = Boxed(parts._replace(gains=constants), OPAQUE)
    return before._replace(gains=gains, law=own, warnings=validate_gains(before.name, law, gains))


def _with_arrays(name: str, law: Law, parts: Boxed, joints: int) -> FunctionValue:
    """The step of a law that works with arrays."""
    row, matrix, memory = np.zeros(joints), np.eye(joints), as_arrays(parts.memory.first)
    right = typeof(ControlOutput(row, row, row, memory))
    try:
        update = _compiled(law.update, parts.gains, *_motion(row, matrix), memory, 1e-3)
        wrong = law_trial.wrong_types(update.signature().return_type, right)
        if not wrong:
            motion = _motion(vector(row), vector(matrix))
            return _compiled(stepping(law.update, True), parts, *motion, False, 1e-3)
    except Exception as error:  # Numba raises many kinds
        cause = reason(error, cast(Any, law.update).py_func)
        raise InputError(f'{name}: update does not compile: {cause}') from error
    raise InputError(f'{name}: {wrong}')


def _compiled(function: Any, *example: Any) -> FunctionValue:
    with warnings.catch_warnings(record=True) as said:  # none of code that does not compile
        value = FunctionValue(function, *example)
    for each in said:
        warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    return value


def _motion(row: Array, matrix: Array) -> tuple[Any, ...]:
    """Model, reference and feedback, for their types."""
    return (
        Model(matrix, matrix, row),
        JointReference(row, row, row),
        Feedback(row, row, row, row, matrix, 0.0),
    )
