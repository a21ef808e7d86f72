"""Variables of a unit: what they are, and where they lie in the memory of its kernels."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from numba import typeof

from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import JointUnits
from parallel_robot_model.compiler import Boxed, FirstClass, Leaf, leaves
from parallel_robot_model.configuration.fields import Field, PerJoint, parameters

WORD = 8  # bytes
SHARE, MORE = 0.25, 0.1  # by which a parameter is changed to see what follows


class Variable(NamedTuple):
    """A variable of a unit.

    Attributes:
        name: Its name.
        role: ``input``, ``output``, ``parameter``, which can be changed at any time, ``constant``.
        kind: ``real``, ``integer`` or ``boolean``.
        text: What it is.
        unit: Its unit; empty if it has none.
        start: Its value at the start; of an output what is there before the first step.
        low: Smallest value.
        high: Largest value.
        address: Where it lies, in this process; of a constant nowhere.
    """

    name: str
    role: str
    kind: str
    text: str
    unit: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    address: int = 0


class Rows(NamedTuple):
    """Numbers of joints in memory, as variables.

    Attributes:
        address: Where row 0 begins.
        joints: Names of the joints.
        units: Their units.
    """

    address: int
    joints: Sequence[str]
    units: JointUnits

    def of(self, row: int, name: str, role: str, unit: str, text: str) -> Iterator[Variable]:
        """A variable for each joint, of the unit for hinges."""
        for k, joint in enumerate(self.joints):
            own = self.units.one(k)
            place = self.address + WORD * (row * len(self.joints) + k)
            words = f'{own.label(text)} of {joint}'
            yield Variable(
                f'{name}[{k + 1}]', role, 'real', words, own.of(unit), 0.0, address=place
            )


def of_group(
    group: Any, prefix: str, boxed: Boxed, make: Callable[[Any], Any] | None, units: JointUnits
) -> Iterator[Variable]:
    """Variables of a group of parameters.

    A number is a parameter that can be changed if it stands in memory as it is, and nothing else
    there follows from it; this is tried by changing it. Others are constants; texts are left out.

    Args:
        group: The group.
        prefix: Of its keys.
        boxed: What the kernels have of it.
        make: Makes the tuple of `boxed` from another group; None: all are constants.
        units: Units of the joints, for numbers per joint.
    """
    known = list(_numbers(boxed, boxed.value)) if make else []
    for at, parameter in enumerate(parameters(type(group))):
        value, several = group[at], isinstance(group[at], tuple)
        for k, number in enumerate(value if several else (value,)):
            if isinstance(number, str) or not isinstance(number, int | float):
                continue
            place = None
            if make and isinstance(number, float):
                changed = functools.partial(_changed, make, group, at, k)
                place = _place_of(boxed, known, changed, number, parameter.field)
            own = units
            if parameter.type is PerJoint:
                own = units.one(k)
            yield Variable(
                f'{prefix}.{parameter.key}' + (f'[{k + 1}]' if several else ''),
                'constant' if place is None else 'parameter',
                {bool: 'boolean', int: 'integer'}.get(type(number), 'real'),
                parameter.field.description,
                own.of(parameter.field.unit),
                float(number),
                parameter.field.low,
                parameter.field.high,
                place or 0,
            )


def _changed(make: Callable[[Any], Any], group: Any, at: int, k: int, new: float) -> Any:
    """What is made of a group in which number `k` of field `at` is another one."""
    value = group[at]
    whole = (*value[:k], new, *value[k + 1 :]) if isinstance(value, tuple) else new
    return make(group._replace(**{group._fields[at]: whole}))


def _numbers(boxed: Boxed, value: Any) -> Iterator[Leaf]:
    """The numbers in a boxed tuple, or in another of its type."""
    for leaf in leaves(value, typeof(boxed.value), boxed.address):
        if not isinstance(leaf.value, Boxed | FirstClass | str) and leaf.value is not None:
            yield leaf


def _place_of(
    boxed: Boxed,
    known: list[Leaf],
    changed: Callable[[float], Any],
    number: float,
    field: Field,
) -> int | None:
    """Where a number lies as it is, if nothing else follows from it."""
    tried = (number + SHARE * abs(number) + MORE, number - SHARE * abs(number) - MORE)
    ends = [min(max(new, field.low), field.high) for new in tried]
    ends += [end for end in (field.low, field.high) if math.isfinite(end)]
    places = set()
    for new in ends:
        if new == number:
            continue
        try:
            after = list(_numbers(boxed, changed(new)))
        except (ParallelRobotError, ArithmeticError, ValueError):
            continue  # no such robot
        moved = [b for a, b in zip(known, after, strict=True) if _differ(a.value, b.value)]
        if len(moved) != 1 or moved[0].value != new:
            return None
        places.add(moved[0].address)
    return places.pop() if len(places) == 1 else None


def _differ(one: Any, other: Any) -> bool:
    with contextlib.suppress(TypeError, ValueError):
        return bool(one != other) and not (one != one and other != other)
    return False  # arrays
