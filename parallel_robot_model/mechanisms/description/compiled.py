"""The numbers of a compiled description as text: the same bits wherever the machine is read.

Who reads MJCF compiles it; what MuJoCo then says stands beside the text of the description, in
bags, in exported laws and in config/machines. Others read it from there, without MuJoCo.
"""

from __future__ import annotations

import hashlib
import json
import math
import types
from collections.abc import Iterator
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.configuration.robot_file import MOST_BYTES
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    HINGE,
    SLIDE,
    WORLD,
    Description,
    Frame,
)

SQUARE = 'rotation', 'inertia'  # arrays of shape (3, 3), others are of shape (3,)
ORTHOGONAL = 1e-6  # by which axes and rotations may miss their unit length
SAME = 1e-9  # relative to one, by which compilers may differ


class Compiled(NamedTuple):
    """A compiled description."""

    text: str  # SHA-256 of the text that was compiled
    compiler: str  # which release compiled it
    description: Description  # what it said


def written(text: str, compiler: str, description: Description) -> str:
    """A compiled description as JSON."""
    compiled = Compiled(_hash(text), compiler, description)
    return json.dumps(_plain(compiled), ensure_ascii=False)


def numbers_of(compiled: str, text: str, source: str) -> Description | None:
    """A description from its compiled numbers; None where they are those of another text.

    Args:
        compiled: What :func:`written` made.
        text: The text that it should be of.
        source: What the text is called in messages.

    Raises:
        InputError: it is no such JSON, or its numbers describe no machine.
    """
    try:
        found = _typed(plain_data.load(compiled, MOST_BYTES), Compiled, 'compiled')
        assert isinstance(found, Compiled)
        if found.text != _hash(text):
            return None
        for what in _wrong(found.description):
            raise ValueError(what)
    except ValueError as error:
        raise InputError(f'{source}: robot_compiled: {error}', 'robot_compiled') from None
    return found.description._replace(source=source)


def difference(one: Description, other: Description) -> float:
    """The greatest difference of numbers, relative to those above one; infinite: other parts."""
    first, second = (list(_numbers(_plain(each._replace(source='')))) for each in (one, other))
    if len(first) != len(second):
        return math.inf
    apart = 0.0
    for a, b in zip(first, second, strict=True):
        if isinstance(a, str) or isinstance(b, str):
            apart = max(apart, 0.0 if a == b else math.inf)
        else:
            apart = max(apart, abs(a - b) / max(1.0, abs(a)))
    return apart


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A value as JSON can say it."""
    if hasattr(value, '_asdict'):
        return {key: _plain(each) for key, each in value._asdict().items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def _numbers(value: Any) -> Iterator[float | str]:
    """Numbers and names of a plain value, one after the other."""
    if isinstance(value, dict):
        value = [part for each in value.items() for part in each]
    if isinstance(value, list):
        for each in value:
            yield from _numbers(each)
    elif value in ('inf', '-inf') or not isinstance(value, str):
        yield min(max(float(value), -1e300), 1e300)
    else:
        yield value


def _typed(value: Any, kind: Any, where: str) -> Any:
    """A plain value as one of a kind; ValueError where it is none."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is types.UnionType:
        kind = arguments[isinstance(value, list)]
        return _typed(value, kind, where)
    if hasattr(kind, '_fields'):
        hints = get_type_hints(kind)
        if not isinstance(value, dict) or value.keys() != set(kind._fields):
            raise ValueError(f'{where} must have {", ".join(kind._fields)}')
        return kind(**{key: _typed(value[key], hints[key], f'{where}.{key}') for key in hints})
    if origin is tuple:
        if not isinstance(value, list) or (arguments[-1] is not ... and len(value) != 2):
            raise ValueError(f'{where} must be a list')
        return tuple(_typed(each, arguments[0], where) for each in value)
    if origin is dict and isinstance(value, dict):
        return {key: _typed(each, arguments[1], f'{where}.{key}') for key, each in value.items()}
    if origin is np.ndarray:
        shape = (3, 3) if where.rpartition('.')[2] in SQUARE else (3,)
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.shape != shape:
            raise ValueError(f'{where} must be numbers of shape {shape}')
        return array
    if kind is float and value in ('inf', '-inf'):
        return float(value)
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if kind in (int, str, bool) and type(value) is kind:
        return value
    raise ValueError(f'{where} is {value!r}')


def _wrong(description: Description) -> Iterator[str]:
    """What cannot be of a machine: parts that are not there, axes that are none."""
    bodies, names = len(description.bodies), {joint.name for joint in description.joints}
    for i, body in enumerate(description.bodies):
        if not WORLD <= body.parent < i:
            yield f'body {body.name!r} has no parent before it'
    for joint in description.joints:
        if not 0 <= joint.body < bodies or joint.kind not in (HINGE, SLIDE, BALL):
            yield f'joint {joint.name!r} has no body or kind'
        if abs(np.linalg.norm(joint.axis) - 1.0) > ORTHOGONAL:
            yield f'joint {joint.name!r} has an axis that is no unit vector'
    ends = [end for loop in description.loops for end in (loop.first, loop.second)]
    frames = [*ends, *description.frames.values()]
    frames += [Frame(b.parent, b.rotation, b.position) for b in description.bodies]
    for frame in frames:
        if not WORLD <= frame.body < bodies:
            yield 'a frame has no body'
        if np.abs(frame.rotation @ frame.rotation.T - np.eye(3)).max() > ORTHOGONAL:
            yield 'a frame has a rotation that is none'
    used = [each.joint for each in description.actuators]
    used += [each.joint for each in description.couplings]
    used += [name for tendon in description.tendons for name in tendon.ratios]
    used += [name for posture in description.keyframes.values() for name in posture]
    for name in set(used) - names:
        yield f'there is no joint {name!r}'
