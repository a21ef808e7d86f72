"""Typed groups of parameters: a NamedTuple whose annotations carry unit, meaning and range."""

from __future__ import annotations

import copy
import functools
import math
import os
import types
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    NewType,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from parallel_robot_model.common.errors import InputError, UnknownNameError, distinct_texts
from parallel_robot_model.common.units import Array, JointUnits
from parallel_robot_model.configuration.plain_data import with_location

Value = bool | int | float | str | list[int] | list[float] | list[str]
Group = TypeVar('Group')  # a NamedTuple
Configured = TypeVar('Configured', bound='Groups')


# One number for each actuated joint; in files, a single number applies to all of them.
PerJoint = NewType('PerJoint', tuple[float, ...])
PerLink = NewType(
    'PerLink', tuple[float, ...]
)  # a number, for all links, until their robot is known


class Field(NamedTuple):
    """What a parameter means; stands in the annotation: ``Annotated[float, Field('m', ...)]``."""

    unit: str  # unit of the value
    description: str  # meaning in a few words
    low: float = -math.inf  # smallest value
    high: float = math.inf  # largest value
    neutral: float = math.nan  # value at which it changes nothing of an ideal plant, if it can
    untrue: bool = False  # whether any other makes the measured joints differ from the true ones


class Parameter(NamedTuple):
    """One parameter of a group: its key in the files, its type and its meaning."""

    key: str
    type: Any
    field: Field


def parameters(group: type) -> tuple[Parameter, ...]:
    """List the parameters of a group; a trailing underscore (``lambda_``) is not in the key."""
    return _parameters(group)


@functools.cache
def _parameters(group: Any) -> tuple[Parameter, ...]:
    described = []
    for name, hint in get_type_hints(group, include_extras=True).items():
        if get_origin(hint) is not Annotated:
            raise TypeError(f'{group.__name__}.{name} needs Annotated[type, Field(...)]')
        kind, field = get_args(hint)
        described.append(Parameter(name.rstrip('_'), kind, field))
    return tuple(described)


def untrue_keys(declared: Declared) -> list[str]:
    """Keys of the parameters by which the measured joints differ from the true ones."""
    return [
        f'{prefix}.{parameter.key}'
        for prefix, group in declared
        for parameter in parameters(group)
        if parameter.field.untrue
    ]


def is_active(group: Any) -> bool:
    """Whether any of the parameters that have a neutral value has another one."""
    return any(
        np.any(np.not_equal(value, parameter.field.neutral))
        for parameter, value in zip(parameters(type(group)), cast(Any, group), strict=True)
        if not math.isnan(parameter.field.neutral)
    )


def neutral(group: Group) -> Group:
    """A group whose parameters change nothing, where they have a value at which they do not."""
    return type(group)(
        *(
            value
            if math.isnan(parameter.field.neutral)
            else PerJoint((parameter.field.neutral,) * len(value))
            if parameter.type is PerJoint
            else parameter.field.neutral
            for parameter, value in zip(parameters(type(group)), cast(Any, group), strict=True)
        )
    )


def defaults(group: type, prefix: str) -> dict[str, Any]:
    """Defaults of a group by key, for a group that exists in code alone.

    Raises:
        InputError: a field has no default.
    """
    given = getattr(group, '_field_defaults', {})
    values = {name.rstrip('_'): value for name, value in given.items()}
    for parameter in parameters(group):
        if parameter.key not in values:
            raise InputError(f'{prefix}{parameter.key} has no default')
    return {f'{prefix}{key}': plain(value) for key, value in values.items()}


def build(
    group: type[Group], values: Mapping[str, Any], prefix: str = '', joints: int | None = None
) -> Group:
    """Make a group of parameters from plain values, checked one by one.

    Args:
        group: The NamedTuple to make.
        values: Key to value, without the prefix; exactly the keys of the group.
        prefix: Prefix of the key in messages, e.g. ``'friction.'``.
        joints: Number of the actuated joints, where the group has values per joint.

    Returns:
        The group; integers given for floats and NumPy's numbers are converted, lists and arrays
        become tuples.

    Raises:
        UnknownNameError: a key that the group does not have.
        InputError: a key is missing, or a value has the wrong type, is not finite or out of range.
    """
    declared = parameters(group)
    keys = [parameter.key for parameter in declared]
    for key in values:
        if key not in keys:
            known_keys = [prefix + each for each in keys]
            raise UnknownNameError('parameter', prefix + key, known_keys, prefix + key)
    missing = [prefix + key for key in keys if key not in values]
    if missing:
        raise InputError(f'parameter {missing[0]} is missing')
    return group(
        *(check(prefix + p.key, p.type, p.field, values[p.key], joints) for p in declared)
    )


