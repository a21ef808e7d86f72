"""An uncertain parameter: which values it takes, and the value at a point of the unit cube."""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration.fields import Field, check

ABSOLUTE, RELATIVE, FACTOR = ('low', 'high'), ('relative',), ('factor',)
FORMS: dict[str, tuple[tuple[str, ...], ...]] = {  # distribution to the ways of giving it
    'uniform': (ABSOLUTE, RELATIVE, FACTOR),
    'log_uniform': (ABSOLUTE, FACTOR),
    'normal': (('mean', 'std'), ('std',), RELATIVE),
    'choice': (('values',),),
}
NUMBER = Field('', '')
SMALLEST = 2.0**-33  # a point is kept this far from 0 and 1, where a normal value is infinite


@dataclass(frozen=True)
class Uncertainty:
    """The distribution of one parameter."""

    key: str  # key of the parameter
    distribution: str  # key of FORMS
    given: Mapping[str, Any]  # what the distribution is given by, see FORMS, already checked
    common: bool = False  # whether one draw holds for all entries of a list


def parse(key: str, entry: Any) -> Uncertainty:
    """Read an uncertainty from a study.

    Args:
        key: Key of the parameter.
        entry: ``distribution``, what it is given by, and ``common`` or not.

    Raises:
        InputError: something in it is wrong.
    """
    try:
        return _parsed(f'uncertainty: {key}', key, entry)
    except InputError as error:
        error.key = f'uncertainty.{key}'
        raise


def _parsed(name: str, key: str, entry: Any) -> Uncertainty:
    if not isinstance(entry, Mapping):
        raise InputError(f'{name} must be {{distribution: ..., ...}}, not {entry!r}')
    given = dict(entry)
    distribution = given.pop('distribution', None)
    if distribution not in FORMS:
        raise UnknownNameError(f'distribution of {name}', str(distribution), FORMS)
    common = check(f'{name}: common', bool, NUMBER, given.pop('common', False))
    forms = FORMS[distribution]
    if not any(set(given) == set(form) for form in forms):
        ways = ', or '.join(' and '.join(form) for form in forms)
        what = ', '.join(map(str, given)) or 'nothing'
        raise InputError(f'{name}: {distribution} takes {ways}, not {what}')
    return Uncertainty(key, distribution, _checked(name, distribution, given), common)


def _checked(name: str, distribution: str, given: dict[str, Any]) -> dict[str, Any]:
    """What a distribution is given by, converted and checked."""
    found: dict[str, Any] = {}
    for word, value in given.items():
        where = f'{name}: {word}'
        if word == 'values':
            if not isinstance(value, list) or not value:
                raise InputError(f'{where} must be a list of values, not {value!r}')
            found[word] = value
        elif word == 'factor':
            found[word] = check(where, tuple[float, float], NUMBER, value)
        else:  # one for each entry of a list, or for all
            several = isinstance(value, list) and value
            numbers = [check(where, float, NUMBER, each) for each in (several or [value])]
            found[word] = numbers if several else numbers[0]
            if word in ('relative', 'std') and not min(numbers) > 0.0:
                raise InputError(f'{where} must be positive, not {min(numbers):g}')
    if len(entries(found)) > 1:
        raise InputError(f'{name}: the lists {" and ".join(found)} must have one length')
    for k in range(max(entries(found), default=1)):
        each = of_entry(found, k)
        low, high = each.get('factor', (each.get('low', 0.0), each.get('high', 1.0)))
        if not low < high:
            raise InputError(f'{name}: low must be below high, not {low:g} and {high:g}')
        if distribution == 'log_uniform' and not low > 0.0:
            raise InputError(f'{name}: log_uniform needs positive values, not {low:g}')
    return found


def entries(given: Mapping[str, Any]) -> set[int]:
    """Lengths of what is given entry by entry of a list."""
    return {len(each) for key, each in given.items() if key != 'values' and type(each) is list}


def of_entry(given: Mapping[str, Any], k: int) -> dict[str, Any]:
    """What is given for an entry of a list."""
    return {key: each[k] if type(each) is list else each for key, each in given.items()}


