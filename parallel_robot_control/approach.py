"""Start without a jump: the reference begins where the robot is, and joins the desired motion."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from parallel_robot_control.contract import JointReference
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, internal, largest, select
from parallel_robot_model.configuration.fields import Field


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


class ApproachMemory(NamedTuple):
    """What is remembered of an approach, as a Struct; see :func:`approached`."""

    offset: Array  # e [rad], shape (n,)
    rate: Array  # e' [rad/s], shape (n,)
    elapsed: float  # t [s]; ENDED where there is no approach
    length: float  # T [s]
    braking: float  # B [s]
    at_once: float  # a


CONTINUES, START, BACK = 0, 1, 2  # what a cycle begins with: nothing new, a start, a way back
ENDED = -1.0  # s, time since the begin where there is no approach
SHORTEST = 0.02  # s, of the time over which a rate is faded
SLOW, DRIFT = 1e-6, 0.0085  # rad/s; rad, 6.7 times by which a rate may go on at the least
SHARE = 0.3  # of the way back: shortest time for an offset, longest for a rate
GENTLE = 2.0  # times as long as a small offset would need
BENT, BRAKED = 5.774, 3.527  # largest acceleration times T^2 / e, and times B / e'
ABRUPT = 3.0  # acceleration with which a way back begins to brake, times B / e'


@internal
def _start(
    parameters: ApproachParameters,
    memory: Any,
    begins: int,
    reference: JointReference,
    position: Array,
    velocity: Array,
) -> None:
    """Begin an approach; the arguments are those of :func:`approached`."""
    e, v = position - reference.position, velocity - reference.velocity
    duration = braking = parameters.duration
    at_once = 0.0
    if begins == BACK:
        fast, most = parameters.acceleration, parameters.way_back
        bent = math.sqrt(BENT * largest(e) / fast)
        gentle = clip(GENTLE * bent, SHARE * most, most)
        gentle = select(gentle > bent, gentle, bent)
        duration = select(duration > gentle, duration, gentle)
        speed = largest(v) + SLOW
        bent, drifts = BRAKED * speed / fast, DRIFT / speed
        braking = clip(select(drifts > bent, drifts, bent), SHORTEST, SHARE * most)
        at_once = ABRUPT
    memory.offset, memory.rate, memory.at_once = e, v, at_once
    memory.length, memory.braking = duration, braking


@internal
def approached(
    parameters: ApproachParameters,
    memory: Any,
    begins: int,
    reference: JointReference,
    position: Array,
    velocity: Array,
    dt: float,
) -> JointReference:
    """The reference with what is left of the initial offset.

    With e and e' the offsets at the first state, x = t / T and y = t / B, it is added

        e (1 - 10 x^3 + 15 x^4 - 6 x^5)
        + e' B (y - 6 y^3 + 8 y^4 - 3 y^5 - a / 2 y^2 (1 - y)^3),

    quintics that end with zero position, rate and acceleration at x = 1 and y = 1. At a start
    B = T and a = 0. On a way back T is longer for a large offset, and B is only as long as the
    acceleration asks for, since the robot goes on by 0.15 e' B before it turns. There a = 3: it
    brakes at once, by -3 e' / B, since the torque goes on from what acts anyhow; with a = 0 it
    would brake harder later, and go farther.

    Args:
        parameters: T at a start and on a way back; with 0, the reference stays as it is.
        memory: An ApproachMemory, as a Struct.
        begins: Whether an approach begins: CONTINUES, START or BACK.
        reference: Desired motion when the torque acts.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,).
        dt: Time since the moment at which the torque before acted [s].
    """
    t = memory.elapsed
    if begins == CONTINUES:
        if t == ENDED:
            return reference
        t += dt
    else:
        t = 0.0
        _start(parameters, memory, begins, reference, position, velocity)
    duration, braking = memory.length, memory.braking
    goes_on = t < duration or t < braking
    memory.elapsed = select(goes_on, t, ENDED)
    if not goes_on:
        return reference
    e, v, a = memory.offset, memory.rate, memory.at_once
    per_time = 1.0 / duration
    x = select(t < duration, t * per_time, 1.0)
    xx = x * x
    remaining = 1.0 - xx * x * (10.0 - x * (15.0 - 6.0 * x))
    remaining_rate = -30.0 * xx * (1.0 - x) * (1.0 - x) * per_time
    remaining_acceleration = -60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * per_time * per_time
    per_time = 1.0 / braking
    x = select(t < braking, t * per_time, 1.0)
    xx = x * x
    y = 1.0 - x
    turn = braking * x * (1.0 - xx * (6.0 - x * (8.0 - 3.0 * x)) - 0.5 * a * x * y * y * y)
    turn_rate = 1.0 - xx * (18.0 - x * (32.0 - 15.0 * x)) - a * x * y * y * (1.0 - 2.5 * x)
    bends = x * (36.0 - x * (96.0 - 60.0 * x)) + a * y * (1.0 - x * (8.0 - 10.0 * x))
    turn_acceleration = -bends * per_time
    return JointReference(
        reference.position + (e * remaining + v * turn),
        reference.velocity + (e * remaining_rate + v * turn_rate),
        reference.acceleration + (e * remaining_acceleration + v * turn_acceleration),
    )
