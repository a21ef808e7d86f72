"""Which torque acts on the robot besides that of the motors: a generalised-momentum observer.

It tells that commands do not act where joint states report no efforts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, multiply, select
from parallel_robot_model.robots.contract import Model


class Observed(NamedTuple):
    """What the observer keeps from one state to the next, each shape (n,).

    Attributes:
        momentum: Generalised momentum p = M qd [N m s].
        drift: Rate of the momentum without any torque, C^T qd - g [N m].
        residual: External torque r, as far as it is known [N m].
    """

    momentum: Array
    drift: Array
    residual: Array


@inner
def observed(
    bandwidth: float,
    before: Observed,
    known: bool,
    model: Model,
    velocity: Array,
    torque: Array,
    dt: float,
) -> Observed:
    """Compare the change of the momentum with what the commanded torque makes of it.

    With p = M qd, and as M' - 2 Q is skew-symmetric, p' = tau + Q^T qd - g + tau_ext, and

        r = K (p - integral of (tau + Q^T qd - g + r) dt),  that is  r' = K (tau_ext - r):

    it needs no accelerations and no inverse of M. Friction, and what the nominal robot is wrong
    by, count as external torque; so does a command that does not act, with its sign reversed.
    The equation is solved exactly from state to state, for a torque and an external torque that
    are constant in between and a drift that changes evenly.

    Args:
        bandwidth: K [1/s].
        before: What the last state left.
        known: Whether there was one; if not, there is no residual yet.
        model: Nominal model at the state; Q^T qd is its C^T qd.
        velocity: Rates of the joints there [rad/s], shape (n,).
        torque: Commanded torque since the last state [N m], shape (n,).
        dt: Time since then [s].

    Source:
        De Luca, Mattone (2005), Sensorless robot collision detection and hybrid force/motion
        control, IEEE ICRA; De Luca, Albu-Schaeffer, Haddadin, Hirzinger (2006), Collision
        detection and safe reaction with the DLR-III lightweight manipulator arm, IEEE/RSJ IROS.
    """
    momentum = multiply(model.M, velocity)
    drift = -model.gravity
    for i in range(len(velocity)):
        drift = drift + velocity[i] * model.Q[i]
    kept = math.exp(-bandwidth * dt)
    external = (momentum - before.momentum) / dt - torque - 0.5 * (drift + before.drift)
    residual = kept * before.residual + (1.0 - kept) * external
    return Observed(momentum, drift, select(known, residual, np.zeros_like(velocity)))
