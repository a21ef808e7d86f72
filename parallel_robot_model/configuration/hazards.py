"""Hazards: what happens to a loop besides its motion, and when; as people write it.

In a file ``{what: encoder_frozen, joint: joint1, at: 6, for: 0.2}``; typed, and in bags and
parameters of nodes, ``encoder_frozen joint joint1 at 6.0 for 0.2``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from parallel_robot_model.common.errors import InputError, UnknownNameError, printable
from parallel_robot_model.configuration.fields import Field, check

KEY = 'hazards'
WHAT, JOINT, SIZE, LIMIT, DELAY = 'what', 'joint', 'size', 'limit', 'delay'
SHARE, AT, FOR = 'share', 'at', 'for'
NUMBERS = {
    SIZE: Field('', ''),
    LIMIT: Field('N m', '', 0.0),
    DELAY: Field('s', '', 0.0, 1.0),
    SHARE: Field('', '', 0.0, 1.0),
    AT: Field('s', '', 0.0, 1e6),
    FOR: Field('s', '', 0.0, 1e6),
}
LASTS = (AT, FOR)
MOST = 1000  # of a run


class Kind(NamedTuple):
    """A kind of hazard: what must be said of one, and what it is."""

    words: tuple[str, ...]
    text: str


KINDS = {
    'commands_lost': Kind(LASTS, 'no command reaches the motors'),
    'motors_off': Kind(LASTS, 'the motors have no torque'),
    'motor_dead': Kind((JOINT, *LASTS), 'one motor has no torque'),
    'motors_clipped': Kind((LIMIT, *LASTS), 'the motors give no more than a limit [N m]'),
    'brakes': Kind(LASTS, 'brakes hold the robot, the motors have no torque'),
    'stranger': Kind((SIZE, *LASTS), 'commands of another node act, a torque [N m] per joint'),
    'states_lost': Kind(LASTS, 'no state reaches the controller'),
    'states_frozen': Kind(LASTS, 'states say what they said at its begin, with new stamps'),
    'encoder_frozen': Kind((JOINT, *LASTS), 'one position stays, its velocity is zero'),
    'encoder_jump': Kind((JOINT, SIZE, *LASTS), 'one position is wrong by a size [rad]'),
    'velocity_zero': Kind((JOINT, *LASTS), 'one velocity is zero'),
    'velocity_nan': Kind((JOINT, *LASTS), 'one velocity is not a number: no valid state'),
    'states_late': Kind((DELAY, *LASTS), 'states come late, as their stamps tell'),
    'states_ahead': Kind((SIZE, *LASTS), 'stamps of states are ahead by a size [s]'),
    'references_lost': Kind(LASTS, 'no reference reaches the controller'),
    'controller_paused': Kind(LASTS, 'the controller stands still'),
    'controller_restarted': Kind(LASTS, 'the controller is away, and knows nothing afterwards'),
    'plant_paused': Kind(LASTS, 'states, poses and commands are lost: a link is down'),
    'states_dropped': Kind((SHARE, *LASTS), 'a share of the states is never sent, at random'),
    'clear_fault': Kind((AT,), 'somebody calls ~/clear_fault'),
}


class Hazard(NamedTuple):
    """Something that happens to the loop."""

    what: str  # its kind
    at: float  # when it begins, since the start of the motion [s]
    lasts: float = 0.0  # how long [s]
    joint: str = ''  # name of the joint; empty where it is about all
    size: float = 0.0  # size, limit, delay or share, in the unit of the kind

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.at + self.lasts

    def samples(self, period: float) -> tuple[int, int]:
        """Index of its first sample and of the first one after it; `period` in s."""
        return round(self.at / period), round(self.end / period)

    @property
    def told(self) -> str:
        """The hazard for people: what, and when."""
        when = f'from {self.at:g} to {self.end:g} s' if self.lasts else f'at {self.at:g} s'
        return f'{self.what} {self.joint} {when}'.replace('  ', ' ')

    def __str__(self) -> str:
        """The hazard as it is typed."""
        said = {JOINT: self.joint, SIZE: self.size, LIMIT: self.size, DELAY: self.size}
        said |= {SHARE: self.size, AT: self.at, FOR: self.lasts}
        return ' '.join([self.what, *(f'{word} {said[word]}' for word in KINDS[self.what].words)])


def parse(given: Any) -> tuple[Hazard, ...]:
    """Read hazards, each a text or a mapping.

    Raises:
        InputError: it is no list, one is no hazard, or there are too many.
    """
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InputError(f'{KEY} must be a list, not {printable(given)}', KEY)
    if len(given) > MOST:
        raise InputError(f'{KEY} must be at most {MOST}, not {len(given)}', KEY)
    try:
        return tuple(_hazard(f'{KEY}[{i}]', each) for i, each in enumerate(given))
    except InputError as error:
        error.key = KEY
        raise


def texts(given: Any) -> list[str]:
    """Hazards as texts in their one form, from texts or mappings; see :func:`parse`."""
    return [*map(str, parse(given))]


def checked(given: Any, joints: Sequence[str], period: float) -> tuple[Hazard, ...]:
    """Hazards that can happen to a loop.

    Args:
        given: See :func:`parse`.
        joints: Names of its joints.
        period: Of its samples [s].

    Raises:
        InputError: one is no hazard, or not of this loop.
    """
    hazards = parse(given)
    for i, hazard in enumerate(hazards):
        key = f'{KEY}[{i}]'
        if hazard.joint and hazard.joint not in joints:
            raise UnknownNameError(f'{JOINT} of {key}', hazard.joint, joints, KEY)
        first, end = hazard.samples(period)
        if FOR in KINDS[hazard.what].words and end <= first:
            raise InputError(
                f'{key}: {FOR} must be at least one period, {period:g} s, not {hazard.lasts:g}',
                KEY,
            )
    return hazards


def _hazard(key: str, given: Any) -> Hazard:
    """One hazard."""
    what, said = _said(key, given)
    if what not in KINDS:
        raise UnknownNameError(f'value of {key}', what, KINDS)
    needed = KINDS[what].words
    for word in said:
        if word not in needed:
            known = ', '.join(needed)
            raise InputError(f'{key}: {what} takes {known}, not {printable(word)!r}')
    for word in needed:
        if word not in said:
            raise InputError(f'{key}: {what} needs {word}')
    numbers = {
        word: check(f'{key}.{word}', float, NUMBERS[word], value)
        for word, value in said.items()
        if word != JOINT
    }
    at, lasts = numbers.pop(AT), numbers.pop(FOR, 0.0)
    joint = check(f'{key}.{JOINT}', str, Field('', ''), said.get(JOINT, ''))
    return Hazard(what, at, lasts, joint, *numbers.values())


def _said(key: str, given: Any) -> tuple[str, dict[str, Any]]:
    """Kind of a hazard, and what is said of it, word by word."""
    if isinstance(given, Mapping):
        said = dict(given)
        return check(f'{key}.{WHAT}', str, Field('', ''), said.pop(WHAT, '')), said
    what, *words = check(key, str, Field('', ''), given).split() or ['']
    if len(words) % 2 or len({*words[::2]}) < len(words[::2]):
        raise InputError(f'{key} must be like "commands_lost at 4.0 for 2.0", not {given!r}')
    return what, {
        word: text if word == JOINT else _number(text)
        for word, text in zip(words[::2], words[1::2], strict=True)
    }


def _number(text: str) -> Any:
    """A number, or a text that is none."""
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) and '_' not in text else text
