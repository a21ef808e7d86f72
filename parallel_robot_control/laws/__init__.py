"""The laws by name. A new law is one module and one line here, and one file in config/laws."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import typeof

from parallel_robot_base import config, plugins
from parallel_robot_base.errors import InputError, UnknownNameError, first_line
from parallel_robot_base.function_value import FirstClass, distinguish
from parallel_robot_control.contract import ControlOutput, Feedback, JointReference, Law
from parallel_robot_control.laws import (
    adaptive_s_fotsmc,
    computed_torque,
    fotsmc,
    nftsmc,
    pid,
    s_fotsmc,
    s_fotsmc_ft,
    s_smc,
    smc,
    smc_k,
    super_twisting,
    trial,
)
from parallel_robot_model.contract import Model

LAWS: dict[str, Law] = {
    # the paper's
    'smc': smc,
    's_smc': s_smc,
    'nftsmc': nftsmc,
    's_fotsmc': s_fotsmc,
    # its ablations: the same without coupling
    'smc_k': smc_k,
    'fotsmc': fotsmc,
    # baselines
    'pid': pid,
    'computed_torque': computed_torque,
    'super_twisting': super_twisting,
    # extensions
    'adaptive_s_fotsmc': adaptive_s_fotsmc,
    's_fotsmc_ft': s_fotsmc_ft,
}


class PreparedLaw(NamedTuple):
    """A law ready to run.

    Attributes:
        name: Key of LAWS, or the name of one's own.
        gains: Its gains.
        memory: Its memory before the first update.
        update: Its compiled update.
        warnings: What the law's theory has against the gains, though they run.
    """

    name: str
    gains: Any
    memory: Any
    update: FirstClass
    warnings: tuple[str, ...]


def available(values: Mapping[str, Any]) -> dict[str, Law]:
    """LAWS and the laws of one's own in a resolved configuration, by name."""
    own: dict[str, Any] = dict(map(plugins.load, values['own_laws']))
    return LAWS | own


def judged(name: str, values: Mapping[str, Any]) -> tuple[Law, Any, tuple[str, ...]]:
    """Take the gains of a law from a resolved configuration; nothing is compiled.

    Returns:
        The law, its gains, and what its theory has against them, though they run.

    Raises:
        UnknownNameError: no such law.
        InputError: a gain is wrong, or the theory of the law forbids the set.
    """
    laws = available(values)
    if name not in laws:
        raise UnknownNameError('law', name, laws)
    law = laws[name]
    gains = config.group(values, law.Gains, name)
    judge = getattr(law, 'judge', None)  # optional in the contract
    try:
        warnings = tuple(f'{name}: {text}' for text in judge(gains)) if judge else ()
    except InputError as error:
        raise InputError(f'{name}: {error}') from None
    except Exception as error:  # whatever the code of somebody else may raise
        raise InputError(f'{name}: judge: {first_line(error)}') from error
    return law, gains, warnings


def prepare(name: str, values: Mapping[str, Any], joints: int = 3) -> PreparedLaw:
    """Take the gains of a law from a resolved configuration and compile the law.

    Raises:
        UnknownNameError: no such law.
        InputError: a gain is wrong, the theory of the law forbids the set, or a law of one's own
            does not compile or does not pass its trial.
    """
    law, gains, warnings = judged(name, values)
    if not hasattr(law.update, 'py_func'):
        raise InputError(f'{name}: update is not compiled: put @kernel before it')
    try:
        memory = law.initial_memory(joints)
        distinguish(gains, memory)
        typeof(memory)
    except Exception as error:
        raise InputError(f'{name}: initial_memory: {first_line(error)}') from error
    try:
        update = _compiled(law, gains, memory, joints)
    except Exception as error:  # Numba has many
        reason = _reason(error, law.update.py_func)
        raise InputError(f'{name}: update does not compile: {reason}') from error
    row = np.zeros(joints)
    if update.signature().return_type != typeof(ControlOutput(row, row, row, memory)):
        raise InputError(
            f'{name}: update must return ControlOutput(torque, sliding_variable, coupled_error, '
            'memory), three float arrays and a memory of the type of initial_memory'
        )
    if name not in LAWS:
        warnings += trial.warnings_of(name, law, gains, joints)
    return PreparedLaw(name, gains, memory, update, warnings)


def _compiled(law: Law, gains: Any, memory: Any, joints: int) -> FirstClass:
    row, matrix = np.zeros(joints), np.eye(joints)
    with warnings.catch_warnings(record=True) as said:  # nothing of what does not compile
        update = FirstClass(
            law.update,
            gains,
            Model(matrix, matrix),
            JointReference(row, row, row),
            Feedback(row, row, row),
            memory,
            1e-3,
        )
    for each in said:
        warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    return update


def _reason(error: Exception, update: Any) -> str:
    """What Numba says of the cause, and of the line; else that of the function."""
    lines = [line.strip() for line in str(error).splitlines()]
    said = [line for line in lines if line and not line.startswith('Failed in ')]
    cause = said[0] if said else type(error).__name__
    if cause.endswith(':'):
        cause = ' '.join(said[:2])
    cause, _, raised = cause.partition('. Raised from ')
    place = re.search(r'^File "(.*)", line (\d+):$', str(error), re.MULTILINE)
    place = place or re.fullmatch(r'(.*) \((\d+)\)', raised or str(getattr(error, 'loc', '')))
    code = update.__code__
    file, line = place.groups() if place else (code.co_filename, code.co_firstlineno)
    return f'{cause} ({Path(file).name}:{line})'
