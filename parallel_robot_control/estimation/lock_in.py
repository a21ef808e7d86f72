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

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import HINGES, Array, JointUnits
from parallel_robot_model.compiler import Struct, every, inner, select, solve, vector
from parallel_robot_model.configuration.fields import Field, PerJoint
from parallel_robot_model.robots.contract import Model

NEAR = 0.05, 2.0  # periods, standard errors from a whole number of periods, which it then is
APART = 0.5  # periods by which a joint may tell another delay than all together
GAP = 28  # samples; after more without a state it begins anew

OFF, WAITING, UNDER_WAY, FOUND, KEPT = range(5)  # phases


class LockIn(NamedTuple):
    """The lock-in as the kernels take it."""

    on: bool  # whether the delay is to be identified
    period: float  # of the samples [s]
    torque: Array  # amplitudes of the sine [N m], shape (n,)
    frequency: float  # W, its angular frequency [rad/s]
    start: int  # samples before it begins
    length: int  # samples that it lasts
    most: float  # largest delay that can be predicted [s]
    memory: Any  # its LockInMemory, a Struct


class LockInMemory(NamedTuple):
    """What is remembered of an identification, as a Struct."""

    first: int  # the first sample
    end: int  # the first sample after the end; 0 before it
    last: int  # the newest sample
    sound: bool  # whether nothing speaks against what is found
    weight: float  # sum of the weights h
    age: float  # of the states, weighted sum [s]
    delay: float  # the delay, found or assumed [s]
    y_cos: Array  # parts of Y and A of each joint, shape (n,)
    y_sin: Array
    a_cos: Array
    a_sin: Array
    of_joints: Array  # what each joint tells by itself [s], shape (n,)


def lock_in_memory(zero: Array) -> Struct:
    """Before the first state; `zero`: a vector, shape (n,)."""
    return Struct(LockInMemory(0, 0, 0, False, 0.0, 0.0, 0.0, zero, zero, zero, zero, zero))


@inner
def delay_at(lock_in: LockIn, assumed: float, known: bool) -> float:
    """Age of a state that its stamp does not tell [s], as known before the state.

    Args:
        lock_in: The lock-in.
        assumed: The age without it.
        known: Whether there was a state before.
    """
    if lock_in.on and known and lock_in.memory.end > 0:
        return lock_in.memory.delay
    return assumed


@inner
def begin(lock_in: LockIn, sample: int, known: bool, failed: bool, like: Array) -> None:
    """Begin anew in a new run, and if a fault or missing states have interrupted it.

    Args:
        lock_in: The lock-in.
        sample: Index of the sample.
        known: Whether there was a state before.
        failed: Whether the controller is in a fault.
        like: Any vector of shape (n,).
    """
    at = lock_in.memory
    broken = sample - at.last > GAP or failed
    if not known or (broken and at.end == 0):
        at.first, at.end, at.sound = sample, 0, True
        at.weight, at.age, at.delay = 0.0, 0.0, 0.0
        zero = np.zeros_like(like)
        at.y_cos, at.y_sin, at.a_cos, at.a_sin, at.of_joints = zero, zero, zero, zero, zero
    at.last = sample


@inner
def place(lock_in: LockIn, sample: int) -> int:
    """How many samples it has lasted at a sample; negative before it begins and after its end."""
    since = sample - lock_in.memory.first - lock_in.start
    over = lock_in.memory.end > 0 or since >= lock_in.length
    return -1 if over else since


@inner
def added(lock_in: LockIn, sample: int) -> Array:
    """Torque that is added at a sample [N m], shape (n,)."""
    k = place(lock_in, sample)
    size = 0.0
    if k >= 0:
        size = _window(lock_in, k) * math.sin(lock_in.frequency * lock_in.period * k)
    return lock_in.torque * size


