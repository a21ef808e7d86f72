"""Trial of a custom law in a separate process, before it is used.

Compiled code does not check bounds: reading beyond an array yields whatever is in memory. So the
law is also compiled with bounds checks and run on some samples. The verdict is kept with the
machine code, for this source of the law.
"""

from __future__ import annotations

import copy
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numba import typeof, types

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_model.common.errors import InputError, first_line
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import as_arrays, as_vectors, plain_type, shape_of
from parallel_robot_model.configuration import fields
from parallel_robot_model.processes import child_process, custom_module
from parallel_robot_model.processes.child_process import CALL_LIMIT, trial_step
from parallel_robot_model.processes.custom_module import RAISED, import_file
from parallel_robot_model.robots.contract import Model

# What is wrong with what the update of a law returns, field by field.

CALL = f'ControlOutput({", ".join(ControlOutput._fields)})'
MAX_TYPE_LENGTH = 60  # characters of the name of a type


def wrong_types(returned: Any, wanted: Any) -> str:
    """Which fields of an output have a wrong type, what they are and should be; or nothing.

    Args:
        returned: Numba's type of what an update returns.
        wanted: That of a right output.
    """
    if getattr(returned, 'instance_class', None) is not ControlOutput:
        return f'update must return {CALL}, not {_named(returned)}'
    mistakes = [
        f'{field} as {_named(given)}, not {_named(right)}'
        for each in zip(ControlOutput._fields, returned.types, wanted.types, strict=True)
        for field, given, right in _different(*each)
    ]
    return f'update returns {"; ".join(mistakes)}' if mistakes else ''


def _wrong_shapes(output: ControlOutput, joints: int, memory: Any) -> str:
    """Which fields of an output have a wrong shape, and the right one; or nothing."""
    row = np.zeros(joints)
    right = dict(leaves('', ControlOutput(row, row, row, memory)))
    mistakes = [
        f'{field} of shape {np.shape(value)}, not {np.shape(right[field])}'
        for field, value in leaves('', output)
        if np.shape(value) != np.shape(right[field])
    ]
    return f'update returns {"; ".join(mistakes)}' if mistakes else ''


def wrong_memory(memory: Any) -> str:
    """Which fields of a memory have unusable types, and which types are allowed; or nothing.

    Args:
        memory: Memory before the first update, with vectors.
    """
    mistakes = [
        f'{field} is {_named(typeof(value))}'
        for field, value in leaves('memory', memory)
        if plain_type(value) is None
    ]
    allowed = 'numbers and arrays of float64, int64 or bool'
    return f'{", ".join(mistakes)}, but a memory is made of {allowed}' if mistakes else ''


def leaves(name: str, value: Any) -> Iterator[tuple[str, Array | float]]:
    """The numbers and arrays in a tuple of tuples, each with its name, e.g. memory.integral."""
    if isinstance(value, tuple):
        for field, part in zip(_fields(value, len(value)), value, strict=True):
            yield from leaves(f'{name}.{field}'.removeprefix('.'), part)
    else:
        yield name, value


def _different(name: str, given: Any, right: Any) -> Iterator[tuple[str, Any, Any]]:
    """The innermost fields in which two types differ, each with both types."""
    classes = [getattr(kind, 'instance_class', None) for kind in (given, right)]
    tuples = isinstance(given, types.BaseTuple) and isinstance(right, types.BaseTuple)
    if tuples and classes[0] is classes[1] and len(given) == len(right):
        parts = zip(_fields(right, len(right)), given.types, right.types, strict=True)
        for field, *pair in parts:
            yield from _different(f'{name}.{field}', *pair)
    elif given != right:
        yield name, given, right


def _fields(group: Any, count: int) -> tuple[Any, ...]:
    """Names of the fields of a NamedTuple or of its type; numbers for another tuple."""
    return getattr(group, '_fields', None) or getattr(group, 'fields', None) or (*range(count),)


def _named(kind: Any) -> str:
    """A type in words."""
    shape, scalar = shape_of(kind)
    if shape:
        return f'a vector of shape {shape} of {scalar}'
    if isinstance(kind, types.Array):
        strided = '' if kind.layout == 'C' else ' with gaps (take a .copy())'
        return f'a {kind.ndim}-d array of {kind.dtype}{strided}'
    if isinstance(kind, types.Number | types.Boolean):
        return f'a number ({kind})'
    if isinstance(kind, types.BaseTuple):
        made_by = getattr(kind, 'instance_class', None)
        return made_by.__name__.rpartition('.')[2] if made_by else f'a tuple of {len(kind)}'
    text = 'None' if isinstance(kind, types.NoneType) else str(kind)
    return text if len(text) <= MAX_TYPE_LENGTH else f'{text[:MAX_TYPE_LENGTH]}...'


