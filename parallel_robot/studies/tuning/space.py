"""The search space: which gains and parameters of the estimator are varied, and where."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, get_args, get_origin

from parallel_robot_control.contract import Law
from parallel_robot_control.estimation.estimator import EstimatorParameters
from parallel_robot_control.foreign.channel import Gains
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.prepared_law import validate_gains
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.units import rounded
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.fields import (
    Field,
    Parameter,
    PerJoint,
    allowed_words,
    build,
    check,
    parameters,
    plain,
)

# Where one gain is searched: numbers between limits, or alternatives.

ZERO = 0.25  # share of a logarithmic range that is added below it, where the gain is 0
DIGITS = 9  # of a gain that is tried
NEAR = 0.02  # share of a range in which a value is at its end
Value = float | int | str | bool


@dataclass(frozen=True)
class Range:
    """Numbers between two limits."""

    low: float  # smallest value, in the unit of the gain
    high: float  # largest value
    log: bool  # whether they are sampled on a logarithmic scale
    whole: bool = False  # whether they are whole numbers
    # whether 0 is one of them, too, on a logarithmic scale: what is sampled below `low`
    # stands for it. Tried on a cost of at least 1 with six parameters, two objectives and
    # 160 trials, medians of 12: where 0 is best 1.74, of a categorical "zero or not" beside
    # the number 1.65, without zero 2.02; where it is not 1.80, 2.15 and 1.67
    zero: bool = False

    def __contains__(self, value: Any) -> bool:
        if type(value) not in (int, float):
            return False
        return self.low <= value <= self.high or (self.zero and value == 0.0)

    def __str__(self) -> str:
        numbers = f'{self.low:g} to {self.high:g}' + (', logarithmic' if self.log else '')
        return f'0, or {numbers}' if self.zero else numbers

    @property
    def floor(self) -> float:
        """The smallest number that is sampled."""
        return self.low * (self.low / self.high) ** ZERO if self.zero else self.low

    def value(self, sampled: float) -> float:
        """The value that a sampled number stands for, but for last bits, the processor's."""
        if self.zero and sampled < self.low:
            return 0.0
        if self.whole:
            return sampled
        return min(max(rounded(sampled, DIGITS), self.low), self.high)

    def sampled(self, value: float) -> float:
        """A number that stands for a value."""
        return self.floor if self.zero and value == 0.0 else value

    def end(self, value: float) -> float | None:
        """The end of the range at which a value lies; None: it lies inside, or is 0."""
        scale = math.log if self.log else float
        if value <= 0.0 and self.log:
            return None
        place = (scale(value) - scale(self.low)) / (scale(self.high) - scale(self.low))
        if place > 1.0 - NEAR:
            return self.high
        return self.low if place < NEAR else None


@dataclass(frozen=True)
class Choice:
    """Alternatives."""

    values: tuple[Value, ...]

    def __contains__(self, value: Any) -> bool:
        return value in self.values

    def __str__(self) -> str:
        return ', '.join(map(str, self.values))


SPREAD = 30.0  # a gain is varied from its default divided by this to its default times this
BESIDE = {'estimator': EstimatorParameters}  # parameters beside the gains that can be searched


@dataclass(frozen=True)
class Space:
    """What is varied of a law, and of its estimator.

    Gains go by their key, other parameters by that of the configuration, which has a dot.
    """

    law: str  # name of the law
    default: Mapping[str, Any]  # its gains and the other parameters before tuning
    varied: Mapping[str, Range | Choice]  # gains that are varied
    fixed: Mapping[str, Any]  # gains that are not
    # whether gamma2 = 2 gamma1 / (1 + gamma1), without which the theory of the full-order
    # surface forbids the gains
    coupled: bool
    keep: bool  # whether gains that break a condition of the law, of which it warns, are forbidden

    def key(self, name: str) -> str:
        """The key of the configuration."""
        return name if '.' in name else f'{self.law}.{name}'

    def gains(self, chosen: Mapping[str, Value]) -> dict[str, Any]:
        """All gains of the law, and other parameters, when those that are varied are sampled."""
        found: dict[str, Any] = {key: chosen.get(key, self.fixed.get(key)) for key in self.default}
        for key, among in self.varied.items():
            if isinstance(among, Range):
                found[key] = among.value(found[key])
        if self.coupled:
            found['gamma2'] = 2.0 * found['gamma1'] / (1.0 + found['gamma1'])
        return found

    def start(self) -> dict[str, Value] | None:
        """The default as it would be sampled; None if it is outside the space."""
        inside = all(self.default[key] in among for key, among in self.varied.items())
        held = all(self.default[key] == value for key, value in self.fixed.items())
        if not (inside and held):
            return None
        return {
            key: among.sampled(self.default[key])
            if isinstance(among, Range)
            else self.default[key]
            for key, among in self.varied.items()
        }

    def description(self) -> dict[str, Any]:
        """The space as plain data."""
        varied = {key: asdict(among) for key, among in self.varied.items()}
        return {
            'varied': varied,
            'fixed': dict(self.fixed),
            'coupled': self.coupled,
            'keep': self.keep,
        }


