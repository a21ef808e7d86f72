"""The search space: which gains of a law are varied, and between which values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args, get_origin

from parallel_robot_base import assignments
from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_base.fields import Field, Parameter, PerJoint, build, check, parameters
from parallel_robot_control.contract import Law
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.prepared_law import judge

SPREAD = 30.0  # a gain is varied from its default divided by this to its default times this
Value = float | int | str | bool


@dataclass(frozen=True)
class Range:
    """Numbers between two limits.

    Attributes:
        low: Smallest value, in the unit of the gain.
        high: Largest value.
        log: Whether they are sampled on a logarithmic scale.
        whole: Whether they are whole numbers.
    """

    low: float
    high: float
    log: bool
    whole: bool = False

    def __contains__(self, value: Any) -> bool:
        return type(value) in (int, float) and self.low <= value <= self.high

    def __str__(self) -> str:
        return f'{self.low:g} to {self.high:g}' + (', logarithmic' if self.log else '')


@dataclass(frozen=True)
class Choice:
    """Alternatives."""

    values: tuple[Value, ...]

    def __contains__(self, value: Any) -> bool:
        return value in self.values

    def __str__(self) -> str:
        return ', '.join(map(str, self.values))


@dataclass(frozen=True)
class Space:
    """What is varied of a law.

    Attributes:
        law: Name of the law.
        default: Its gains before tuning, by key.
        varied: Gains that are varied.
        fixed: Gains that are not.
        coupled: Whether gamma2 = 2 gamma1 / (1 + gamma1), without which the theory of the
            full-order surface forbids the gains.
    """

    law: str
    default: Mapping[str, Any]
    varied: Mapping[str, Range | Choice]
    fixed: Mapping[str, Any]
    coupled: bool

    def gains(self, chosen: Mapping[str, Value]) -> dict[str, Any]:
        """All gains of the law when the varied ones are chosen."""
        found: dict[str, Any] = {key: chosen.get(key, self.fixed.get(key)) for key in self.default}
        if self.coupled:
            found['gamma2'] = 2.0 * found['gamma1'] / (1.0 + found['gamma1'])
        return found

    def start(self) -> dict[str, Value] | None:
        """The varied gains of the default; None if it is outside the space."""
        inside = all(self.default[key] in among for key, among in self.varied.items())
        held = all(self.default[key] == value for key, value in self.fixed.items())
        return {key: self.default[key] for key in self.varied} if inside and held else None

    def description(self) -> dict[str, Any]:
        """The space as plain data."""
        varied = {key: asdict(among) for key, among in self.varied.items()}
        return {'varied': varied, 'fixed': dict(self.fixed), 'coupled': self.coupled}


def space_of(name: str, law: Law, values: Mapping[str, Any], bounds: Sequence[str]) -> Space:
    """The search space of a law.

    A positive gain is varied on a logarithmic scale about its default, one that is limited on both
    sides between its limits, one that has alternatives among them. Gains that are zero, lists and
    texts are not varied.

    Args:
        name: Name of the law.
        law: The law.
        values: The resolved configuration.
        bounds: Words ``GAIN=LOW:HIGH`` that replace these ranges; ``GAIN=VALUE`` fixes a gain.

    Raises:
        InputError: a word is wrong, or no gain is left to be varied.
    """
    known = {parameter.key: parameter for parameter in parameters(law.Gains)}
    default = {key: values[f'{name}.{key}'] for key in known}
    found = {key: _natural(parameter, default[key]) for key, parameter in known.items()}
    given = _given(name, known, bounds)
    found |= given
    varied: dict[str, Range | Choice] = {}
    fixed: dict[str, Any] = {}
    # Not of a law that has only copied the surface: its own theory may differ.
    coupled = getattr(law, 'judge', None) is s_fotsmc.judge and 'gamma2' not in given
    for key, among in found.items():
        if coupled and key == 'gamma2':
            continue
        if among is None:
            fixed[key] = default[key]
        elif isinstance(among, Choice) and len(among.values) == 1:
            fixed[key] = among.values[0]
        elif isinstance(among, Range) and among.low == among.high:
            fixed[key] = int(among.low) if among.whole else among.low
        else:
            varied[key] = among
    if not varied:
        raise InputError(f'{name} has no gain to vary; give some by --bounds GAIN=LOW:HIGH')
    return Space(name, default, varied, fixed, coupled)


def objection(space: Space, law: Law, gains: Mapping[str, Any], joints: int) -> str:
    """Why gains are forbidden; empty if they are not."""
    try:
        judge(space.law, law, build(law.Gains, gains, f'{space.law}.', joints))
    except InputError as error:
        return str(error)
    return ''


def _natural(parameter: Parameter, default: Any) -> Range | Choice | None:
    """Where a gain is varied unless somebody says otherwise; None: nowhere."""
    kind, field = parameter.type, parameter.field
    if get_origin(kind) is Literal:
        return Choice(get_args(kind))
    if kind is bool:
        return Choice((False, True))
    if kind not in (int, float, PerJoint) or type(default) not in (int, float):
        return None
    whole = kind is int
    if math.isfinite(field.low) and math.isfinite(field.high):
        return Range(field.low, field.high, False, whole)
    if field.low < 0.0 or default <= 0.0:
        return None
    low, high = max(field.low, default / SPREAD), min(field.high, default * SPREAD)
    return Range(max(1.0, math.floor(low)) if whole else low, high, True, whole)


def _given(
    name: str, known: Mapping[str, Parameter], bounds: Sequence[str]
) -> dict[str, Range | Choice]:
    """Ranges from words ``GAIN=LOW:HIGH``, ``GAIN=VALUE`` or ``GAIN=ONE:ANOTHER``."""
    found: dict[str, Range | Choice] = {}
    for word in bounds:
        gain, equals, text = word.partition('=')
        key = gain.strip().removeprefix(f'{name}.')
        if not equals or not text:
            raise InputError(f'--bounds takes GAIN=LOW:HIGH, not {word!r}')
        if key not in known:
            raise UnknownNameError(f'gain of {name}', key, known)
        if key in found:
            raise InputError(f'--bounds names {key} twice')
        found[key] = _between(f'--bounds {key}', known[key], text.split(':'))
    return found


def _between(where: str, parameter: Parameter, parts: list[str]) -> Range | Choice:
    kind, field = parameter.type, parameter.field
    values = [assignments.parse([f'value={part}'])['value'] for part in parts]
    if get_origin(kind) is Literal or kind is bool:
        chosen = tuple(check(where, kind, field, value) for value in values)
        return Choice(tuple(dict.fromkeys(chosen)))
    if kind not in (int, float, PerJoint):
        raise InputError(f'{where}: the gain is not a number')
    if len(values) > 2:
        raise InputError(f'{where} must be LOW:HIGH, not {":".join(parts)}')
    number = int if kind is int else float
    low, high = (check(where, number, field, value) for value in (values[0], values[-1]))
    if low > high:
        raise InputError(f'{where} must begin with the smaller number, not {low:g}:{high:g}')
    return Range(low, high, low > 0.0 and not math.isfinite(field.high), kind is int)


def unit_of(law: Law) -> dict[str, Field]:
    """Unit and meaning of each gain of a law."""
    return {parameter.key: parameter.field for parameter in parameters(law.Gains)}
