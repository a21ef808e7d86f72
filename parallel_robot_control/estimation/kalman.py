"""Kalman filter at the age of the states, and prediction to the moment at which the torque acts.

Between two states acts what was asked of the motors, so the last torques are remembered. Time is
cut where the torque changes: nothing need lie on a grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.estimation import cycle_memory, kalman_levels
from parallel_robot_control.estimation.kalman_equations import (
    Kalman,
    Mean,
    corrected,
    moved,
    sign,
    spread,
)
from parallel_robot_control.estimation.kalman_memory import MOST, begin, read, running, write
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel, multiply, select
from parallel_robot_model.robots.contract import Model


class Predicted(NamedTuple):
    """The joints when the torque acts, each shape (n,).

    Attributes:
        position: [rad].
        velocity: [rad/s].
        disturbance: Torque against the motors that the model does not know, w + c + f s [N m].
    """

    position: Array
    velocity: Array
    disturbance: Array


@kernel
def predicted(
    kalman: Kalman,
    model: Model,
    reference: JointReference,
    position: Array,
    velocity: Array,
    before: Array,
    missing: Array,
    moving: bool,
    sample: int,
    late: float,
    dt: float,
) -> Predicted:
    """Take a state into account, and predict to the moment at which the torque acts.

    Args:
        kalman: The filter.
        model: Nominal model at the measured joints.
        reference: Desired motion at the sample.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,); not used unless `kalman.velocities`.
        before: Torque before this sample [N m], shape (n,); used at the first state.
        missing: Torque that was asked for and did not act [N m], shape (n,).
        moving: Whether there was a state before; if not, the robot is at rest.
        sample: Index of the period from whose start on the torque is asked for.
        late: From the measurement to the moment at which the torque acts [s]; what is beyond MOST
            periods does not count.
        dt: Time since the state before was measured [s].
    """
    given, finds = kalman, kalman.levels > 0.0
    period, most = kalman.period, MOST * kalman.period
    late = select(late > most, most, late)
    # 1. From the state before to this one, under the torques that acted.
    if running(kalman, sample, moving):
        x, p = read(kalman, position)
        kalman = kalman_levels.with_levels(kalman)
        mobility = 1.0 / _diagonal(model.M, position)
        start = late + select(dt > most, most, dt)
        j = _periods(start, period)
        while j > 0:
            high = select(start < j * period, start, j * period)
            low = select(late > (j - 1) * period, late, (j - 1) * period)
            h = select(high > low, high - low, 0.0)
            s = sign(kalman, reference, high)
            torque = cycle_memory.acting_at(kalman.memory, sample - j, position)
            torque = torque - missing
            x = moved(kalman, model, x, s, torque, h)
            p = spread(kalman, mobility, p, s, h)
            j -= 1
        of = Mean(p.qq, p.qv, p.qw, p.qc, p.qf)
        miss = position - x.position
        if finds:
            kalman_levels.follow(kalman, 0, given.position, miss * miss - p.qq, dt)
        x, p = corrected(x, p, of, miss, p.qq + kalman.position)
        if kalman.velocities:
            of = Mean(p.qv, p.vv, p.vw, p.vc, p.vf)
            miss = velocity - x.velocity
            if finds:
                kalman_levels.follow(kalman, 1, given.velocity, miss * miss - p.vv, dt)
            x, p = corrected(x, p, of, miss, p.vv + kalman.velocity)
        if finds:
            square = x.disturbance * x.disturbance + p.ww
            kalman_levels.follow(kalman, 2, given.disturbance, square, dt)
    else:
        rate = velocity if kalman.velocities else np.zeros_like(velocity)
        x, p = begin(kalman, moving, position, rate, before)
        kalman_levels.begin(kalman)
    write(kalman, x, p)
    # 2. Over the age of this state, under the torques that were asked for since.
    j = _periods(late, period)
    while j > 0:
        high = select(late < j * period, late, j * period)
        h = select(high > (j - 1) * period, high - (j - 1) * period, 0.0)
        torque = cycle_memory.acting_at(kalman.memory, sample - j, position) - missing
        x = moved(kalman, model, x, sign(kalman, reference, high), torque, h)
        j -= 1
    # 3. And over the lag of the motors, which delays what is asked for now by as much.
    s = sign(kalman, reference, -kalman.lag)
    if kalman.lag > 0.0:
        torque = cycle_memory.acting_after(kalman.memory, position) - missing
        x = moved(kalman, model, x, s, torque, kalman.lag)
    unknown = x.disturbance + x.offset + x.coulomb * s
    return Predicted(x.position, x.velocity, unknown)


@inner
def _periods(time: float, period: float) -> int:
    """Number of periods that a time takes."""
    count = 0
    while time > (count + 1e-6) * period and count < 2 * MOST:
        count += 1
    return count


@inner
def _diagonal(matrix: Array, like: Array) -> Array:
    """Diagonal of a matrix of shape (n, n) as a vector; `like` is any of shape (n,)."""
    one = np.zeros_like(like) + 1.0
    return multiply(matrix * np.diag(one), one)
