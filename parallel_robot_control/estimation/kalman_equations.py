"""Equations of the Kalman filter of the joints: how means and covariances move, and are corrected.

For each joint the filter knows position q, velocity v, a disturbance w that varies, a constant one
c, and dry friction f against the desired motion:

    M v' = tau - Q v - gravity - w - c - f s,   s = clip(rate_r / SMOOTH, -1, 1)
    w' = -b w + noise,   c and f drift slowly

The means of all joints move by the nominal model, M and Q at the measured joints. The covariances
are those of each joint alone, with 1 / M_ii for its mobility, so a cycle has no large matrices.

Sources:
    Kalman (1960), A new approach to linear filtering and prediction problems, J. Basic Engineering
    82(1); Johnson (1971), Accommodation of external disturbances in linear regulator and
    servomechanism problems, IEEE Trans. Automatic Control 16(6), for a disturbance as a state.
"""

from __future__ import annotations

from typing import NamedTuple

from parallel_robot_control.contract import JointReference
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, inner, multiply, solve
from parallel_robot_model.robots.contract import Model

SMOOTH = 0.002  # rad/s, below which the desired motion has no clear sign
DRIFT = 0.01  # 1/s, of the variances of constant disturbance and dry friction, relative


class Kalman(NamedTuple):
    """The filter as the kernels take it; variances have shape (n,).

    Attributes:
        period: Of the samples [s].
        command_delay: From a command until it acts [s].
        lag: Time constant of the motors after that [s].
        velocities: Whether measured velocities are used.
        position: Variance of the measured positions [rad^2].
        velocity: Of the measured velocities [(rad/s)^2].
        disturbance: Of w [(N m)^2].
        bandwidth: b [1/s].
        offset: Of c before it is known [(N m)^2].
        coulomb: Of f before it is known [(N m)^2].
        levels: Time over which the first three variances are found [s]; 0: they are as given.
        memory: Address of its memory, see kalman_memory.py.
    """

    period: float
    command_delay: float
    lag: float
    velocities: bool
    position: Array
    velocity: Array
    disturbance: Array
    bandwidth: float
    offset: Array
    coulomb: Array
    levels: float
    memory: int


class Mean(NamedTuple):
    """What is known of the joints, each shape (n,).

    Attributes:
        position: q [rad].
        velocity: v [rad/s].
        disturbance: w [N m].
        offset: c [N m].
        coulomb: f [N m].
    """

    position: Array
    velocity: Array
    disturbance: Array
    offset: Array
    coulomb: Array


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


@inner
def sign(kalman: Kalman, reference: JointReference, back: float) -> Array:
    """Sign of the desired motion some time before the torque acts [s], smooth, shape (n,)."""
    later = kalman.command_delay - back
    rate = reference.velocity + later * reference.acceleration
    return clip(rate / SMOOTH, -1.0, 1.0)


@inner
def moved(kalman: Kalman, model: Model, x: Mean, sign: Array, torque: Array, h: float) -> Mean:
    """The means after a time h [s] under a torque [N m], shape (n,)."""
    against = multiply(model.Q, x.velocity) + model.gravity
    against = against + x.disturbance + x.offset + x.coulomb * sign
    acceleration = solve(model.M, torque - against)
    return Mean(
        x.position + h * (x.velocity + 0.5 * h * acceleration),
        x.velocity + h * acceleration,
        x.disturbance / (1.0 + h * kalman.bandwidth),
        x.offset,
        x.coulomb,
    )


@inner
def spread(kalman: Kalman, mobility: Array, p: Variance, s: Array, h: float) -> Variance:
    """The covariances after a time h [s].

    Args:
        kalman: The filter.
        mobility: 1 / M_ii [1/(kg m^2)], shape (n,).
        p: The covariances before.
        s: Sign of the motion, shape (n,).
        h: The time.
    """
    left = 1.0 / (1.0 + h * kalman.bandwidth)  # of w
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
        left * left * p.ww + (1.0 - left * left) * kalman.disturbance,
        left * p.wc,
        left * p.wf,
        p.cc + h * DRIFT * kalman.offset,
        p.cf,
        p.ff + h * DRIFT * kalman.coulomb,
    )


@inner
def corrected(
    x: Mean, p: Variance, of: Mean, miss: Array, variance: Array
) -> tuple[Mean, Variance]:
    """Means and covariances with one more measured quantity of each joint.

    Args:
        x: The means before.
        p: The covariances before.
        of: Covariances of the parts of a Mean with that quantity.
        miss: Measured less expected, shape (n,).
        variance: Of `miss`, shape (n,).
    """
    e = miss / variance
    mean = Mean(
        x.position + of.position * e,
        x.velocity + of.velocity * e,
        x.disturbance + of.disturbance * e,
        x.offset + of.offset * e,
        x.coulomb + of.coulomb * e,
    )
    return mean, _less(p, 1.0 / variance, of)


@inner
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
