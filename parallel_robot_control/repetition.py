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
from typing import Annotated, Literal, NamedTuple

import numpy as np

from parallel_robot_control.contract import Feedback, JointReference, Law
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    Space,
    clip,
    every,
    inner,
    read_at,
    select,
    write_at,
)
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import Model, inverse_dynamics
from trajectory_gen.trajectory import Trajectory

OF_MOTION = 'motion'
LONGEST = 60_000  # samples of a turn
WIDEST = 1000  # samples to either side of the one for which Q is computed
WIDTH = 3.5  # standard deviations, after which a Gaussian ends
WHOLE = 1e-6  # samples by which a turn may miss a whole number of them
LOOKS = 64  # times of a turn at which a motion is compared with the next turn
REPEATED = 1e-9  # of its size, by which it may differ there
SAME = 1e-5  # rad, beside the way of one sample, by which a reference differs from another motion
FADE = 0.1  # s, in which what was learned comes in or goes out

# Floats in the first rows: newest sample, next row to be emptied, the last one, since how many
# samples the law has been alone, weight of what was learned, whether the law knows the model.
NEWEST, NEXT, STOP, CALM, WEIGHT, MODEL = range(6)
HEAD = 6  # rows
REFERENCE, LEARNED, ADDED, PARTS = range(4)  # rows of each sample of a turn


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


class Repetition(NamedTuple):
    """The same as the kernels take it."""

    on: bool  # whether anything is learned
    gain: float  # share of a correction that is learned
    turn: int  # samples of a turn
    lead: int  # samples by which a correction comes late
    wait: int  # samples before it learns
    fade: float  # change of the weight in a sample
    period: float  # of the samples [s]
    model: bool  # whether the law adds what the model knows; if not, that is learned, too
    side: int  # samples to either side of the one for which Q is computed
    weights: int  # address of the weights of Q, from its centre on: side + 1
    memory: int  # address of the memory, see :func:`rows`


