"""Repetitive control: what the law has to correct in every turn of a motion is added in the next.

With c_j the correction of the law in turn j, the torque beyond what the model knows, and u_j the
torque that is added to it,

    u_(j+1)(t) = Q (u_j(t) + gain c_j(t + lead)),   c_j = T (D - u_j)

where D is the unknown torque that comes back in each turn and T the complementary sensitivity of
law and robot, 1 at low frequencies for every law that follows at all. So whatever the law is, what
is learned converges where |Q (1 - gain T e^(i w lead))| < 1, to D but for a share
(1 - Q) / (1 - Q (1 - gain T e^(i w lead))). Q is a low-pass filter without phase: two Gaussians,
H (2 - H), between 0 and 1 at all frequencies. What does not come back is learned as noise: it adds
gain / (2 - gain) to the variance of the unknown torque below the cutoff.

Source:
    Bristow, Tharayil, Alleyne (2006), A survey of iterative learning control, IEEE Control Systems
    Magazine 26(3), for the condition and what remains; Hara, Yamamoto, Omata, Nakano (1988),
    Repetitive control system, IEEE TAC 33(7), for motions without rest between the turns; Longman
    (2000), Int. J. Control 73(10), for the lead and the cutoff; Kawato, Furukawa, Suzuki (1987),
    Biological Cybernetics 57, for learning from the torque of a feedback.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.estimation.recent_torques import samples_of
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    Struct,
    clip,
    every,
    internal,
    read_row,
    select,
    write_row,
)
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import Model, inverse_dynamics
from trajectory_gen.trajectory import Trajectory

OF_MOTION = 'motion'
LONGEST = 60_000  # samples of a turn
WIDEST = 1000  # samples to either side of the one for which Q is computed
WIDTH = 3.5  # standard deviations, after which a Gaussian ends
INTEGER_TOLERANCE = 1e-6  # samples by which a turn may miss a whole number of them
LOOKS = 64  # times of a turn at which a motion is compared with the next turn
REPEATED = 1e-9  # of its size, by which it may differ there
SAME = 1e-5  # rad, beside the way of one sample, by which a reference differs from another motion
FADE = 0.1  # s, in which what was learned comes in or goes out


class RepetitionParameters(NamedTuple):
    """What is learned from turn to turn of a motion that repeats."""

    gain: Annotated[
        float,
        Field('', 'share of the correction of a turn that the next one adds; 0: none', 0.0, 1.0),
    ]
    period: Annotated[
        float | Literal['motion'],
        Field('s', 'of a turn, a whole number of samples; motion: as of the motion', 0.0),
    ]
    lead: Annotated[
        float, Field('s', 'by which a correction comes later than what it corrects', 0.0, 1.0)
    ]
    cutoff: Annotated[float, Field('Hz', 'above which nothing is learned', 1e-3)]
    wait: Annotated[
        float, Field('s', 'after a start, a fault or a switch before it learns', 0.0, 1000.0)
    ]


class RepetitionMemory(NamedTuple):
    """What was learned of a turn of T samples, as a Struct; a row a sample, shape (T, n)."""

    newest: int  # sample
    next: int  # row that is to be emptied
    stop: int  # and the one after the last of them
    steady_samples: int  # since how many samples the law has been alone
    weight: float  # of what was learned
    model: bool  # whether the law knows the model
    weights: Array  # of Q, from its centre on, shape (side + 1,)
    reference: Array  # [rad]; NaN where nothing was learned
    learned: Array  # [N m]
    added: Array  # what Q makes of it [N m]


def repetition_memory(
    parameters: RepetitionParameters, joints: int, samples: int, period: float
) -> Struct:
    """Before the first turn.

    Args:
        parameters: The parameters.
        joints: Number of the actuated joints, n.
        samples: Samples of a turn, of :func:`repetition_samples_of`; 0 where nothing is learned.
        period: Control period [s].
    """
    weights = weights_of(parameters.cutoff, period) if samples else np.ones(1)
    rows = [np.zeros((samples, joints)) for _ in range(3)]
    return Struct(RepetitionMemory(0, 0, 0, 0, 0.0, False, weights, *rows))


def repetition_samples_of(
    parameters: RepetitionParameters, trajectory: Trajectory, period: float
) -> int:
    """Samples of a turn.

    Args:
        parameters: The parameters.
        trajectory: The desired motion.
        period: Control period [s].

    Raises:
        InputError: the motion does not repeat, or not after a whole number of samples; a turn is
            too long, or too short for the filter.
    """
    key, given = 'repetition.period', parameters.period
    name = f'trajectory.shape {trajectory.parameters.shape}'
    time = trajectory.span if given == OF_MOTION else float(given)
    if given == OF_MOTION and (time == 0.0 or not repeats(trajectory, time)):
        raise InputError(f'repetition.gain must be 0: {name} does not repeat', 'repetition.gain')
    samples = round(time / period)
    if abs(time / period - samples) > INTEGER_TOLERANCE:
        text = f'{key} must be a whole number of samples of {period:g} s, not {time / period:.9g}'
        if given == OF_MOTION and samples:
            factor = trajectory.parameters.speed_factor * time / (samples * period)
            text += f': trajectory.speed_factor {factor:.17g} makes {name} so'
        raise InputError(text, key)
    if not 1 <= samples <= LONGEST:
        raise InputError(f'{key} must be {period:g} to {LONGEST * period:g} s, not {time:g}', key)
    if not repeats(trajectory, time):
        raise InputError(f'{key} must be that of the motion: {name} does not repeat after '
                         f'{time:g} s', key)  # fmt: skip
    lead, side = round(parameters.lead / period), len(weights_of(parameters.cutoff, period)) - 1
    most = min(WIDEST, (samples - lead - 1) // 2)
    if side > most:
        least = parameters.cutoff * side / max(most - 2, 1)
        raise InputError(
            f'repetition.cutoff must be at least {least:.3g} Hz with turns of {samples} samples, '
            f'not {parameters.cutoff:g}',
            'repetition.cutoff',
        )
    return samples


def repeats(trajectory: Trajectory, time: float) -> bool:
    """Whether a motion is after a time [s] what it was; one that rests at its end is not."""
    times = time * np.arange(LOOKS) / LOOKS
    before, after = (trajectory.poses(each) for each in (times, times + time))
    return all(
        np.allclose(*each, rtol=REPEATED, atol=REPEATED * (1.0 + np.abs(each[0]).max()))
        for each in zip(before, after, strict=True)
    )


def weights_of(cutoff: float, period: float) -> Array:
    """Weights of Q from its centre on, which is -3 dB at the cutoff [Hz], shape (side + 1,)."""
    h = 1.0 - math.sqrt(1.0 - math.sqrt(0.5))  # of the Gaussian H at the cutoff
    deviation = math.sqrt(-2.0 * math.log(h)) / (2.0 * math.pi * cutoff * period)
    half = math.ceil(WIDTH * deviation)
    gaussian = np.exp(-0.5 * np.square(np.arange(-half, half + 1) / deviation))
    gaussian /= gaussian.sum()
    twice = -np.convolve(gaussian, gaussian)
    twice[half : 3 * half + 1] += 2.0 * gaussian
    weights: Array = twice[2 * half :]
    return weights


@internal
def recalled(
    setup: Any,
    sample: int,
    initialized: bool,
    alone: bool,
    switched: bool,
    reference: JointReference,
) -> Array:
    """Torque that is added at a sample [N m], shape (n,).

    Args:
        setup: The ControlSetup.
        sample: Index of the sample.
        initialized: Whether there was a state before.
        alone: Whether the desired motion is followed without an approach.
        switched: Whether law or gains are new.
        reference: The desired motion.
    """
    at, samples, zero = (
        setup.memory.repetition,
        setup.repetition_samples,
        np.zeros_like(reference.position),
    )
    # 1. A memory that is empty: its rows are emptied one by one, before each is used.
    if not initialized or sample <= at.newest or at.model != setup.has_model:
        at.next = sample - samples_of(setup, setup.repetition.lead) - 2 * _side(at)
        at.stop = at.next + samples
        at.newest, at.steady_samples, at.weight, at.model = sample, 0, 0.0, setup.has_model
    stop = min(at.stop, sample + 1)
    for k in range(at.next, stop):
        write_row(at.reference, k % samples, zero + np.nan)
        write_row(at.learned, k % samples, zero)
        write_row(at.added, k % samples, zero)
    at.next = max(at.next, stop)
    # 2. How long nothing has disturbed the law, and how much of what it learned counts.
    at.steady_samples = select(alone and not switched, at.steady_samples + (sample - at.newest), 0)
    ready = at.weight > 0.0 or at.steady_samples >= samples_of(setup, setup.repetition.wait)
    comes = _repeated(setup, sample, reference) and ready
    fade = setup.period / FADE
    fade = select(comes, fade, -fade)
    at.weight = select(alone, clip(at.weight + fade, 0.0, 1.0), 0.0)
    at.newest = sample
    return at.weight * read_row(at.added, sample % samples, zero)


@internal
def correction(
    setup: Any,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    torque: Array,
) -> Array:
    """What of the torque of a law corrects [N m], shape (n,); arguments as of its update."""
    if not setup.has_model:
        return torque
    return torque - inverse_dynamics(model, reference.acceleration, feedback.velocity)


@internal
def learn(
    setup: Any,
    sample: int,
    reference: JointReference,
    added: Array,
    correction: Array,
    believed: bool,
) -> None:
    """Take a sample into account, and find what the next turn adds.

    Args:
        setup: The ControlSetup.
        sample: Index of the sample.
        reference: The desired motion.
        added: What :func:`recalled` returned [N m], shape (n,).
        correction: Torque of the law beyond what the model knows [N m], shape (n,).
        believed: Whether it is known that the correction was applied.
    """
    at, samples, gain = setup.memory.repetition, setup.repetition_samples, setup.repetition.gain
    limit = setup.safety.torque_limit
    lead = samples_of(setup, setup.repetition.lead)
    wait = samples_of(setup, setup.repetition.wait)
    if at.steady_samples < wait:
        return
    row, zero = sample % samples, np.zeros_like(added)
    before = read_row(at.added, row, zero)
    before = select(_repeated(setup, sample, reference), before, zero)
    write_row(at.learned, row, before + gain * (added - before))
    write_row(at.reference, row, reference.position)
    late = sample - lead
    if believed and at.steady_samples >= wait + lead:
        learned = read_row(at.learned, late % samples, zero) + gain * correction
        write_row(at.learned, late % samples, clip(learned, -limit, limit))
    centre = (late - _side(at)) % samples
    write_row(at.added, centre, _filtered(at, centre, samples, zero))


@internal
def _side(memory: Any) -> int:
    """Samples to either side of the one for which Q is computed."""
    return len(memory.weights) - 1


@internal
def _repeated(setup: Any, sample: int, reference: JointReference) -> bool:
    """Whether the reference is that of the last turn."""
    before = read_row(
        setup.memory.repetition.reference, sample % setup.repetition_samples, reference.position
    )
    off = reference.position - before
    return every(np.abs(off) <= SAME + setup.period * np.abs(reference.velocity))


@internal
def _filtered(memory: Any, centre: int, samples: int, template: Array) -> Array:
    """What Q makes of all that was learned, at a row of the turn [N m], shape (n,)."""
    rows, weights = memory.learned, memory.weights
    found = weights[0] * read_row(rows, centre, template)
    for k in range(1, len(weights)):
        left, right = centre - k, centre + k
        left, right = (
            select(left < 0, left + samples, left),
            select(right < samples, right, right - samples),
        )
        both = read_row(rows, left, template) + read_row(rows, right, template)
        found = found + weights[k] * both
    return found
