"""Units and arrays: joints are in rad and N m, slides in m and N, stamps in whole nanoseconds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000  # in one second
TURN = 2.0 * math.pi  # rad, an angle beyond which may be in degrees
DEGREES = 'degrees?'  # of which it is a doubt
OF_JOINTS = 'unit of the joints'  # key of diagnostics, where it is not rad

LINEAR = (  # how units of a slide follow from those of a hinge
    (re.compile(r'\(N m\)|\bN m\b'), 'N'),
    (re.compile(r'\bkg m\^2'), 'kg'),
    (re.compile(r'\b([mµ]?)rad(?![a-z])'), r'\1m'),
)
KEYS = {'rad': 'm', 'urad': 'um', 'nm': 'n', 'rad2': 'm2', 'nm2': 'n2'}  # in names of columns
ROTATION = 'rotation'  # in names of angles that are none of joints
WORD = re.compile(rf'(?<![^_])({"|".join(KEYS)})(?![^_])')

# Exponents of the base units kg, m, s, A, K, mol, cd, rad.
BASES = {
    's': {'s': 1}, 'm': {'m': 1}, 'kg': {'kg': 1}, 'rad': {'rad': 1}, 'Hz': {'s': -1},
    'm/s': {'m': 1, 's': -1}, 'm/s^2': {'m': 1, 's': -2},
    'rad/s': {'rad': 1, 's': -1}, 'rad/s^2': {'rad': 1, 's': -2},
    'N': {'kg': 1, 'm': 1, 's': -2}, 'N m': {'kg': 1, 'm': 2, 's': -2},
    'kg m^2': {'kg': 1, 'm': 2}, '1/s': {'s': -1},
}  # fmt: skip

EFFORT = re.compile(r'(?<![a-zA-Z])([tT])orque(s?)(?![a-zA-Z])')
BRACKETS = re.compile(r'\[([^]]*)\]')


class JointUnits(NamedTuple):
    """The units of some joints, asked for by those of hinges."""

    slides: tuple[bool, ...] = ()  # whether each joint is a slide; empty: all are hinges

    def of(self, unit: str) -> str:
        """Unit of all joints, where that of hinges is `unit`; both where they differ.

        >>> JointUnits((True,)).of('N m s/rad'), JointUnits((True, False)).of('µrad')
        ('N s/m', 'µrad or µm')
        """
        if not any(self.slides):
            return unit
        linear = unit
        for pattern, instead in LINEAR:
            linear = pattern.sub(instead, linear)
        return linear if linear == unit or all(self.slides) else f'{unit} or {linear}'

    def label(self, text: str) -> str:
        """A text with units in brackets, likewise, and with what motors do.

        >>> JointUnits((True,)).label('torque [N m]'), JointUnits((True, False)).label('Torques')
        ('force [N]', 'Torques and forces')
        """
        text = EFFORT.sub(self._effort, text)
        return BRACKETS.sub(lambda found: f'[{self.of(found[1])}]', text)

    def _effort(self, found: re.Match[str]) -> str:
        """The word for the torques of the joints."""
        torque, many = found[0], found[2]
        if not any(self.slides):
            return torque
        if all(self.slides):
            return f'{"fF"[found[1] == "T"]}orce{many}'
        return f'{torque} {"and" if many else "or"} force{many}'

    def key(self, name: str) -> str:
        """Name of a column or key that ends with a unit, likewise.

        >>> JointUnits((True,)).key('torque_max_nm'), JointUnits((True, False)).key('rms_rad')
        ('torque_max_n', 'rms_rad_or_m')
        """
        if not any(self.slides) or ROTATION in name:
            return name
        both = '' if all(self.slides) else r'\1_or_'
        return WORD.sub(lambda found: found.expand(both) + KEYS[found[1]], name)

    def hinges(self, joints: int) -> NDArray[np.bool_]:
        """Which of so many joints turn, shape (n,)."""
        return ~np.array(self.slides or (False,) * joints)

    def one(self, joint: int) -> JointUnits:
        """Those of one joint, by its 0-based index."""
        return JointUnits(self.slides[joint : joint + 1])


HINGES, PRISMATIC, BOTH = JointUnits(), JointUnits((True,)), JointUnits((False, True))


def all_of(units: Iterable[JointUnits]) -> JointUnits:
    """Those of the joints of several robots; of none those of hinges."""
    kinds = {slide for each in units for slide in each.slides or (False,)}
    return JointUnits(tuple(sorted(kinds)))


def beyond_a_turn(position: Any, units: JointUnits) -> str:
    """How far a hinge is beyond a whole turn, and a doubt, in words; empty if none is.

    Args:
        position: Joints [rad], shape (N, n).
        units: Their units.
    """
    far = float(np.abs(position[:, units.hinges(position.shape[1])]).max(initial=0.0))
    turns = f'{far:.4g} rad, {far / TURN:.3g} turns: joint_states are in radians; {DEGREES}'
    return turns if far > TURN else ''


# Numerical arrays: their type in annotations, and groups that hold them.

Array = NDArray[np.float64]  # docstrings say shape and unit


def with_arrays(group: Any) -> Any:
    """A NamedTuple whose lists are arrays, so that it has one type for kernels, however long."""
    return group._make(np.array(value) if isinstance(value, tuple) else value for value in group)


# Rounding to significant digits.


def rounded(value: Any, digits: int) -> Any:
    """Round a number, or each of a nested list, tuple or array of them.

    Args:
        value: The number, or the numbers.
        digits: Significant digits that are kept.

    Returns:
        A float, or lists of them.
    """
    if isinstance(value, (list, tuple)) or np.ndim(value):
        return [rounded(item, digits) for item in value]
    return float(f'{float(value):.{digits}g}')


# The period of stamps, of which single ones may be missing or late.

MICROSECOND = NANOSECONDS // 1_000_000  # ns
LONG = 1.5  # times the median of the steps, of one over missing stamps
PARTS = (1, 2, 3)  # of the median of the steps, that the period may be
REGULAR = 0.8  # agreement of the steps with a period, beyond which no smaller one is looked for
NEAR_ROUND = 0.01  # share of a period, by which a round one may differ from it


def usual_period(steps: NDArray[np.int64]) -> int:
    """The period of stamps, from the steps from one to the next, all positive [ns], shape (N,).

    Where stamps are missing after every other one, the median of the steps is no period. One step
    that an overrun made short is none, either.

    Returns:
        The period, in whole microseconds [ns]: a whole number of Hz or of milliseconds where one
        is near.
    """
    usual, best = float(steps[0]), -math.inf
    for part in PARTS:
        single = steps[steps < LONG / part * np.median(steps)]
        if not len(single) or best > REGULAR:
            break
        period = _refined(np.cumsum([0, *steps]), float(np.median(single)))
        regular = float(np.cos(2.0 * math.pi / period * steps).mean())
        if regular > best:
            usual, best = period, regular
    second, milli = NANOSECONDS, NANOSECONDS // 1000
    rounds = second / max(1, round(second / usual)), max(1, round(usual / milli)) * milli
    nearest = min(rounds, key=lambda each: abs(each - usual))
    if abs(nearest - usual) <= NEAR_ROUND * usual:
        usual = nearest
    return max(1, round(usual / MICROSECOND)) * MICROSECOND


def _refined(stamps: NDArray[np.int64], period: float) -> float:
    """A period made better by steps over more and more stamps [ns].

    Steps count by their phase in the period, so it does not matter how many periods one takes,
    and what is late by chance counts little.
    """
    over = 1
    while over <= len(stamps) // 2:
        steps = stamps[over:] - stamps[:-over]
        phase = np.angle(np.exp(2j * math.pi / period * steps).mean()) / (2.0 * math.pi)
        period *= 1.0 + float(phase) * period / float(steps.mean())
        over *= 2
    return period