def turn_of(parameters: RepetitionParameters, trajectory: Trajectory, period: float) -> int:
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
    turn = round(time / period)
    if abs(time / period - turn) > WHOLE:
        text = f'{key} must be a whole number of samples of {period:g} s, not {time / period:.9g}'
        if given == OF_MOTION and turn:
            factor = trajectory.parameters.speed_factor * time / (turn * period)
            text += f': trajectory.speed_factor {factor:.17g} makes {name} so'
        raise InputError(text, key)
    if not 1 <= turn <= LONGEST:
        raise InputError(f'{key} must be {period:g} to {LONGEST * period:g} s, not {time:g}', key)
    if not repeats(trajectory, time):
        raise InputError(f'{key} must be that of the motion: {name} does not repeat after '
                         f'{time:g} s', key)  # fmt: skip
    lead, side = round(parameters.lead / period), len(weights_of(parameters.cutoff, period)) - 1
    most = min(WIDEST, (turn - lead - 1) // 2)
    if side > most:
        least = parameters.cutoff * side / max(most - 2, 1)
        raise InputError(
            f'repetition.cutoff must be at least {least:.3g} Hz with turns of {turn} samples, '
            f'not {parameters.cutoff:g}',
            'repetition.cutoff',
        )
    return turn


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


def rows(turn: int) -> int:
    """Rows of n floats that the memory of a turn takes; none where nothing is learned."""
    return HEAD + PARTS * turn if turn else 0


def repetition_of(
    parameters: RepetitionParameters, turn: int, law: Law, period: float, memory: Space
) -> Repetition:
    """Make what the kernels take.

    Args:
        parameters: The parameters.
        turn: Samples of a turn, of :func:`turn_of`.
        law: The law; one with ``MODEL = False`` does not add what the model knows.
        period: Control period [s].
        memory: :func:`rows` of n floats, which laws that follow each other share.
    """
    weights = weights_of(parameters.cutoff, period) if turn else np.ones(1)
    return Repetition(
        turn > 0,
        parameters.gain,
        turn,
        round(parameters.lead / period),
        round(parameters.wait / period),
        period / FADE,
        period,
        bool(getattr(law, 'MODEL', True)),  # optional in the contract
        len(weights) - 1,
        Space.within(weights),
        memory,
    )


@inner
def recalled(
    repetition: Repetition,
    sample: int,
    known: bool,
    alone: bool,
    switched: bool,
    reference: JointReference,
) -> Array:
    """Torque that is added at a sample [N m], shape (n,).

    Args:
        repetition: The parameters.
        sample: Index of the sample.
        known: Whether there was a state before.
        alone: Whether the desired motion is followed without an approach.
        switched: Whether law or gains are new.
        reference: The desired motion.
    """
    at, like = repetition.memory, reference.position
    newest, weight = read_at(at, NEWEST, 0.0), read_at(at, WEIGHT, 0.0)
    model = select(repetition.model, 1.0, 0.0)
    # 1. A memory that is empty: its rows are emptied one by one, before each is used.
    if not known or sample <= newest or read_at(at, MODEL, 0.0) != model:
        begin = sample - repetition.lead - 2 * repetition.side
        write_at(at, NEXT, float(begin))
        write_at(at, STOP, float(begin + repetition.turn))
        write_at(at, CALM, 0.0)
        write_at(at, MODEL, model)
        newest, weight = float(sample), 0.0
    begin, stop = int(read_at(at, NEXT, 0.0)), min(int(read_at(at, STOP, 0.0)), sample + 1)
    for k in range(begin, stop):
        row = HEAD + k % repetition.turn
        write_at(at, row + REFERENCE * repetition.turn, np.zeros_like(like) + np.nan)
        write_at(at, row + LEARNED * repetition.turn, np.zeros_like(like))
        write_at(at, row + ADDED * repetition.turn, np.zeros_like(like))
    write_at(at, NEXT, float(max(begin, stop)))
    # 2. How long nothing has disturbed the law, and how much of what it learned counts.
    calm = select(alone and not switched, read_at(at, CALM, 0.0) + (sample - newest), 0.0)
    comes = _repeated(repetition, sample, reference) and (weight > 0.0 or calm >= repetition.wait)
    fade = select(comes, repetition.fade, -repetition.fade)
    weight = select(alone, clip(weight + fade, 0.0, 1.0), 0.0)
    write_at(at, NEWEST, float(sample))
    write_at(at, CALM, calm)
    write_at(at, WEIGHT, weight)
    return weight * _row(repetition, ADDED, sample, like)


@inner
def correction(
    repetition: Repetition,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    torque: Array,
) -> Array:
    """What of the torque of a law corrects [N m], shape (n,); arguments as of its update."""
    if not repetition.model:
        return torque
    return torque - inverse_dynamics(model, reference.acceleration, feedback.velocity)


@inner
def learn(
    repetition: Repetition,
    sample: int,
    reference: JointReference,
    added: Array,
    correction: Array,
    believed: bool,
    limit: Array,
) -> None:
    """Take a sample into account, and find what the next turn adds.

    Args:
        repetition: The parameters.
        sample: Index of the sample.
        reference: The desired motion.
        added: What :func:`recalled` returned [N m], shape (n,).
        correction: Torque of the law beyond what the model knows [N m], shape (n,).
        believed: Whether it is known that the correction was applied.
        limit: Largest torque [N m], shape (n,); no more is learned.
    """
    at, turn, gain = repetition.memory, repetition.turn, repetition.gain
    calm = read_at(at, CALM, 0.0)
    if calm < repetition.wait:
        return
    row = HEAD + sample % turn
    before = read_at(at, row + ADDED * turn, added)
    before = select(_repeated(repetition, sample, reference), before, np.zeros_like(added))
    write_at(at, row + LEARNED * turn, before + gain * (added - before))
    write_at(at, row + REFERENCE * turn, reference.position)
    late = sample - repetition.lead
    if believed and calm >= repetition.wait + repetition.lead:
        learned = _row(repetition, LEARNED, late, added) + gain * correction
        write_at(at, HEAD + late % turn + LEARNED * turn, clip(learned, -limit, limit))
    centre = (late - repetition.side) % turn
    write_at(at, HEAD + centre + ADDED * turn, _filtered(repetition, centre, added))


@inner
def _row(repetition: Repetition, part: int, sample: int, like: Array) -> Array:
    """What is kept for a sample of a turn, shape (n,), as `like`."""
    turn = repetition.turn
    return read_at(repetition.memory, HEAD + part * turn + sample % turn, like)


@inner
def _repeated(repetition: Repetition, sample: int, reference: JointReference) -> bool:
    """Whether the reference is that of the last turn."""
    off = reference.position - _row(repetition, REFERENCE, sample, reference.position)
    return every(np.abs(off) <= SAME + repetition.period * np.abs(reference.velocity))


@inner
def _filtered(repetition: Repetition, centre: int, like: Array) -> Array:
    """What Q makes of all that was learned, at a row of the turn [N m], shape (n,)."""
    turn, begin = repetition.turn, HEAD + LEARNED * repetition.turn
    found = read_at(repetition.weights, 0, 0.0) * read_at(repetition.memory, begin + centre, like)
    for k in range(1, repetition.side + 1):
        left, right = centre - k, centre + k
        left, right = (
            select(left < 0, left + turn, left),
            select(right < turn, right, right - turn),
        )
        both = read_at(repetition.memory, begin + left, like)
        both = both + read_at(repetition.memory, begin + right, like)
        found = found + read_at(repetition.weights, k, 0.0) * both
    return found
