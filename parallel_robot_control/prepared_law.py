"""A law with its gains, checked and compiled."""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple, cast

import numpy as np
from numba import typeof

from parallel_robot_control import law_output, law_trial
from parallel_robot_control.array_law import ArrayLaw, update_of_arrays
from parallel_robot_control.contract import ControlOutput, Feedback, JointReference, Law
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import InputError, first_line
from parallel_robot_model.compiler import (
    INTERPRETED,
    Boxed,
    FirstClass,
    as_arrays,
    as_vectors,
    reason,
    vector,
)
from parallel_robot_model.processes.custom_module import RAISED
from parallel_robot_model.processes.tuple_classes import distinguish
from parallel_robot_model.robots.contract import Model


class PreparedLaw(NamedTuple):
    """A law ready to run.

    Attributes:
        name: Key of LAWS, or the name of a custom law.
        gains: Its gains.
        memory: Its memory before the first update.
        update: Its compiled update.
        constants: What its update takes as gains.
        warnings: Objections of the theory to gains that are accepted all the same.
    """

    name: str
    gains: Any
    memory: Any
    update: FirstClass
    constants: Any
    warnings: tuple[str, ...]


def judge(name: str, law: Law, gains: Any) -> tuple[str, ...]:
    """Ask a law to check its gains.

    Returns:
        Warnings.

    Raises:
        InputError: the theory of the law forbids them.
    """
    of_law = getattr(law, 'judge', None)  # optional in the contract
    try:
        return tuple(f'{name}: {text}' for text in of_law(gains)) if of_law else ()
    except InputError as error:
        raise InputError(f'{name}: {error}', name) from None
    except RAISED as error:
        raise InputError(f'{name}: judge: {first_line(error)}') from error


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
    warnings = judge(name, law, gains)
    if not hasattr(law.update, 'py_func'):
        raise InputError(f'{name}: update is not compiled: put @kernel before it')
    try:
        memory = law.initial_memory(joints)
        distinguish(type(gains), type(memory))
        typeof(memory)
    except RAISED as error:
        raise InputError(f'{name}: initial_memory: {first_line(error)}') from error
    made = _with_vectors(law, gains, memory, joints)
    if made is None:
        made = _with_arrays(name, law, gains, memory, joints)
    if name not in LAWS:
        warnings += law_trial.warnings_of(name, law, gains, joints)
    return PreparedLaw(name, gains, *made, warnings)


def renewed(before: PreparedLaw, law: Law, gains: Any) -> PreparedLaw | None:
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
    if typeof(constants) != typeof(before.constants):  # a list of another length
        return None
    return before._replace(
        gains=gains, constants=constants, warnings=judge(before.name, law, gains)
    )


def _with_vectors(
    law: Law, gains: Any, memory: Any, joints: int
) -> tuple[Any, FirstClass, Any] | None:
    """Memory, update and its gains, for vectors; None if the update needs arrays."""
    memory = as_vectors(memory)
    row, matrix = vector(np.zeros(joints)), vector(np.eye(joints))
    constants = Boxed(gains)
    try:
        update = _compiled(law.update, constants, row, matrix, memory)
    except Exception:  # if it is wrong with arrays, too, that is said of it
        return None
    wanted = ControlOutput(row, row, row, memory)
    fits = INTERPRETED or update.signature().return_type == typeof(wanted)
    return (memory, update, constants) if fits else None


def _with_arrays(
    name: str, law: Law, gains: Any, memory: Any, joints: int
) -> tuple[Any, FirstClass, Any]:
    """Memory, update and its gains, for arrays.

    Raises:
        InputError: the update does not compile or returns something else.
    """
    row, matrix, memory = np.zeros(joints), np.eye(joints), as_arrays(memory)
    try:
        update = _compiled(law.update, Boxed(gains), row, matrix, memory)
    except Exception as error:  # Numba raises many kinds
        cause = reason(error, cast(Any, law.update).py_func)
        raise InputError(f'{name}: update does not compile: {cause}') from error
    right = typeof(ControlOutput(row, row, row, memory))
    if wrong := law_output.wrong_types(update.signature().return_type, right):
        raise InputError(f'{name}: {wrong}')
    constants = Boxed(ArrayLaw(update, Boxed(gains)))
    converted = _compiled(update_of_arrays, constants, vector(row), vector(matrix), memory)
    return memory, converted, constants


def _compiled(function: Any, gains: Any, row: Array, matrix: Array, memory: Any) -> FirstClass:
    with warnings.catch_warnings(record=True) as said:  # none of code that does not compile
        update = FirstClass(
            function,
            gains,
            Model(matrix, matrix, row),
            JointReference(row, row, row),
            Feedback(row, row, row, row),
            memory,
            1e-3,
        )
    for each in said:
        warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    return update