@inner
def observe(
    lock_in: LockIn,
    sample: int,
    model: Model,
    error: Array,
    torque: Array,
    age: float,
    command_delay: float,
    lag: float,
    assumed: float,
    failed: bool,
) -> None:
    """Take a state and its torque into account; after the last one, find the delay.

    Args:
        lock_in: The lock-in.
        sample: Index of the sample from which on the torque acts, but for `command_delay`.
        model: Nominal model.
        error: Measured joints less reference [rad], shape (n,); slow but for the oscillation.
        torque: The torque, within its limits [N m], shape (n,).
        age: Of the state at the sample, as its stamp tells [s].
        command_delay: From a command until it acts [s].
        lag: Time constant of the motors after that [s].
        assumed: Delay without the lock-in [s].
        failed: Whether the controller is in a fault.
    """
    at = lock_in.memory
    if at.end == 0 and failed:
        at.sound = False
    k = place(lock_in, sample)
    if k < 0:
        return
    h = _window(lock_in, k)
    weight, angle = h * h, lock_in.frequency * lock_in.period * k
    cosine, sine = weight * math.cos(angle), -weight * math.sin(angle)
    pushed = solve(model.M, torque)
    at.y_cos, at.y_sin = at.y_cos + cosine * error, at.y_sin + sine * error
    at.a_cos, at.a_sin = at.a_cos + cosine * pushed, at.a_sin + sine * pushed
    at.age += weight * age
    at.weight += weight
    if k == lock_in.length - 1:
        told = at.age / at.weight + command_delay
        told += math.atan(lock_in.frequency * lag) / lock_in.frequency
        _end(lock_in, told, assumed)
        at.end = sample + 1


@inner
def _window(lock_in: LockIn, k: int) -> float:
    """Amplitude of the sine, 0 to 1 (Hann); as a weight, squared, it lets nothing slow through."""
    sine = math.sin(math.pi * (k + 0.5) / lock_in.length)
    return sine * sine


@inner
def _end(lock_in: LockIn, told: float, assumed: float) -> None:
    """Find the delay, beside `told` [s], that stamps and `command_delay` tell already."""
    at, period = lock_in.memory, lock_in.period
    y_cos, y_sin, a_cos, a_sin = at.y_cos, at.y_sin, at.a_cos, at.a_sin
    # 1. -Y conj(A) of each joint, and of all together.
    re = -(y_cos * a_cos + y_sin * a_sin)
    im = y_cos * a_sin - y_sin * a_cos
    all_re, all_im = np.sum(re), np.sum(im)
    # 2. The delay from three quarters of an oscillation down to minus one quarter.
    turns = -np.arctan2(all_im, all_re) * (0.5 / math.pi)
    cycle = 2.0 * math.pi / lock_in.frequency
    turns = turns - (0.5 * period + told) / cycle
    turns = turns - np.floor(turns + 0.25)
    delay = turns * cycle
    # 3. How far each joint is from it.
    across, along = im * all_re - re * all_im, re * all_re + im * all_im
    apart = -np.arctan2(across, along) / lock_in.frequency
    inside = (delay >= -APART * period) & (delay + told <= lock_in.most)
    at.sound = at.sound and every(np.abs(apart) <= APART * period) and inside
    at.of_joints = apart + delay
    delay = select(delay > 0.0, delay, 0.0)
    # 4. Whole periods are usual: if the difference may be chance, it is so many.
    joints = len(apart)
    error = np.sqrt(np.sum(apart * apart) / (joints * max(joints - 1, 1)))
    whole = period * np.floor(delay / period + 0.5)
    off = np.abs(delay - whole)
    near = (off <= NEAR[0] * period) | (off <= NEAR[1] * error)
    delay = select(near, whole, delay)
    at.delay = select(at.sound, delay, assumed)


@inner
def phase(lock_in: LockIn, sample: int) -> int:
    """What it is doing after a sample: OFF, WAITING, UNDER_WAY, FOUND or KEPT."""
    if not lock_in.on:
        return OFF
    if lock_in.memory.end == 0:
        return WAITING if place(lock_in, sample) < 0 else UNDER_WAY
    return FOUND if lock_in.memory.sound else KEPT


# Identification of the age of the states: its parameters, what refuses it, what it tells.

LEAST = 4, 20  # samples of an oscillation, oscillations


class LockInParameters(NamedTuple):
    """How ``estimator.delay: identify`` finds the age of the states."""

    torque: Annotated[PerJoint, Field('N m', 'amplitude of the sine that is added', 1e-6)]
    frequency: Annotated[float, Field('Hz', 'its frequency', 0.1)]
    start: Annotated[float, Field('s', 'when it begins, after the first state', 0.0, 1000.0)]
    duration: Annotated[float, Field('s', 'how long it lasts', 0.0, 1000.0)]
    delay: Annotated[float, Field('s', 'age that is assumed until it has ended', 0.0)]