@functools.cache
def allowed_words(kind: Any) -> tuple[str, ...]:
    """The words that a parameter takes in place of a number; none for most."""
    parts = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else ()
    return tuple(word for part in parts if get_origin(part) is Literal for word in get_args(part))


def plain(value: Any) -> Any:
    """A value as the files have it: numbers, texts and lists, nothing of NumPy, no paths."""
    if type(value) in (float, int, str, bool):
        return value
    if isinstance(value, np.floating):  # lists would keep other precisions as NumPy's
        return float(value)
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def check(name: str, kind: Any, field: Field, value: Any, joints: int | None = None) -> Any:
    """Return `value` as `kind`, or raise InputError with a line that names both."""
    value = plain(value)
    if kind is float and type(value) is float:  # most are
        _check_range(name, field, value)
        return value
    if kind is PerJoint:
        if joints is not None:
            return _check_per_joint(name, field, value, joints)
        kind = tuple[float, ...]
    if kind is PerLink:
        listed = isinstance(value, Sequence) and not isinstance(value, str)
        kind = tuple[float, ...] if listed else float
    if get_origin(kind) is tuple:
        items = get_args(kind)
        length = None if items[-1] is Ellipsis else len(items)
        wanted = f'a list of {f"{length} " if length else ""}{_noun(items[0])}s'
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise InputError(f'{name} must be {wanted}, not {value!r}', name)
        if length is not None and len(value) != length:
            raise InputError(f'{name} must be {wanted}, not {len(value)}', name)
        return tuple(check(f'{name}[{i}]', items[0], field, item) for i, item in enumerate(value))
    if get_origin(kind) is Literal:
        if value is False and 'off' in get_args(kind):
            return 'off'  # YAML reads an unquoted off as false
        if value not in get_args(kind):
            choices = map(str, get_args(kind))
            raise UnknownNameError(f'value of {name}', str(value), choices, name)
        return value
    if allowed_words(kind):
        if value in allowed_words(kind):
            return value
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            known = ', '.join(allowed_words(kind))
            raise InputError(f'{name} must be a number or one of {known}, not {value!r}', name)
        kind = float
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value) if abs(value) < 1e300 else math.inf
    if type(value) is not kind:
        raise InputError(f'{name} must be {_article(kind)}, not {value!r}', name)
    if kind in (int, float):
        _check_range(name, field, value)
    return value


def _check_per_joint(name: str, field: Field, value: Any, joints: int) -> PerJoint:
    """One number for each joint; a single one applies to all of them."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return PerJoint((check(name, float, field, value),) * joints)
    if len(value) != joints:
        wanted = f'a number or a list of {joints} numbers, one for each joint'
        raise InputError(f'{name} must be {wanted}, not {len(value)}', name)
    return PerJoint(
        tuple(check(f'{name}[{i}]', float, field, item) for i, item in enumerate(value))
    )


def _check_range(name: str, field: Field, value: float) -> None:
    unit = f' {field.unit}' if field.unit else ''
    if not abs(value) < 1e300:  # also NaN
        raise InputError(f'{name} must be finite, not {value}', name)
    if not field.low <= value <= field.high:
        given, _ = distinct_texts(value, field.low if value < field.low else field.high, 6)
        if field.high == math.inf:
            wanted = f'at least {field.low:g}{unit}'
        elif field.low == -math.inf:
            wanted = f'at most {field.high:g}{unit}'
        else:
            wanted = f'from {field.low:g} to {field.high:g}{unit}'
        raise InputError(f'{name} must be {wanted}, not {given}', name)


def _noun(kind: Any) -> str:
    names = {float: 'number', int: 'whole number', str: 'text', bool: 'true or false'}
    return names[kind]


def _article(kind: Any) -> str:
    return _noun(kind) if kind in (str, bool) else f'a {_noun(kind)}'


# Typed groups of a configuration: each package declares its own; built once, at the edge.

Declared = Iterable[tuple[str, Any]]  # prefix and type of each group; '': keys without a dot


class Groups:
    """Typed groups of a resolved configuration; each is built and checked when it is asked for."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Hold the values by dotted key; those that no group declares are left to others."""
        self.values = values
        self._built: dict[tuple[str, Any], Any] = {}

    def at(self, prefix: str, kind: type[Group]) -> Group:
        """The group of a type under a prefix; '': keys without a dot.

        Raises:
            InputError: a value is missing or wrong; it says where that stands.
        """
        if (prefix, kind) not in self._built:
            start = f'{prefix}.' if prefix else ''
            keys = [start + parameter.key for parameter in parameters(kind)]
            own = {key.removeprefix(start): self.values[key] for key in keys if key in self.values}
            given = self.values.get('joints')
            joints = len(given) if isinstance(given, list) else None
            with with_location(self.values):
                self._built[prefix, kind] = build(kind, own, start, joints)
        group_there: Group = self._built[prefix, kind]
        return group_there

    def check(self, declared: Declared) -> None:
        """Build groups, several of which may share a prefix, to find what is wrong in them.

        Raises:
            InputError: a value is missing or wrong.
        """
        for prefix, kind in declared:
            self.at(prefix, kind)

    def with_parts(self: Configured, **parts: Any) -> Configured:
        """The same with other parts, by the names of the properties.

        Parts that were made of the former ones, `values` and `at` stay as they are.

        Raises:
            TypeError: a part is computed anew each time, and cannot be another one.
        """
        for name in parts:
            if isinstance(getattr(type(self), name), property):
                raise TypeError(f'{name} follows from other parts')
        made = copy.copy(self)
        made.__dict__.update(parts)
        return made