def space_of(
    name: str,
    law: Law,
    values: Mapping[str, Any],
    bounds: Mapping[str, Any] | Sequence[str] = (),
    search: Sequence[str] = (),
    keep: bool = True,
) -> Space:
    """The search space of a law.

    A positive gain is varied on a logarithmic scale about its default, and may be 0 where that is
    allowed; one that is limited on both sides is varied between its limits, one that has
    alternatives among them. Gains that are zero, lists and texts are not varied, nor how long a
    foreign law may take.

    Args:
        name: Name of the law.
        law: The law.
        values: The resolved configuration.
        bounds: Gain to a tuple of the ends that replace these ranges, or to a value that fixes it;
            or words ``GAIN=LOW:HIGH``, ``GAIN=VALUE``.
        search: Keys of other parameters that are varied, e.g. ``estimator.bandwidth``, or
            ``estimator`` for all that have a range; those in `bounds` are, too.
        keep: Whether gains that break a condition of the law are forbidden; if those of the
            default break one, they are not.

    Raises:
        InputError: a word is wrong, or no gain is left to be varied.
    """
    gains = {parameter.key: parameter for parameter in parameters(law.Gains)}
    beside = members()
    known = gains | beside
    given = _given(name, known, bounds)
    asked = dict.fromkeys([*_asked(search), *(key for key in given if key in beside)])
    default = {key: values[f'{name}.{key}'] for key in gains} | {k: values[k] for k in asked}
    joints = len(values['joints'])
    judged = Space(name, default, {}, {}, False, keep)
    judged = replace(judged, keep=keep and not objection(judged, law, default, joints))
    varied: dict[str, Range | Choice] = {}
    fixed: dict[str, Any] = {}
    # Not of a law that has only copied the surface: its own theory may differ.
    coupled = law.validate_gains is s_fotsmc.validate_gains and 'gamma2' not in given
    for key, value in default.items():
        if coupled and key == 'gamma2':
            continue
        if law.foreign and key in Gains._fields and key not in given:  # it is how long we wait
            fixed[key] = value
            continue
        zero = not objection(judged, law, {**default, key: 0.0}, joints)
        among = given[key] if key in given else _natural(known[key], value, zero)
        if among is None:
            if key in search:
                raise InputError(
                    f'--search {key}: nothing says between which values; give --bounds {key}=...'
                )
            fixed[key] = value
        elif isinstance(among, Choice) and len(among.values) == 1:
            fixed[key] = among.values[0]
        elif isinstance(among, Range) and among.low == among.high:
            fixed[key] = int(among.low) if among.whole else among.low
        else:
            varied[key] = among
    if not varied:
        raise InputError(f'{name} has no gain to vary; give some by --bounds GAIN=LOW:HIGH')
    return replace(judged, varied=varied, fixed=fixed, coupled=coupled)


def objection(space: Space, law: Law, gains: Mapping[str, Any], joints: int) -> str:
    """Why gains are forbidden; empty if they are not."""
    try:
        warnings = doubts(space, law, gains, joints)
    except InputError as error:
        return str(error)
    return warnings[0] if space.keep and warnings else ''


def doubts(space: Space, law: Law, gains: Mapping[str, Any], joints: int) -> tuple[str, ...]:
    """What a law warns of.

    Raises:
        InputError: the theory of the law forbids the gains, or a value is wrong.
    """
    own = {key: value for key, value in gains.items() if '.' not in key}
    return validate_gains(space.law, law, build(law.Gains, own, f'{space.law}.', joints))


