"""Start without a jump: the reference begins where the robot is, and joins the desired motion."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_base.arrays import Array
from parallel_robot_base.fields import Field
from parallel_robot_compiler import clip, inner, select, vector
from parallel_robot_control.braking import largest
from parallel_robot_control.contract import JointReference


class ApproachParameters(NamedTuple):
    """How the robot joins the desired motion."""

    duration: Annotated[
        float, Field('s', 'time over which an initial offset is faded; 0: not at all', 0.0, 100.0)
    ]
    way_back: Annotated[
        float,
        Field('s', 'the same after a fault, a gap or a take-over, at most', 0.001, 100.0),
    ]
    acceleration: Annotated[
        float, Field('rad/s^2', 'most with which offset and rate are faded then, about', 1e-3)
    ]


START, BACK = -1.0, -2.0  # `elapsed` before an approach: to a start, and on a way back
SHORTEST = 0.02  # s, of the time over which a rate is faded
SHARE = 0.3  # of the way back: shortest time for an offset, longest for a rate
GENTLE = 2.0  # times as long as a small offset would need
BENT, BRAKED = 5.774, 3.943  # largest acceleration times T^2 / e, and times B / e'


class Approach(NamedTuple):
    """Where the robot was at the first state, relative to the reference.

    Attributes:
        offset: Of the positions [rad], shape (n,).
        rate: Of the velocities [rad/s], shape (n,).
        elapsed: Time since then [s]; START or BACK before the first state.
        duration: Time over which the offset is faded [s].
        braking: Time over which the rate is faded [s].
    """

    offset: Array
    rate: Array
    elapsed: float
    duration: float
    braking: float


def not_begun(joints: int, elapsed: float = START) -> Approach:
    """Before an approach, START or BACK; `joints` is n."""
    zero = vector(np.zeros(joints))
    return Approach(zero, zero, elapsed, 0.0, 0.0)


@inner
def approached(
    parameters: ApproachParameters,
    before: Approach,
    reference: JointReference,
    position: Array,
    velocity: Array,
    dt: float,
) -> tuple[JointReference, Approach]:
    """The reference with what is left of the initial offset.

    With e and e' the offsets at the first state, x = t / T and y = t / B, it is added

        e (1 - 10 x^3 + 15 x^4 - 6 x^5) + e' B (y - 6 y^3 + 8 y^4 - 3 y^5),

    quintics that end with zero position, rate and acceleration at x = 1 and y = 1. At a start
    B = T. On a way back T is longer for a large offset, and B is only as long as the acceleration
    asks for, since the robot goes on by 0.2 e' B before it turns.

    Args:
        parameters: T at a start and on a way back; with 0, the reference stays as it is.
        before: The approach at the state before.
        reference: Desired motion when the torque acts.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        dt: Time since the state before [s].

    Returns:
        The reference, and the approach for the next state.
    """
    e, v, t = before.offset, before.rate, before.elapsed + dt
    duration, braking = before.duration, before.braking
    if before.elapsed < 0.0:
        e, v, t = position - reference.position, velocity - reference.velocity, 0.0
        duration = braking = parameters.duration
        if before.elapsed == BACK:
            fast, most = parameters.acceleration, parameters.way_back
            bent = math.sqrt(BENT * largest(e) / fast)
            gentle = clip(GENTLE * bent, SHARE * most, most)
            gentle = select(gentle > bent, gentle, bent)
            duration = select(duration > gentle, duration, gentle)
            braking = BRAKED * largest(v) / fast
            braking = clip(braking, SHORTEST, SHARE * most)
    after = Approach(e, v, t, duration, braking)
    if not (t < duration or t < braking):
        return reference, after
    per_time = 1.0 / duration
    x = select(t < duration, t * per_time, 1.0)
    xx = x * x
    left = 1.0 - xx * x * (10.0 - x * (15.0 - 6.0 * x))
    left_rate = -30.0 * xx * (1.0 - x) * (1.0 - x) * per_time
    left_acceleration = -60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * per_time * per_time
    per_time = 1.0 / braking
    x = select(t < braking, t * per_time, 1.0)
    xx = x * x
    turn = braking * x * (1.0 - xx * (6.0 - x * (8.0 - 3.0 * x)))
    turn_rate = 1.0 - xx * (18.0 - x * (32.0 - 15.0 * x))
    turn_acceleration = -x * (36.0 - x * (96.0 - 60.0 * x)) * per_time
    joined = JointReference(
        reference.position + (e * left + v * turn),
        reference.velocity + (e * left_rate + v * turn_rate),
        reference.acceleration + (e * left_acceleration + v * turn_acceleration),
    )
    return joined, after
