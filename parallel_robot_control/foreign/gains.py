"""Parameters of an FMU as gains of its law: what it says of them, and the class of gains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_type_hints

from parallel_robot_control.foreign.channel import Gains
from parallel_robot_control.foreign.process import MOST_GAINS
from parallel_robot_model.common.errors import InputError, UnknownNameError, first_line
from parallel_robot_model.configuration.fields import Field, check

FLOATS = ('Real', 'Float64', 'Float32')


def described(file: Path, called: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """What an FMU says of the parameters that are gains; nothing of it is run.

    Args:
        file: The FMU.
        called: Gain to the name of its parameter.

    Returns:
        Gain to its ``variable``, ``start``, ``unit``, ``text``, ``low`` and ``high``, None where
        there is no limit.

    Raises:
        InputError: it cannot be read, has no such parameter, or says of it what is no number.
    """
    if len(called) > MOST_GAINS:
        raise InputError(f'{file}: at most {MOST_GAINS} parameters are gains, not {len(called)}')
    try:
        from fmpy import read_model_description
    except ImportError:
        raise InputError('gains of an FMU need fmpy: pip install fmpy') from None
    try:
        variables = read_model_description(str(file), validate=False).modelVariables
    except Exception as error:  # whatever is in the file
        raise InputError(f'{file} is no FMU: {first_line(error)}') from None
    known = {each.name: each for each in variables if each.causality == 'parameter'}
    return {gain: _described(file, gain, name, known) for gain, name in called.items()}


def _described(file: Path, gain: str, name: str, known: Mapping[str, Any]) -> dict[str, Any]:
    variable = known.get(name)
    if variable is None:
        raise UnknownNameError(f'parameter of {file}', name, known)
    if variable.type not in FLOATS or variable.shape:
        raise InputError(
            f'{file}: {name} is no gain: it is not one number of type Real or Float64'
        )
    declared = variable.declaredType
    said: dict[str, Any] = {
        key: getattr(variable, of) or getattr(declared, of, None)
        for key, of in (('unit', 'unit'), ('low', 'min'), ('high', 'max'))
    }
    try:
        start = float(variable.start)
        low, high = (None if said[key] is None else float(said[key]) for key in ('low', 'high'))
    except (TypeError, ValueError):
        raise InputError(f'{file}: {name} needs a start value that is a number') from None
    field = Field(said['unit'] or '', '', *_limits(low, high))
    check(f'{file}: start of {name}', float, field, start)
    return {
        'variable': name,
        'start': start,
        'unit': said['unit'] or '',
        'text': variable.description or name,
        'low': low,
        'high': high,
    }


def class_of(described: Mapping[str, Mapping[str, Any]], module: str) -> type:
    """The class of the gains of a foreign law: those of any, then its own.

    Args:
        described: See :func:`described`.
        module: What it is called by the compiler, which must differ from all others.
    """
    if not described:
        return Gains
    fields: list[tuple[str, Any]] = [*get_type_hints(Gains, include_extras=True).items()]
    for gain, one in described.items():
        limits = _limits(one['low'], one['high'])
        fields.append((gain, Annotated[float, Field(one['unit'], one['text'], *limits)]))
    made: Any = NamedTuple('Gains', fields)  # type: ignore[misc]
    defaults = Gains._field_defaults | {gain: one['start'] for gain, one in described.items()}
    made._field_defaults, made.__new__.__defaults__ = defaults, tuple(defaults.values())
    made.__module__ = module
    kind: type = made
    return kind


def _limits(low: float | None, high: float | None) -> tuple[float, float]:
    return -math.inf if low is None else low, math.inf if high is None else high
