"""Kalman filter at the age of the states, and prediction to the moment at which the torque acts.

Between two states acts what was asked of the motors, so the last torques are remembered. Time is
cut where the torque changes: nothing need lie on a grid.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_control.contract import JointReference
from parallel_robot_control.estimation import recent_torques
from parallel_robot_control.estimation.recent_torques import MOST, SIZE
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    clip,
    internal,
    kernel,
    multiply,
    select,
    solve,
)
from parallel_robot_model.robots.contract import Model

# Equations of the Kalman filter of the joints: how means and covariances move, and are corrected.
#
# For each joint the filter knows position q, velocity v, a disturbance w that varies, a constant
# one c, and dry friction f against the desired motion:
#
#     M v' = tau - Q v - gravity - w - c - f s,   s = clip(rate_r / SMOOTH, -1, 1)
#     w' = -b w + noise,   c and f drift slowly
#
# The means of all joints move by the nominal model, M and Q at the measured joints. The
# covariances are those of each joint alone, with 1 / M_ii for its mobility, so a cycle has no
# large matrices.
#
# Sources:
#     Kalman (1960), A new approach to linear filtering and prediction problems, J. Basic
#     Engineering 82(1); Johnson (1971), Accommodation of external disturbances in linear regulator
#     and servomechanism problems, IEEE Trans. Automatic Control 16(6), for a disturbance as a
#     state.

SMOOTH = 0.002  # rad/s, below which the desired motion has no clear sign
DRIFT = 0.01  # 1/s, of the variances of constant disturbance and dry friction, relative


class Mean(NamedTuple):
    """What is known of the joints, each shape (n,)."""

    position: Array  # q [rad]
    velocity: Array  # v [rad/s]
    disturbance: Array  # w [N m]
    offset: Array  # c [N m]
    coulomb: Array  # f [N m]


class Variance(NamedTuple):
    """Covariances of the parts of a Mean, joint by joint, each shape (n,)."""

    qq: Array
    qv: Array
    qw: Array
    qc: Array
    qf: Array
    vv: Array
    vw: Array
    vc: Array
    vf: Array
    ww: Array
    wc: Array
    wf: Array
    cc: Array
    cf: Array
    ff: Array


@internal
def sign(command_delay: float, reference: JointReference, back: float) -> Array:
    """Sign of the desired motion some time before the torque acts [s], smooth, shape (n,)."""
    later = command_delay - back
    rate = reference.velocity + later * reference.acceleration
    return clip(rate / SMOOTH, -1.0, 1.0)


@internal
def moved(bandwidth: float, model: Model, x: Mean, sign: Array, torque: Array, h: float) -> Mean:
    """The means after a time h [s] under a torque [N m], shape (n,)."""
    against = multiply(model.Q, x.velocity) + model.gravity
    against = against + x.disturbance + x.offset + x.coulomb * sign
    acceleration = solve(model.M, torque - against)
    return Mean(
        x.position + h * (x.velocity + 0.5 * h * acceleration),
        x.velocity + h * acceleration,
        x.disturbance / (1.0 + h * bandwidth),
        x.offset,
        x.coulomb,
    )


@internal
def predict_covariance(
    estimator: Any, noise: Array, mobility: Array, p: Variance, s: Array, h: float
) -> Variance:
    """The covariances after a time h [s].

    Args:
        estimator: The EstimatorParameters.
        noise: Variance of the disturbance [(N m)^2], shape (n,).
        mobility: 1 / M_ii [1/(kg m^2)], shape (n,).
        p: The covariances before.
        s: Sign of the motion, shape (n,).
        h: The time.
    """
    left = 1.0 / (1.0 + h * bandwidth_of(estimator))  # of w
    u = -h * mobility
    # 1. What a transition makes of the rows,
    qq, qv, qw = p.qq + h * p.qv, p.qv + h * p.vv, p.qw + h * p.vw
    qc, qf = p.qc + h * p.vc, p.qf + h * p.vf
    vv = p.vv + u * (p.vw + p.vc + s * p.vf)
    vw = p.vw + u * (p.ww + p.wc + s * p.wf)
    vc = p.vc + u * (p.wc + p.cc + s * p.cf)
    vf = p.vf + u * (p.wf + p.cf + s * p.ff)
    # 2. then of the columns; and noise.
    return Variance(
        qq + h * qv,
        qv + u * (qw + qc + s * qf),
        left * qw,
        qc,
        qf,
        vv + u * (vw + vc + s * vf),
        left * vw,
        vc,
        vf,
        left * left * p.ww + (1.0 - left * left) * noise,
        left * p.wc,
        left * p.wf,
        p.cc + h * DRIFT * (estimator.offset * estimator.offset),
        p.cf,
        p.ff + h * DRIFT * (estimator.coulomb * estimator.coulomb),
    )


@internal
def corrected(
    x: Mean, p: Variance, of: Mean, innovation: Array, variance: Array
) -> tuple[Mean, Variance]:
    """Means and covariances with one more measured quantity of each joint.

    Args:
        x: The means before.
        p: The covariances before.
        of: Covariances of the parts of a Mean with that quantity.
        innovation: Measured less expected, shape (n,).
        variance: Of `innovation`, shape (n,).
    """
    e = innovation / variance
    mean = Mean(
        x.position + of.position * e,
        x.velocity + of.velocity * e,
        x.disturbance + of.disturbance * e,
        x.offset + of.offset * e,
        x.coulomb + of.coulomb * e,
    )
    return mean, _less(p, 1.0 / variance, of)


@internal
def _less(p: Variance, g: Array, of: Mean) -> Variance:
    """Covariances less g times the products of a column of them."""
    q, v, w, c, f = of
    return Variance(
        p.qq - g * q * q,
        p.qv - g * q * v,
        p.qw - g * q * w,
        p.qc - g * q * c,
        p.qf - g * q * f,
        p.vv - g * v * v,
        p.vw - g * v * w,
        p.vc - g * v * c,
        p.vf - g * v * f,
        p.ww - g * w * w,
        p.wc - g * w * c,
        p.wf - g * w * f,
        p.cc - g * c * c,
        p.cf - g * c * f,
        p.ff - g * f * f,
    )


# Levels of noise and disturbance that the Kalman filter finds by itself, from its innovations.
#
# With the right levels the square of what is measured less what was expected has the mean P + R, P
# the variance of the prediction and R that of the noise; and the square of an estimate and its
# variance sum up to that of what is estimated. So each level follows a moving mean.
#
# Sources:
#     Mehra (1970), On the identification of variances and adaptive Kalman filtering, IEEE Trans.
#     Automatic Control 15(2), for the noise; Shumway, Stoffer (1982), J. Time Series Analysis
#     3(4), for the disturbance.

RANGE = 100.0  # of a variance, to either side of the given one


class Levels(NamedTuple):
    """Variances of what is measured and of the disturbance, each shape (n,)."""

    position: Array  # [rad^2]
    velocity: Array  # [(rad/s)^2]
    disturbance: Array  # [(N m)^2]


@internal
def initial_levels(estimator: Any) -> Levels:
    """The levels that the parameters tell."""
    return Levels(
        estimator.position_noise * estimator.position_noise,
        estimator.velocity_noise * estimator.velocity_noise,
        estimator.disturbance * estimator.disturbance,
    )


@internal
def next_level(time: float, level: Array, initial: Array, square: Array, dt: float) -> Array:
    """A level that follows a square.

    Args:
        time: Over which it is found [s].
        level: As it is, shape (n,).
        initial: The level at the beginning, shape (n,).
        square: What has the level for its mean, shape (n,).
        dt: Time since the state before [s].
    """
    share = select(dt < time, dt / time, 1.0)
    level = level + share * (square - level)
    level = select(level < initial / RANGE, initial / RANGE, level)
    return select(level > initial * RANGE, initial * RANGE, level)


# What the Kalman filter keeps from state to state.

AT_REST = 1e-6  # (rad/s)^2, variance of the velocity of a robot at rest
MOVING = 1.0  # (rad/s)^2, of one that moves


class KalmanMemory(NamedTuple):
    """What the filter remembers, as a Struct."""

    mean: Mean
    variance: Variance
    levels: Levels  # that it found


@internal
def running(torques: Any, sample: int, initialized: bool) -> bool:
    """Whether the filter ran not long before a sample; `initialized`: whether there was one."""
    since = sample - torques.newest
    return initialized and torques.tracked and since >= 0 and since <= SIZE - 2 * MOST


@internal
def reset(
    setup: Any, levels: Levels, moving: bool, position: Array, velocity: Array, torque: Array
) -> tuple[Mean, Variance]:
    """Begin anew at a measured motion, under a torque that has acted for long [N m]."""
    estimator, z = setup.estimator, np.zeros_like(position)
    recent_torques.fill(setup.memory.torques, torque)
    v = z + select(moving, MOVING, AT_REST)
    c, f = estimator.offset * estimator.offset, estimator.coulomb * estimator.coulomb
    mean = Mean(position, velocity, z, z, z)
    q, w = levels.position, levels.disturbance
    return mean, Variance(q, z, z, z, z, v, z, z, z, w, z, z, c, z, f)


class Predicted(NamedTuple):
    """The joints when the torque acts, each shape (n,)."""

    position: Array  # [rad]
    velocity: Array  # [rad/s]
    disturbance: Array  # torque against the motors that the model does not know, w + c + f s [N m]


@kernel
def predicted(
    setup: Any,
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
        setup: The ControlSetup.
        model: Nominal model at the measured joints.
        reference: Desired motion at the sample.
        position: Measured angles [rad], shape (n,).
        velocity: Measured rates [rad/s], shape (n,); not used unless `estimator.velocities`.
        before: Torque before this sample [N m], shape (n,); used at the first state.
        missing: Torque that was commanded and did not act [N m], shape (n,).
        moving: Whether there was a state before; if not, the robot is at rest.
        sample: Index of the period from whose start on the torque is asked for.
        late: From the measurement to the moment at which the torque acts [s]; what is beyond MOST
            periods does not count.
        dt: Time since the state before was measured [s].
    """
    estimator, memory, torques = setup.estimator, setup.memory.kalman, setup.memory.torques
    period, most, bandwidth = setup.period, MOST * setup.period, bandwidth_of(estimator)
    delay, given, time = estimator.command_delay, initial_levels(estimator), estimator.levels
    late = select(late > most, most, late)
    # 1. From the state before to this one, under the torques that acted.
    if running(torques, sample, moving):
        x, p = memory.mean, memory.variance
        levels = memory.levels if time > 0.0 else given
        mobility = 1.0 / _diagonal(model.M, position)
        start = late + select(dt > most, most, dt)
        j = _periods(start, period)
        while j > 0:
            high = select(start < j * period, start, j * period)
            low = select(late > (j - 1) * period, late, (j - 1) * period)
            h = select(high > low, high - low, 0.0)
            s = sign(delay, reference, high)
            torque = recent_torques.applied_torque(torques, sample - j) - missing
            x = moved(bandwidth, model, x, s, torque, h)
            p = predict_covariance(estimator, levels.disturbance, mobility, p, s, h)
            j -= 1
        of = Mean(p.qq, p.qv, p.qw, p.qc, p.qf)
        innovation = position - x.position
        of_position = next_level(
            time, levels.position, given.position, innovation * innovation - p.qq, dt
        )
        x, p = corrected(x, p, of, innovation, p.qq + levels.position)
        of_velocity = levels.velocity
        if estimator.velocities:
            of = Mean(p.qv, p.vv, p.vw, p.vc, p.vf)
            innovation = velocity - x.velocity
            square = innovation * innovation - p.vv
            of_velocity = next_level(time, levels.velocity, given.velocity, square, dt)
            x, p = corrected(x, p, of, innovation, p.vv + levels.velocity)
        if time > 0.0:
            square = x.disturbance * x.disturbance + p.ww
            of_torque = next_level(time, levels.disturbance, given.disturbance, square, dt)
            memory.levels = Levels(of_position, of_velocity, of_torque)
    else:
        rate = velocity if estimator.velocities else np.zeros_like(velocity)
        x, p = reset(setup, given, moving, position, rate, before)
        memory.levels = given
    memory.mean, memory.variance = x, p
    # 2. Over the age of this state, under the torques that were commanded since.
    j = _periods(late, period)
    while j > 0:
        high = select(late < j * period, late, j * period)
        h = select(high > (j - 1) * period, high - (j - 1) * period, 0.0)
        torque = recent_torques.applied_torque(torques, sample - j) - missing
        x = moved(bandwidth, model, x, sign(delay, reference, high), torque, h)
        j -= 1
    # 3. And over the lag of the motors, which delays the present command by as much.
    s = sign(delay, reference, -estimator.lag)
    if estimator.lag > 0.0:
        torque = recent_torques.applied_torque_after(torques) - missing
        x = moved(bandwidth, model, x, s, torque, estimator.lag)
    unknown = x.disturbance + x.offset + x.coulomb * s
    return Predicted(x.position, x.velocity, unknown)


@internal
def bandwidth_of(estimator: Any) -> float:
    """Bandwidth b of the disturbance [1/s]."""
    return 2.0 * math.pi * estimator.disturbance_bandwidth


@internal
def _periods(time: float, period: float) -> int:
    """Number of periods that a time takes."""
    count = 0
    while time > (count + 1e-6) * period and count < 2 * MOST:
        count += 1
    return count


@internal
def _diagonal(matrix: Array, template: Array) -> Array:
    """Diagonal of a matrix of shape (n, n) as a vector; `template` is any of shape (n,)."""
    one = np.zeros_like(template) + 1.0
    return multiply(matrix * np.diag(one), one)
