"""What an FMU calls what a law gets and gives: a YAML file beside it."""

from __future__ import annotations

from collections.abc import Mapping
from keyword import iskeyword
from pathlib import Path
from typing import Any

from parallel_robot_control.foreign import gains, process
from parallel_robot_control.foreign.channel import Gains
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import yaml_file

ROWS = {  # of the question
    'position': process.POSITION,
    'velocity': process.VELOCITY,
    'reference.position': process.REFERENCE,
    'reference.velocity': process.REFERENCE_VELOCITY,
    'reference.acceleration': process.REFERENCE_ACCELERATION,
    'excess': process.EXCESS,
    'disturbance': process.DISTURBANCE,
    'gravity': process.GRAVITY,
}
DIFFERENCES = {  # of two rows
    'error': (process.REFERENCE, process.POSITION),
    'error_rate': (process.REFERENCE_VELOCITY, process.VELOCITY),
}
RESULTS = {  # of the answer
    'torque': process.TORQUE,
    'sliding_variable': process.SLIDING_VARIABLE,
    'coupled_error': process.COUPLED_ERROR,
}
INPUTS = (*ROWS, *DIFFERENCES)
AGE, FAULT = 'age', 'fault'  # one number each
KNOWN = {'inputs': (*INPUTS, AGE), 'outputs': (*RESULTS, FAULT)}
GROUPS = ('inputs', 'outputs', 'parameters', 'gains')
STEP = 'step'  # s, where the one that the FMU names is not meant


def file_beside(path: Path) -> Path | None:
    """The file beside an FMU, ``controller.yaml`` beside ``controller.fmu``; None without one."""
    file = path.with_suffix('.yaml')
    return file if path.suffix == '.fmu' and file.exists() else None


def beside(path: Path) -> dict[str, Any]:
    """What the file beside an FMU says; nothing without one.

    Args:
        path: The FMU.

    Returns:
        Group to name in the suite to what the FMU calls it; of parameters, name to value; of
        gains, see :func:`parallel_robot_control.foreign.gains.described`.

    Raises:
        InputError: it cannot be read, or has what is no name.
    """
    file = file_beside(path)
    if file is None:
        return {}
    found: dict[str, dict[str, Any]] = {}
    step: dict[str, float] = {}
    for key, value in yaml_file.read(file).items():
        group, _, name = key.partition('.')
        if key == STEP and isinstance(value, int | float) and value > 0.0:
            step = {STEP: float(value)}
            continue
        try:
            _check(group, name, value)
        except InputError as error:
            raise InputError(f'{file}: {error}') from None
        found.setdefault(group, {})[name] = value
    if 'gains' in found:
        found['gains'] = gains.described(path, found['gains'])
    return found | step


def _check(group: str, name: str, value: Any) -> None:
    if group not in GROUPS or not name:
        raise UnknownNameError('key', group, (*GROUPS, STEP))
    if group == 'gains':
        if not isinstance(value, str):
            raise InputError(f'{group}.{name} must be the name of a parameter, not {value!r}')
        if not name.isidentifier() or name[0] == '_' or iskeyword(name) or name in Gains._fields:
            raise InputError(f'{group}.{name}: {name} cannot be the name of a gain')
        return
    known = KNOWN.get(group)
    if known is None:
        numbers = value if isinstance(value, list) else [value]
        if not all(isinstance(number, bool | int | float) for number in numbers):
            raise InputError(f'{group}.{name} must be a number or a list of some, not {value!r}')
        return
    if name not in known:
        raise UnknownNameError(group.removesuffix('s'), name, known)
    texts = [value] if isinstance(value, str) else value
    one = name in (AGE, FAULT) and not isinstance(value, str)
    if one or not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        wanted = 'a name' if one else 'an array, or a list of names, one for each joint'
        raise InputError(f'{group}.{name} must be {wanted}, not {value!r}')


def given(names: Mapping[str, Any], group: str) -> dict[str, Any]:
    """A group of what :func:`beside` says."""
    return dict(names.get(group, {}))