def lock_in_of(
    parameters: LockInParameters, on: bool, period: float, most: float, memory: Struct
) -> LockIn:
    """Make the lock-in from its parameters; `on`: whether it is to run; see :class:`LockIn`.

    Raises:
        InputError: so few samples or oscillations tell no delay.
    """
    frequency, duration = parameters.frequency, parameters.duration
    samples, oscillations = LEAST
    if on and frequency * period * samples > 1.0:
        fastest = 1.0 / (samples * period)
        raise InputError(
            f'lock_in.frequency must be at most {fastest:g} Hz, {samples} samples of '
            f'{period:g} s to an oscillation, not {frequency:g}',
            'lock_in.frequency',
        )
    if on and duration * frequency < oscillations:
        raise InputError(
            f'lock_in.duration must be at least {oscillations / frequency:g} s, '
            f'{oscillations} oscillations, not {duration:g}',
            'lock_in.duration',
        )
    return LockIn(
        on,
        period,
        vector(parameters.torque),
        2.0 * math.pi * frequency,
        round(parameters.start / period),
        round(duration / period),
        most,
        memory,
    )


class Result(NamedTuple):
    """What has been found."""

    phase: int  # OFF, WAITING (or under way), FOUND or KEPT
    delay: float  # the delay, found or assumed [s]; 0 before the end
    of_joints: Array  # what each joint tells by itself [s], shape (n,)
    end: int  # the first sample after the end, counted from the first state; 0 before it


def result(lock_in: LockIn) -> Result:
    """What a lock-in has found."""
    at, phase = lock_in.memory, OFF
    if lock_in.on:
        phase = WAITING if not at.end else FOUND if at.sound else KEPT
    end = at.end - at.first if at.end else 0
    return Result(phase, float(at.delay), np.asarray(at.of_joints), int(end))


def phases(
    lock_in: LockIn, samples: NDArray[np.int64], first_fault: int | None
) -> NDArray[np.int64]:
    """What a lock-in was doing after samples of a run that it has seen, shape (N,).

    Args:
        lock_in: The lock-in.
        samples: The samples, shape (N,).
        first_fault: The first sample of a fault of the controller, which stays; None without one.
    """
    if not lock_in.on:
        return np.full(len(samples), OFF)
    outcome = result(lock_in)
    under_way = samples >= lock_in.start
    if first_fault is not None:
        under_way &= samples <= first_fault
    doing = np.where(under_way, UNDER_WAY, WAITING)
    return np.where(samples >= outcome.end - 1, outcome.phase, doing) if outcome.end else doing


def text(
    lock_in: LockIn, outcome: Result, assumed: float, phase: int, units: JointUnits = HINGES
) -> str:
    """What it is doing, for people; empty where the delay is not identified.

    Args:
        lock_in: The lock-in.
        outcome: What has been found.
        assumed: The delay without it [s].
        phase: OFF, WAITING, UNDER_WAY, FOUND or KEPT.
        units: Units of the joints.
    """
    low, high = 1e3 * outcome.of_joints.min(), 1e3 * outcome.of_joints.max()
    tell = f'by joint {low:.3f} to {high:.3f} ms'
    known = f'{1e3 * assumed:g} ms assumed'
    if phase == UNDER_WAY:
        size = ', '.join(f'{each:g}' for each in np.unique(lock_in.torque))
        what = (
            f'{size} {units.of("N m")} at {lock_in.frequency / 2.0 / math.pi:g} Hz are added for'
        )
        return f'{known}, being identified: {what} {lock_in.length * lock_in.period:g} s'
    if phase == FOUND:
        cycle = 2e3 * math.pi / lock_in.frequency
        same = f'{cycle:.4g} ms more would look the same'
        return f'{1e3 * outcome.delay:.4g} ms identified, {tell}; {same}'
    if phase == KEPT:
        most = 1e3 * APART * lock_in.period
        return f'{known}, not identified: {tell}, more than {most:g} ms from all, or below 0'
    return f'{known}, not identified yet' if phase == WAITING else ''
