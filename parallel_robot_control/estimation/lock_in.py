"""How old the states are, found once while the robot moves, where their stamps do not tell.

For a while a small sine is added to the torque of every joint. The joints answer it as double
integrators, whatever their masses, so the phase between torque and measured position tells how
late the latter is. With weights h over that while, angular frequency W and period T,

    Y = sum h (q - q_r) e^(-i W t),   A = sum h M^-1 tau e^(-i W t),
    delay = -arg(-Y conj(A)) / W - T / 2

tau is the whole torque, feedback of the law included, which acts for T. The sum of Y conj(A) over
the joints tells the delay; if one joint by itself tells another one, nothing is believed.

Source:
    Stoica, Moses (2005), Spectral Analysis of Signals, 2.6, for the window; the phase of a double
    integrator is elementary.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.estimation.recent_torques import MOST, samples_of
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import HINGES, Array, JointUnits
from parallel_robot_model.compiler import every, internal, select, solve
from parallel_robot_model.configuration.fields import Field, PerJoint
from parallel_robot_model.robots.contract import Model

NEAR = 0.05, 2.0  # periods, standard errors from a whole number of periods, which it then is
MAX_SPREAD = 0.5  # periods by which a joint may tell another delay than all together
GAP = 28  # samples; after more without a state it begins anew
LEAST = 4, 20  # samples of an oscillation, oscillations

OFF, WAITING, RUNNING, FOUND, KEPT = range(5)  # phases


class LockInParameters(NamedTuple):
    """How ``estimator.delay: identify`` finds the age of the states."""

    torque: Annotated[PerJoint, Field('N m', 'amplitude of the sine that is added', 1e-6)]
    frequency: Annotated[float, Field('Hz', 'its frequency', 0.1)]
    start: Annotated[float, Field('s', 'when it begins, after the first state', 0.0, 1000.0)]
    duration: Annotated[float, Field('s', 'how long it lasts', 0.0, 1000.0)]
    delay: Annotated[float, Field('s', 'age that is assumed until it has ended', 0.0)]


class LockInMemory(NamedTuple):
    """What is remembered of an identification, as a Struct."""

    first: int  # the first sample
    end: int  # the first sample after the end; 0 before it
    last: int  # the newest sample
    valid: bool  # whether nothing speaks against what is found
    weight: float  # sum of the weights h
    age: float  # of the states, weighted sum [s]
    delay: float  # the delay, found or assumed [s]
    y_cos: Array  # parts of Y and A of each joint, shape (n,)
    y_sin: Array
    a_cos: Array
    a_sin: Array
    of_joints: Array  # what each joint tells by itself [s], shape (n,)


@internal
def delay_at(setup: Any, initialized: bool) -> float:
    """Age of a state beyond its stamp [s]; `initialized`: whether one came before it."""
    if setup.identifies and initialized and setup.memory.lock_in.end > 0:
        return setup.memory.lock_in.delay
    return setup.estimator.delay


@internal
def reset(setup: Any, sample: int, initialized: bool, failed: bool) -> None:
    """Begin anew in a new run, and if a fault or missing states have interrupted it.

    Args:
        setup: The ControlSetup.
        sample: Index of the sample.
        initialized: Whether there was a state before.
        failed: Whether the controller is in a fault.
    """
    at = setup.memory.lock_in
    broken = sample - at.last > GAP or failed
    if not initialized or (broken and at.end == 0):
        at.first, at.end, at.valid = sample, 0, True
        at.weight, at.age, at.delay = 0.0, 0.0, 0.0
        zero = np.zeros_like(at.y_cos)
        at.y_cos, at.y_sin, at.a_cos, at.a_sin, at.of_joints = zero, zero, zero, zero, zero
    at.last = sample


@internal
def elapsed_samples(setup: Any, sample: int) -> int:
    """How many samples it has lasted at a sample; negative before it begins and after its end."""
    at, lock_in = setup.memory.lock_in, setup.lock_in
    since = sample - at.first - samples_of(setup, lock_in.start)
    over = at.end > 0 or since >= samples_of(setup, lock_in.duration)
    return -1 if over else since


@internal
def _angle(setup: Any, k: int) -> float:
    """Of the sine after k samples [rad]."""
    return 2.0 * math.pi * setup.lock_in.frequency * setup.period * k


@internal
def added(setup: Any, sample: int) -> Array:
    """Torque that is added at a sample [N m], shape (n,)."""
    k = elapsed_samples(setup, sample)
    size = 0.0
    if k >= 0:
        size = _window(setup, k) * math.sin(_angle(setup, k))
    return setup.lock_in.torque * size


@internal
def observe(
    setup: Any, sample: int, model: Model, error: Array, torque: Array, age: float, failed: bool
) -> None:
    """Take a state and its torque into account; after the last one, find the delay.

    Args:
        setup: The ControlSetup.
        sample: Index of the sample from which on the torque acts, but for the command's delay.
        model: Nominal model.
        error: Measured joints less reference [rad], shape (n,); slow but for the oscillation.
        torque: The torque, within its limits [N m], shape (n,).
        age: Of the state at the sample, as its stamp tells [s].
        failed: Whether the controller is in a fault.
    """
    at, estimator = setup.memory.lock_in, setup.estimator
    if at.end == 0 and failed:
        at.valid = False
    k = elapsed_samples(setup, sample)
    if k < 0:
        return
    h = _window(setup, k)
    weight, angle = h * h, _angle(setup, k)
    cosine, sine = weight * math.cos(angle), -weight * math.sin(angle)
    pushed = solve(model.M, torque)
    at.y_cos, at.y_sin = at.y_cos + cosine * error, at.y_sin + sine * error
    at.a_cos, at.a_sin = at.a_cos + cosine * pushed, at.a_sin + sine * pushed
    at.age += weight * age
    at.weight += weight
    if k == samples_of(setup, setup.lock_in.duration) - 1:
        frequency = 2.0 * math.pi * setup.lock_in.frequency
        known_delay = at.age / at.weight + estimator.command_delay
        known_delay += math.atan(frequency * estimator.lag) / frequency
        _find_delay(setup, known_delay)
        at.end = sample + 1


@internal
def _window(setup: Any, k: int) -> float:
    """Amplitude of the sine, 0 to 1 (Hann); as a weight, squared, it lets nothing slow through."""
    sine = math.sin(math.pi * (k + 0.5) / samples_of(setup, setup.lock_in.duration))
    return sine * sine


@internal
def _find_delay(setup: Any, known_delay: float) -> None:
    """Find the delay, beside `known_delay` [s], that stamps and `command_delay` tell already."""
    at, period = setup.memory.lock_in, setup.period
    frequency = 2.0 * math.pi * setup.lock_in.frequency
    y_cos, y_sin, a_cos, a_sin = at.y_cos, at.y_sin, at.a_cos, at.a_sin
    # 1. -Y conj(A) of each joint, and of all together.
    re = -(y_cos * a_cos + y_sin * a_sin)
    im = y_cos * a_sin - y_sin * a_cos
    all_re, all_im = np.sum(re), np.sum(im)
    # 2. The delay from three quarters of an oscillation down to minus one quarter.
    turns = -np.arctan2(all_im, all_re) * (0.5 / math.pi)
    cycle = 2.0 * math.pi / frequency
    turns = turns - (0.5 * period + known_delay) / cycle
    turns = turns - np.floor(turns + 0.25)
    delay = turns * cycle
    # 3. How far each joint is from it.
    across, along = im * all_re - re * all_im, re * all_re + im * all_im
    spread = -np.arctan2(across, along) / frequency
    inside = (delay >= -MAX_SPREAD * period) & (delay + known_delay <= MOST * period)
    at.valid = at.valid and every(np.abs(spread) <= MAX_SPREAD * period) and inside
    at.of_joints = spread + delay
    delay = select(delay > 0.0, delay, 0.0)
    # 4. Whole periods are usual: if the difference may be chance, it is so many.
    joints = len(spread)
    error = np.sqrt(np.sum(spread * spread) / (joints * max(joints - 1, 1)))
    integer = period * np.floor(delay / period + 0.5)
    off = np.abs(delay - integer)
    near = (off <= NEAR[0] * period) | (off <= NEAR[1] * error)
    delay = select(near, integer, delay)
    at.delay = select(at.valid, delay, setup.estimator.delay)


@internal
def phase(setup: Any, sample: int) -> int:
    """What it is doing after a sample: OFF, WAITING, RUNNING, FOUND or KEPT."""
    if not setup.identifies:
        return OFF
    if setup.memory.lock_in.end == 0:
        return WAITING if elapsed_samples(setup, sample) < 0 else RUNNING
    return FOUND if setup.memory.lock_in.valid else KEPT


def check(parameters: LockInParameters, period: float) -> None:
    """Refuse so few samples or oscillations that they tell no delay; `period` of samples in s.

    Raises:
        InputError: they are too few.
    """
    frequency, duration = parameters.frequency, parameters.duration
    samples, oscillations = LEAST
    if frequency * period * samples > 1.0:
        fastest = 1.0 / (samples * period)
        raise InputError(
            f'lock_in.frequency must be at most {fastest:g} Hz, {samples} samples of '
            f'{period:g} s to an oscillation, not {frequency:g}',
            'lock_in.frequency',
        )
    if duration * frequency < oscillations:
        raise InputError(
            f'lock_in.duration must be at least {oscillations / frequency:g} s, '
            f'{oscillations} oscillations, not {duration:g}',
            'lock_in.duration',
        )


class Result(NamedTuple):
    """What has been found."""

    phase: int  # OFF, WAITING (or under way), FOUND or KEPT
    delay: float  # the delay, found or assumed [s]; 0 before the end
    of_joints: Array  # what each joint tells by itself [s], shape (n,)
    end: int  # the first sample after the end, counted from the first state; 0 before it


def result(setup: Any) -> Result:
    """What has been found by the cycle with a ControlSetup."""
    at, phase = setup.memory.lock_in, OFF
    if setup.identifies:
        phase = WAITING if not at.end else FOUND if at.valid else KEPT
    end = at.end - at.first if at.end else 0
    return Result(phase, float(at.delay), np.asarray(at.of_joints), int(end))


def phases(setup: Any, samples: NDArray[np.int64], first_fault: int | None) -> NDArray[np.int64]:
    """What a lock-in was doing after samples of a run that it has seen, shape (N,).

    Args:
        setup: The ControlSetup.
        samples: The samples, shape (N,).
        first_fault: The first sample of a fault of the controller, which stays; None without one.
    """
    if not setup.identifies:
        return np.full(len(samples), OFF)
    outcome = result(setup)
    running = samples >= round(setup.lock_in.start / setup.period)
    if first_fault is not None:
        running &= samples <= first_fault
    doing = np.where(running, RUNNING, WAITING)
    return np.where(samples >= outcome.end - 1, outcome.phase, doing) if outcome.end else doing


def delay_text(setup: Any, phase: int, units: JointUnits = HINGES) -> str:
    """What is known of the age of the states, for people; empty where it is not identified.

    Args:
        setup: The ControlSetup.
        phase: OFF, WAITING, RUNNING, FOUND or KEPT.
        units: Units of the joints.
    """
    if not setup.identifies:
        return ''
    lock_in, outcome = setup.lock_in, result(setup)
    low, high = 1e3 * outcome.of_joints.min(), 1e3 * outcome.of_joints.max()
    tell = f'by joint {low:.3f} to {high:.3f} ms'
    known = f'{1e3 * setup.estimator.delay:g} ms assumed'
    if phase == RUNNING:
        size = ', '.join(f'{each:g}' for each in np.unique(lock_in.torque))
        what = f'{size} {units.of("N m")} at {lock_in.frequency:g} Hz are added for'
        length = round(lock_in.duration / setup.period) * setup.period
        return f'{known}, being identified: {what} {length:g} s'
    if phase == FOUND:
        same = f'{1e3 / lock_in.frequency:.4g} ms more would look the same'
        return f'{1e3 * outcome.delay:.4g} ms identified, {tell}; {same}'
    if phase == KEPT:
        most = 1e3 * MAX_SPREAD * setup.period
        return f'{known}, not identified: {tell}, more than {most:g} ms from all, or below 0'
    return f'{known}, not identified yet' if phase == WAITING else ''