class _Grouped:
    """A property of a class of groups: its group of a type."""

    def __init__(self, prefix: str, kind: Any) -> None:
        self.declared = prefix, kind

    def __get__(self, groups: Groups | None, _: type) -> Any:
        return self if groups is None else groups.at(*self.declared)


def grouped(prefix: str, kind: type[Group]) -> Group:
    """A property of a class of groups that gives its group of a type, which is declared so."""
    return cast(Any, _Grouped(prefix, kind))


def declared_in(owner: type[Groups]) -> list[tuple[str, Any]]:
    """Prefix and type of the groups that a class declares, without those of its bases."""
    return [each.declared for each in vars(owner).values() if isinstance(each, _Grouped)]


def group(values: Mapping[str, Any], kind: type[Group], prefix: str) -> Group:
    """One group alone, see :meth:`Groups.at`.

    Raises:
        InputError: a value is missing or wrong; it says where that stands.
    """
    return Groups(values).at(prefix, kind)


# Units of the parameters of a robot's joints.

PHASE = 'disturbance.phase'  # an angle of all joints
ROBOTS = ('robot', 'true_robot')  # of whose parameters some are per joint, others geometry


def joint_field(
    key: str, parameter: Parameter, units: JointUnits, motions: Collection[str] = ()
) -> Field:
    """What a parameter means, with the unit of the joints that there are.

    Args:
        key: Its key.
        parameter: The parameter.
        units: Units of the joints.
        motions: Names of motions, whose angles are those of the pose.
    """
    group, field = key.partition('.')[0], parameter.field
    of_robot = group in ROBOTS and parameter.type is not PerJoint
    if of_robot or group in motions or key == PHASE:
        return field
    return field._replace(unit=units.of(field.unit))


# Zero angles of the encoders that are known, which are taken off the measured positions.

ESTIMATOR = 'estimator'  # prefix of their group
ZeroAngle = Annotated[
    PerJoint,
    Field(
        'rad',
        'zero angle that is taken off the measured positions, as `calibrate` finds it',
        untrue=True,
    ),
]


class ZeroAngles(NamedTuple):
    """The part of the estimator's parameters that every node needs that looks at positions."""

    zero_angle: ZeroAngle


def corrected(values: Mapping[str, Any], position: Array) -> Array:
    """Positions of the joints as the controller takes them.

    Args:
        values: A resolved configuration, perhaps that of a bag.
        position: Measured positions [rad], shape (N, n).

    Raises:
        InputError: ``estimator.zero_angle`` is wrong.
    """
    return np.asarray(position - given_zero_angles(values), np.float64)


def given_zero_angles(values: Mapping[str, Any]) -> Array:
    """Zero angles that are known [rad], shape (n,).

    Raises:
        InputError: ``estimator.zero_angle`` is wrong.
    """
    return np.array(group(values, ZeroAngles, ESTIMATOR).zero_angle)
