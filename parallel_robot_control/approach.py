"""Start without a jump: the reference begins where the robot is, and joins the desired motion."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_base.arrays import Array
from parallel_robot_base.fields import Field
from parallel_robot_compiler import inner, vector
from parallel_robot_control.contract import JointReference


class ApproachParameters(NamedTuple):
    """How the robot joins the desired motion."""

    duration: Annotated[
        float, Field('s', 'time over which an initial offset is faded; 0: not at all', 0.0, 100.0)
    ]
    way_back: Annotated[
        float,
        Field('s', 'the same, at least, after a fault, a gap or a take-over', 0.001, 100.0),
    ]


START, BACK = -1.0, -2.0  # values of `elapsed` before an approach begins: at the start, on the way
# back


class Approach(NamedTuple):
    """Where the robot was at the first state, relative to the reference.

    Attributes:
        offset: Of the positions [rad], shape (n,).
        rate: Of the velocities [rad/s], shape (n,).
        elapsed: Time since then [s]; START or BACK before the first state.
        duration: Time over which they are faded [s].
    """

    offset: Array
    rate: Array
    elapsed: float
    duration: float


def not_begun(joints: int, elapsed: float = START) -> Approach:
    """Before an approach, START or BACK; `joints` is n."""
    zero = vector(np.zeros(joints))
    return Approach(zero, zero, elapsed, 0.0)


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

    With e and e' the offsets at the first state and x = t / T, it is added

        e (1 - 10 x^3 + 15 x^4 - 6 x^5) + e' T (x - 6 x^3 + 8 x^4 - 3 x^5),

    the quintic that ends with zero position, rate and acceleration at x = 1.

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
    duration = before.duration
    if before.elapsed < 0.0:
        e, v, t = position - reference.position, velocity - reference.velocity, 0.0
        duration = parameters.duration
        if before.elapsed == BACK and duration < parameters.way_back:
            duration = parameters.way_back
    after = Approach(e, v, t, duration)
    if not t < duration:
        return reference, after
    per_time = 1.0 / duration
    x = t * per_time
    xx = x * x
    left = 1.0 - xx * x * (10.0 - x * (15.0 - 6.0 * x))
    left_rate = -30.0 * xx * (1.0 - x) * (1.0 - x) * per_time
    left_acceleration = -60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * per_time * per_time
    turn = duration * x * (1.0 - xx * (6.0 - x * (8.0 - 3.0 * x)))
    turn_rate = 1.0 - xx * (18.0 - x * (32.0 - 15.0 * x))
    turn_acceleration = -x * (36.0 - x * (96.0 - 60.0 * x)) * per_time
    joined = JointReference(
        reference.position + (e * left + v * turn),
        reference.velocity + (e * left_rate + v * turn_rate),
        reference.acceleration + (e * left_acceleration + v * turn_acceleration),
    )
    return joined, after
