"""The numbers of a compiled description as text: the same bits wherever the machine is read.

Who reads MJCF compiles it; what MuJoCo then says stands beside the text of the description, in
bags, in exported laws and in config/machines. Others read it from there, without MuJoCo.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
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
    WORLD,
    Description,
    Frame,
    leaves,
)
from parallel_robot_model.mechanisms.joint_kinds import KINDS, JointKind

SQUARE = '.rotation', '.inertia'  # arrays of shape (3, 3), others are of shape (3,)
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
    """A description from its compiled numbers; None where there are none, or of another text.

    Args:
        compiled: What :func:`written` made, or nothing.
        text: The text that it should be of.
        source: What the text is called in messages.

    Raises:
        InputError: it is no such JSON, or its numbers describe no machine.
    """
    if not compiled:
        return None
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
    apart = 0.0
    for a, b in itertools.zip_longest(leaves(one[1:]), leaves(other[1:])):  # but for the source
        if isinstance(a, float) and isinstance(b, float):
            apart = max(apart, abs(a - b) / max(1.0, abs(a)) if a != b else 0.0)
        elif a != b:
            return math.inf
    return apart


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A value as JSON can say it."""
    if isinstance(value, JointKind):
        return value.name
    if hasattr(value, '_asdict'):
        value = value._asdict()
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def _typed(value: Any, kind: Any, where: str) -> Any:
    """A plain value as one of a kind; ValueError where it is none."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is types.UnionType:
        return _typed(value, arguments[isinstance(value, list)], where)
    if kind is JointKind:
        return KINDS.get(str(value))
    if hasattr(kind, '_fields'):
        if not isinstance(value, dict) or value.keys() != set(kind._fields):
            raise ValueError(f'{where} must have {", ".join(kind._fields)}')
        hints = get_type_hints(kind).items()
        return kind(*(_typed(value[key], each, f'{where}.{key}') for key, each in hints))
    if origin is tuple:
        if not isinstance(value, list) or (arguments[-1] is not ... and len(value) != 2):
            raise ValueError(f'{where} must be a list')
        return tuple(_typed(each, arguments[0], where) for each in value)
    if origin is dict and isinstance(value, dict):
        return {key: _typed(each, arguments[1], f'{where}.{key}') for key, each in value.items()}
    if origin is np.ndarray:
        shape = (3, 3) if where.endswith(SQUARE) else (3,)
        with contextlib.suppress(TypeError, ValueError):
            if (array := np.array(value, dtype=float)).shape == shape:
                return array
        raise ValueError(f'{where} must be numbers of shape {shape}')
    if kind is float and (value in ('inf', '-inf') or type(value) in (int, float)):
        return float(value)
    if type(value) is kind:
        return value
    raise ValueError(f'{where} is {value!r}')


def _wrong(description: Description) -> Iterator[str]:
    """What cannot be of a machine: parts that are not there, axes that are none."""
    bodies, names = len(description.bodies), {joint.name for joint in description.joints}
    for i, body in enumerate(description.bodies):
        if not WORLD <= body.parent < i:
            yield f'body {body.name!r} has no parent before it'
    for joint in description.joints:
        if not 0 <= joint.body < bodies or not joint.kind:
            yield f'joint {joint.name!r} has no body or kind'
        if abs(np.linalg.norm(joint.axis) - 1.0) > ORTHOGONAL:
            yield f'joint {joint.name!r} has an axis that is no unit vector'
    frames = [end for loop in description.loops for end in (loop.first, loop.second)]
    frames += description.frames.values()
    frames += [Frame(body.parent, body.rotation) for body in description.bodies]
    for frame in frames:
        if not WORLD <= frame.body < bodies:
            yield 'a frame has no body'
        if np.abs(frame.rotation @ frame.rotation.T - np.eye(3)).max() > ORTHOGONAL:
            yield 'a frame has a rotation that is none'
    used = [each.joint for each in description.actuators]
    used += [each.joint for each in description.couplings]
    used += [name for tendon in description.tendons for name in tendon.ratios]
    used += [name for posture in description.keyframes.values() for name in posture]
    for name in sorted({*used} - names):
        yield f'there is no joint {name!r}'