def at_ends(space: Space, gains: Mapping[str, Any], fields: Mapping[str, Field]) -> list[str]:
    """Which gains lie at an end of their range, and how to widen it."""
    found = []
    for key, among in space.varied.items():
        end = among.end(gains[key]) if isinstance(among, Range) else None
        if end is None or not isinstance(among, Range):
            continue
        side = 'lower' if end == among.low else 'upper'
        text = f'{key} = {gains[key]:.4g} is at {end:g}, the {side} end of its range'
        field = fields[key]
        low, high = among.low, among.high
        if side == 'lower':
            low = max(field.low, low / SPREAD if among.log else low - (high - low))
        else:
            high = min(field.high, high * SPREAD if among.log else high + (high - low))
        if (low, high) == (among.low, among.high):
            found.append(f'{text}, beyond which it has no meaning')
        else:
            found.append(f'{text}; widen it by --bounds {key}={low:.3g}:{high:.3g}')
    return found


def members() -> dict[str, Parameter]:
    """Parameters beside the gains that can be searched, by key."""
    return {
        f'{prefix}.{parameter.key}': parameter
        for prefix, group in BESIDE.items()
        for parameter in parameters(group)
    }


def _asked(search: Sequence[str]) -> list[str]:
    """The keys that words of ``--search`` name; a group stands for all of its parameters."""
    found, known = [], members()
    for word in search:
        keys = [key for key in known if word in (key, key.partition('.')[0])]
        if not keys:
            raise UnknownNameError('parameter of --search', word, [*BESIDE, *known])
        found += keys
    return found


def _natural(parameter: Parameter, default: Any, zero: bool) -> Range | Choice | None:
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
    low = max(1.0, math.floor(low)) if whole else low
    return Range(low, high, True, whole, zero and not whole and field.low == 0.0)


def _given(
    name: str, known: Mapping[str, Parameter], bounds: Mapping[str, Any] | Sequence[str]
) -> dict[str, Range | Choice]:
    """Ranges from ends, values or alternatives by gain, or words with these."""
    found: dict[str, Range | Choice] = {}
    pairs = bounds.items() if isinstance(bounds, Mapping) else map(_pair, bounds)
    for gain, ends in pairs:
        key = gain.strip().removeprefix(f'{name}.')
        if key not in known:
            raise UnknownNameError(f'gain of {name}', key, known)
        if key in found:
            raise InputError(f'--bounds names {key} twice')
        values = [*ends] if isinstance(ends, tuple | list) else [ends]
        found[key] = _between(f'--bounds {key}', known[key], [plain(each) for each in values])
    return found


def _pair(word: str) -> tuple[str, list[Any]]:
    """Gain and values of a word ``GAIN=LOW:HIGH``, ``GAIN=VALUE`` or ``GAIN=ONE:ANOTHER``."""
    gain, equals, text = word.partition('=')
    if not equals or not text:
        raise InputError(f'--bounds takes GAIN=LOW:HIGH, not {word!r}')
    parts = (yaml_file.parse_assignments([f'value={part}']) for part in text.split(':'))
    return gain, [part['value'] for part in parts]


def _between(where: str, parameter: Parameter, values: list[Any]) -> Range | Choice:
    kind, field = parameter.type, parameter.field
    kind = float if allowed_words(kind) else kind
    if get_origin(kind) is Literal or kind is bool:
        chosen = tuple(check(where, kind, field, value) for value in values)
        return Choice(tuple(dict.fromkeys(chosen)))
    if kind not in (int, float, PerJoint):
        raise InputError(f'{where}: the gain is not a number')
    if len(values) > 2:
        raise InputError(f'{where} must be LOW:HIGH, not {":".join(map(str, values))}')
    number = int if kind is int else float
    low, high = (check(where, number, field, value) for value in (values[0], values[-1]))
    if low > high:
        raise InputError(f'{where} must begin with the smaller number, not {low:g}:{high:g}')
    endless = not math.isfinite(field.high)
    if low == 0.0 < high and endless and kind is not int:
        return Range(high / SPREAD**2, high, True, zero=True)
    return Range(low, high, low > 0.0 and endless, kind is int)


def unit_of(law: Law) -> dict[str, Field]:
    """Unit and meaning of each gain of a law, and of what can be searched beside them."""
    return {parameter.key: parameter.field for parameter in parameters(law.Gains)} | {
        key: parameter.field for key, parameter in members().items()
    }