OTHERS = (1, 2, 5)  # numbers of joints that a law should support, too
UPDATES = 5  # for each number of joints
FORGETS = 'memory never changes, whatever the error: update returns it as it came'
DIFFERS = '{} gives other numbers for the same input, as a random one or a time: rerun will differ'
SIZES = (0.0, 1e-3, 1.0, 10.0)  # magnitudes of the samples


def warnings_of(name: str, law: Any, gains: Any, joints: int) -> tuple[str, ...]:
    """Try a law, once for each version of its source.

    Args:
        name: Name of the law.
        law: The law, loaded from a file.
        gains: Gains to try it with.
        joints: Number of joints that it will control.

    Returns:
        What it cannot do that the laws of the suite can.

    Raises:
        InputError: it reads beyond an array, does not return, or returns something invalid.
    """
    task = {'gains': gains, 'joints': joints}
    verdict = custom_module.verdict_of(name, law, f'tried_{joints}', __name__, task)
    return tuple(f'{name}: {line}' for line in verdict.splitlines())


def _trial(task: dict[str, Any]) -> dict[str, str]:
    """Try the law of a task: the verdict."""
    file = Path(task['file'])
    law: Any = import_file(file, file.read_bytes())
    names = [parameter.key for parameter in fields.parameters(law.Gains)]
    gains = fields.build(law.Gains, dict(zip(names, task['gains'], strict=True)))
    warnings = []
    for joints in (task['joints'], *OTHERS):
        try:
            found = _run(law, gains, joints)
        except RAISED as error:
            text = str(error) if isinstance(error, InputError) else _raised(error, file)
            if joints == task['joints']:
                return {'refused': text}
            warnings.append(f'written for {task["joints"]} joints; with {joints}: {text}')
            break
        if joints == task['joints']:
            warnings += found
    return {'warnings': '\n'.join(warnings)}


def _raised(error: BaseException, file: Path) -> str:
    """An error of a law, with the line of its file if that is known."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename).name == file.name]
    return first_line(error) + (f' (line {lines[-1]})' if lines else '')


def _run(law: Any, gains: Any, joints: int) -> list[str]:
    """Update a law several times with a number of joints; what it does that it should not."""
    with trial_step('initial_memory', CALL_LIMIT):
        memory, second = (as_arrays(law.initial_memory(joints)) for _ in range(2))
    differs = [] if _equal(memory, second) else ['initial_memory']
    first = copy.deepcopy(memory)  # an update may write into it
    remembers = not any(map(np.size, _values(first)))
    random = np.random.default_rng(joints)
    for k in range(UPDATES * len(SIZES)):
        rows = random.normal(scale=SIZES[k % len(SIZES)], size=(7, joints))
        model = Model(np.eye(joints), np.eye(joints), np.zeros(joints))
        feedback = Feedback(rows[3], rows[4], rows[5], rows[6], np.eye(joints), 0.0)
        words = (gains, model, JointReference(*rows[:3]), feedback, memory, 1e-3)
        if k == 0:
            with trial_step('the compilation of update'):
                given = _compiled_for(law, words)
        copied = copy.deepcopy(words)
        with trial_step('update', CALL_LIMIT):
            try:
                output = law.update(*given(words))
                if not _equal(output, law.update(*given(copied))):
                    differs.append('update')
            except Exception as error:
                size = np.abs(rows[0] - rows[3]).max()
                where = f'in the trial with made-up states, here errors up to {size:.2g} rad'
                raise InputError(
                    f'update: {_raised(error, Path(law.__file__))}, {where}'
                ) from error
        if wrong := _wrong_shapes(output, joints, first):
            raise InputError(wrong)
        memory = output.memory
        remembers = remembers or not _equal(memory, first)
    return [DIFFERS.format(each) for each in dict.fromkeys(differs)] + [FORGETS] * (not remembers)


def _equal(one: Any, other: Any) -> bool:
    pairs = zip(_values(one), _values(other), strict=True)
    return all(np.array_equal(*pair, equal_nan=True) for pair in pairs)


def _values(memory: Any) -> list[Any]:
    return [value for _, value in leaves('memory', memory)]


def _compiled_for(law: Any, words: tuple[Any, ...]) -> Callable[[Any], Any]:
    """Compile the update of a law; returns what makes the arguments that it takes."""
    try:
        law.update.compile(tuple(map(typeof, words)))
    except Exception:  # it may need vectors, which cannot be read beyond their end
        law.update.compile(tuple(map(typeof, as_vectors(words))))
        return as_vectors
    return as_arrays


if __name__ == '__main__':
    child_process.serve_trial(_trial)