def dimensions(uncertainty: Uncertainty, nominal: Any) -> int:
    """How many draws a parameter takes: one for each entry of a list, unless they are common.

    Args:
        uncertainty: The distribution.
        nominal: Value of the parameter without uncertainty.

    Raises:
        InputError: the distribution does not fit the value.
    """
    name, place = f'uncertainty: {uncertainty.key}', f'uncertainty.{uncertainty.key}'
    if uncertainty.distribution == 'choice':
        return 1
    numbers = nominal if isinstance(nominal, list) else [nominal]
    if not numbers or not all(type(number) in (int, float) for number in numbers):
        raise InputError(
            f'{name} is {nominal!r}; {uncertainty.distribution} is for numbers', place
        )
    if uncertainty.given.keys() & {*RELATIVE, *FACTOR} and not any(numbers):
        raise InputError(f'{name}: a share of 0 is 0; give low and high, or mean and std', place)
    lengths = entries(uncertainty.given)
    if lengths and lengths != {len(nominal) if isinstance(nominal, list) else 0}:
        raise InputError(f'{name} is {nominal!r}, no list of {max(lengths)} numbers', place)
    return 1 if uncertainty.common else len(numbers)


def value(uncertainty: Uncertainty, nominal: Any, points: Sequence[float]) -> Any:
    """The value of a parameter.

    Args:
        uncertainty: The distribution.
        nominal: Value of the parameter without uncertainty.
        points: One point in [0, 1) for each dimension.
    """
    if uncertainty.distribution == 'choice':
        values = uncertainty.given['values']
        return values[int(points[0] * len(values))]
    if not isinstance(nominal, list):
        return _number(uncertainty, nominal, points[0])
    each = [points[0]] * len(nominal) if uncertainty.common else points
    return [
        _number(replace(uncertainty, given=of_entry(uncertainty.given, k)), *pair)
        for k, pair in enumerate(zip(nominal, each, strict=True))
    ]


def extremes(uncertainty: Uncertainty, nominal: Any) -> list[Any]:
    """Values that a parameter may come to: both ends of its range, or the choices.

    A normal distribution has no ends: its mean.

    Args:
        uncertainty: The distribution.
        nominal: Value of the parameter without uncertainty.
    """
    if uncertainty.distribution == 'choice':
        return list(uncertainty.given['values'])
    points = (0.5,) if uncertainty.distribution == 'normal' else (0.0, 1.0)
    return [value(uncertainty, nominal, [p] * dimensions(uncertainty, nominal)) for p in points]


def columns(uncertainty: Uncertainty, nominal: Any, drawn: Any) -> dict[str, float | str]:
    """A drawn value as columns of a table, one for each dimension.

    Of a list with a common draw, it is the first entry.

    Args:
        uncertainty: The distribution.
        nominal: Value of the parameter without uncertainty.
        drawn: Its value in a run.
    """
    key = uncertainty.key
    if uncertainty.distribution == 'choice':
        return {key: float(drawn) if is_numeric(uncertainty) else json.dumps(drawn)}
    if not isinstance(nominal, list):
        return {key: drawn}
    if uncertainty.common:
        return {key: drawn[0]}
    return {f'{key}[{i}]': number for i, number in enumerate(drawn)}


def is_numeric(uncertainty: Uncertainty) -> bool:
    """Whether the values are numbers; otherwise tables hold them as JSON."""
    return all(type(value) in (int, float) for value in uncertainty.given.get('values', ()))


def _number(uncertainty: Uncertainty, nominal: float, point: float) -> float:
    """One number at a point in [0, 1)."""
    given = uncertainty.given
    if uncertainty.distribution == 'normal':
        mean = given.get('mean', float(nominal))
        std = given['std'] if 'std' in given else given['relative'] * abs(nominal)
        inside = min(max(point, SMALLEST), 1.0 - SMALLEST)
        return float(mean + std * statistics.NormalDist().inv_cdf(inside))
    if 'relative' in given:
        low, high = nominal * (1.0 - given['relative']), nominal * (1.0 + given['relative'])
    elif 'factor' in given:
        low, high = (nominal * factor for factor in given['factor'])
    else:
        low, high = given['low'], given['high']
    if uncertainty.distribution == 'log_uniform':
        return float(low * (high / low) ** point) if low else 0.0
    return float(low + (high - low) * point)
