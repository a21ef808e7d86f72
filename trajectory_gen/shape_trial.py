"""Trial of a custom trajectory before it is used.

Its compiled code runs in a separate process first, with the bounds of arrays checked: once for
each version of its source. Then, here and for each set of parameters, its derivatives are
compared with finite differences.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from parallel_robot_model.common.errors import InputError, first_line
from parallel_robot_model.compiler import INTERPRETED, FunctionValue, reason
from parallel_robot_model.configuration import fields
from parallel_robot_model.processes import child_process, custom_module
from parallel_robot_model.processes.child_process import CALL_LIMIT, trial_step
from parallel_robot_model.processes.custom_module import RAISED, import_file, wrap_user_errors
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen.shapes import prepared

SAMPLES = 500  # over the span, and over the next
PERIOD, MOST = 1e-3, 20_000  # s, between samples that tell jumps; how many these are at most
TRIED = 25  # in the separate process
STEP = 1e-5  # s, of finite differences: they err by 1e-5 of the value at 100 Hz
TOLERANCE = 1e-3  # of a derivative, relative to its largest value in the motion
LEAST = 1e-6  # difference that is never an error, in units of the pose per s or s^2
NAMES = ('pose', 'rate', 'acceleration')


def check(name: str, shape: Any, parameters: Any) -> None:
    """Try a custom trajectory with some parameters.

    Raises:
        InputError: it does not compile, fails, does not return, returns something invalid, its
            derivatives are wrong, it jumps, or it goes on after its span.
    """
    motion = shape.motion
    if not hasattr(motion, 'py_func'):
        raise InputError(f'{name}: motion is not compiled: put @kernel before it')
    task = {'parameters': fields.plain(parameters)}
    custom_module.verdict_of(name, shape, 'moved', __name__, task)
    made, span = prepared(name, shape, parameters)
    try:
        compiled = FunctionValue(motion, made, 0.0)
    except Exception as error:  # Numba raises many kinds
        cause = reason(error, motion.py_func)
        raise InputError(f'{name}: motion does not compile: {cause}') from error
    if not INTERPRETED and not _is_motion(compiled.signature().return_type):
        raise InputError(
            f'{name}: motion must return PoseMotion(pose, rate, acceleration), three float arrays'
        )
    with wrap_user_errors(f'{name}: motion'):
        _compare(name, motion, made, span or 1.0)


def _is_motion(kind: Any) -> bool:
    return getattr(kind, 'instance_class', None) is PoseMotion and all(
        isinstance(part, types.Array) and part.ndim == 1 and part.dtype == types.float64
        for part in kind.types
    )


def _compare(name: str, motion: Any, made: Any, span: float) -> None:
    """Compare a motion with its finite differences, and with itself after its span."""
    # Not at round times, where motions have their corners.
    times = (np.arange(2 * SAMPLES) + 0.5**0.5) * span / SAMPLES
    here, before, after = (_sampled(name, motion, made, times + k * STEP) for k in (0, -1, 1))
    width = (times + STEP) - (times - STEP)
    for order in (1, 2):
        expected = (after[order - 1] - before[order - 1]) / width[:, None]
        allowed = LEAST + TOLERANCE * np.abs(expected).max(axis=0)
        excess = np.abs(here[order] - expected) / allowed
        if excess.max() > 1.0:
            k, i = map(int, np.unravel_index(excess.argmax(), excess.shape))
            raise InputError(
                f'{name}: {NAMES[order]}[{i}] at t = {times[k]:.6g} s is {here[order][k, i]:.6g}, '
                f'but {NAMES[order - 1]}[{i}] changes by {expected[k, i]:.6g} per second'
            )
    _look_for_jumps(name, motion, made, span)
    known, later = here[0][:SAMPLES], here[0][SAMPLES:]
    low, high = known.min(axis=0), known.max(axis=0)
    slack = LEAST + 0.01 * (high - low)
    wrong = (later < low - slack) | (later > high + slack)
    if wrong.any():
        k, i = map(int, np.argwhere(wrong)[0])
        raise InputError(
            f'{name}: pose[{i}] at t = {times[SAMPLES + k]:.6g} s is {later[k, i]:.6g}, but '
            f'nothing new may happen after its span of {span:.6g} s: '
            f'{low[i]:.6g} to {high[i]:.6g} until then'
        )


def _look_for_jumps(name: str, motion: Any, made: Any, span: float) -> None:
    """Look at the whole of a motion, as densely as a loop does."""
    dt = max(PERIOD, span / MOST)
    times = np.arange(0.5**0.5 * dt, span, dt)
    pose, rate, acceleration = _sampled(name, motion, made, times)
    if len(times) < 2:
        return
    bend = np.abs(acceleration).max(axis=0) * dt  # most that a rate changes from one to the next
    steps = np.diff(pose, axis=0), np.diff(rate, axis=0)
    wrong = (
        np.abs(steps[0] - (rate[1:] + rate[:-1]) * dt / 2) > LEAST + bend * dt,
        np.abs(steps[1]) > LEAST + 2.0 * bend,
    )
    for what, step_, bad in zip(NAMES, steps, wrong, strict=False):
        if bad.any():
            k, i = map(int, np.argwhere(bad)[0])
            raise InputError(
                f'{name}: {what}[{i}] jumps by {step_[k, i]:.6g} between '
                f't = {times[k]:.6g} s and {times[k + 1]:.6g} s'
            )


def _sampled(
    name: str, motion: Any, made: Any, times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Pose, rate and acceleration at some times, each of shape (N, m)."""
    motions = [motion(made, float(t)) for t in times]
    size = len(motions[0].pose) if motions else 0
    with contextlib.suppress(ValueError):  # of different shapes
        rows = np.array(motions, dtype=float)
        if rows.shape[1:] == (len(NAMES), size) and size and np.isfinite(rows).all():
            return tuple(rows.transpose(1, 0, 2))
    for t, each in zip(times, motions, strict=True):
        for what, row in zip(NAMES, each, strict=True):
            if np.shape(row) != (size,) or not size:
                raise InputError(
                    f'{name}: {what} at t = {t:.6g} s must be one number for each coordinate of '
                    f'the pose, not of shape {np.shape(row)}'
                )
            if not np.isfinite(row).all():
                raise InputError(f'{name}: {what} at t = {t:.6g} s is {np.array(row).tolist()}')
    return tuple(np.array([each[i] for each in motions]) for i in range(len(NAMES)))


def _trial(task: dict[str, Any]) -> dict[str, str]:
    """Call the motion of a task: the verdict."""
    file = Path(task['file'])
    shape: Any = import_file(file, file.read_bytes())
    names = [parameter.key for parameter in fields.parameters(shape.Parameters)]
    values = dict(zip(names, task['parameters'], strict=True))
    parameters = fields.build(shape.Parameters, values)
    try:
        with trial_step('its Python', CALL_LIMIT):
            made, span = prepared('it', shape, parameters)
        with trial_step('the compilation of motion'):
            shape.motion(made, 0.0)
        for t in np.linspace(0.0, 2.0 * (span or 1.0), TRIED):
            with trial_step('motion', CALL_LIMIT):
                shape.motion(made, float(t))
    except RAISED as error:
        # What does not compile, or whose parameters are refused, is told where it is done again.
        if isinstance(error, IndexError):
            return {'refused': f'motion: {first_line(error)}'}
    return {'warnings': ''}


if __name__ == '__main__':
    child_process.serve_trial(_trial)
