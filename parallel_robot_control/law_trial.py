"""Trial of a custom law in a separate process, before it is used.

Compiled code does not check bounds: reading beyond an array yields whatever is in memory. So the
law is also compiled with bounds checks and run on some samples. The verdict is kept with the
machine code, for this source of the law.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numba import typeof

from parallel_robot_base import cache_directory, custom_module, fields, trial_process
from parallel_robot_base.custom_import import import_file
from parallel_robot_base.custom_module import RAISED
from parallel_robot_base.errors import InputError, first_line
from parallel_robot_base.trial_process import LIMIT, step
from parallel_robot_compiler import as_arrays, as_vectors
from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_model.contract import Model

OTHERS = (1, 2, 5)  # numbers of joints that a law should support, too
UPDATES = 5  # for each number of joints
SIZES = (0.0, 1e-3, 1.0, 10.0)  # magnitudes of the samples
ROWS = ('torque', 'sliding_variable', 'coupled_error')


def warnings_of(name: str, law: Any, gains: Any, joints: int) -> tuple[str, ...]:
    """Try a law, once for each version of its source.

    Args:
        name: Name of the law.
        law: Its module, loaded from a file.
        gains: Gains to try it with.
        joints: Number of joints that it will control.

    Returns:
        What it cannot do that the laws of the suite can.

    Raises:
        InputError: it reads beyond an array, does not return, or returns something invalid.
    """
    source = custom_module.source_of(law)
    mark = f'tried_{hashlib.sha256(source).hexdigest()[:16]}_{joints}'
    verdict = cache_directory.marked(mark)
    if verdict is None:
        with tempfile.TemporaryDirectory() as directory:
            file = Path(law.__file__)
            if not file.is_file() or file.read_bytes() != source:  # changed since
                file = Path(directory, f'{name}.py')
                file.write_bytes(source)
            cache = cache_directory.subdirectory('checked') or directory
            verdict = _try(name, file, gains, joints, cache)
        cache_directory.mark(mark, verdict)
    return tuple(f'{name}: {line}' for line in verdict.splitlines())


def _try(name: str, file: Path, gains: Any, joints: int, cache: str) -> str:
    """Run the trial with a separate cache; returns the warnings, one per line.

    Raises:
        InputError: the law is refused.
    """
    task = {'file': str(file), 'gains': gains, 'joints': joints}
    ended = trial_process.run(__name__, task, NUMBA_BOUNDSCHECK='1', NUMBA_CACHE_DIR=cache)
    if not ended.returned:
        raise InputError(f'{name}: {ended.how}')
    verdict: dict[str, str] = ended.result
    if 'refused' in verdict:
        raise InputError(f'{name}: {verdict["refused"]}')
    return verdict['warnings']


def _trial(task: dict[str, Any]) -> dict[str, str]:
    """Try the law of a task: the verdict."""
    file = Path(task['file'])
    law: Any = import_file(file, file.read_bytes())
    names = [parameter.key for parameter in fields.parameters(law.Gains)]
    gains = fields.build(law.Gains, dict(zip(names, task['gains'], strict=True)))
    for joints in (task['joints'], *OTHERS):
        try:
            _run(law, gains, joints)
        except RAISED as error:
            text = str(error) if isinstance(error, InputError) else first_line(error)
            if joints == task['joints']:
                return {'refused': text}
            return {'warnings': f'written for {task["joints"]} joints; with {joints}: {text}'}
    return {'warnings': ''}


def _run(law: Any, gains: Any, joints: int) -> None:
    """Update a law several times with a number of joints."""
    with step('initial_memory', LIMIT):
        memory = first = as_arrays(law.initial_memory(joints))
    random = np.random.default_rng(joints)
    for k in range(UPDATES * len(SIZES)):
        rows = random.normal(scale=SIZES[k % len(SIZES)], size=(7, joints))
        model = Model(np.eye(joints), np.eye(joints), np.zeros(joints))
        words = (gains, model, JointReference(*rows[:3]), Feedback(*rows[3:]), memory, 1e-3)
        if k == 0:
            with step('the compilation of update'):
                given = _compiled_for(law, words)
        with step('update', LIMIT):
            output = law.update(*given(words))
        _check(output, joints, first)
        memory = output.memory


def _compiled_for(law: Any, words: tuple[Any, ...]) -> Callable[[Any], Any]:
    """Compile the update of a law; returns what makes the arguments that it takes."""
    try:
        law.update.compile(tuple(map(typeof, words)))
    except Exception:  # it may need vectors, which cannot be read beyond their end
        law.update.compile(tuple(map(typeof, as_vectors(words))))
        return as_vectors
    return as_arrays


def _check(output: ControlOutput, joints: int, first: Any) -> None:
    """Check the shapes of the output of a law.

    Raises:
        InputError: one is wrong.
    """
    for field in ROWS:
        shape = np.shape(getattr(output, field))
        if shape != (joints,):
            raise InputError(f'update returns a {field} of shape {shape}, not {(joints,)}')
    before, after = list(_leaves(first)), list(_leaves(output.memory))
    if before != after:
        raise InputError(f'update returns a memory of shapes {after}, not {before}')


def _leaves(memory: Any) -> Iterator[tuple[int, ...]]:
    """Shapes of the numbers and arrays in a memory."""
    if isinstance(memory, tuple):
        for part in memory:
            yield from _leaves(part)
    else:
        yield np.shape(memory)


if __name__ == '__main__':
    trial_process.serve(_trial)
