"""Linear active disturbance rejection control: a PD law with an extended state observer (ADRC)."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import Array, ControlOutput, Field, inverse_dynamics, kernel
from parallel_robot_model.compiler import select, solve, vector

TITLE = 'ADRC'
SLOWEST = 3.0  # w_o / w_c; Herbst (2013), Electronics 2(3), recommends 3 to 10


class Gains(NamedTuple):
    """Bandwidths, the same for every joint: all poles of one lie at its negative."""

    w_c: Annotated[float, Field('1/s', 'bandwidth of the controller', 1e-6)]
    w_o: Annotated[float, Field('1/s', 'bandwidth of the observer', 1e-6)]


def validate_gains(gains: Gains) -> list[str]:
    """Warn of an observer that is too slow for the controller."""
    if gains.w_o >= SLOWEST * gains.w_c:
        return []
    return [
        f'w_o = {gains.w_o:g} 1/s is less than {SLOWEST:g} w_c = {SLOWEST * gains.w_c:g} 1/s: '
        'the observer is too slow for the controller'
    ]


class Observer(NamedTuple):
    """State of the extended state observer, each shape (n,)."""

    position: Array  # z1 [rad]
    rate: Array  # z2 [rad/s]
    disturbance: Array  # z3, the acceleration that the model does not explain [rad/s^2]


class Memory(NamedTuple):
    """The last sample."""

    observer: Observer  # state of the observer
    acceleration: Array  # u, the demanded acceleration [rad/s^2], shape (n,)
    started: float  # 0 before the first update, then 1


def initial_memory(joints: int) -> Memory:
    """Zeros: the first update begins with the measured motion and no disturbance."""
    zero = vector(np.zeros(joints))
    return Memory(Observer(zero, zero, zero), zero, 0.0)


@kernel
def observed(w_o, z, u, position, dt):
    """The observer at the next sample; all three poles of its error are exp(-w_o dt).

    Args:
        w_o: Bandwidth [1/s].
        z: The observer at the last sample.
        u: Acceleration by the model since then [rad/s^2], shape (n,).
        position: Measured angles now [rad], shape (n,).
        dt: Time since the last sample [s].
    """
    # 1. Prediction: u and the disturbance are constant between two samples.
    acceleration = u + z.disturbance
    predicted = z.position + dt * z.rate + 0.5 * dt * dt * acceleration
    rate = z.rate + dt * acceleration
    # 2. Correction by the measured position.
    error = position - predicted
    pole = math.exp(-w_o * dt)
    decay = 1.0 - pole
    return Observer(
        predicted + (1.0 - pole * pole * pole) * error,
        rate + 1.5 * decay * decay * (1.0 + pole) / dt * error,
        z.disturbance + decay * decay * decay / (dt * dt) * error,
    )


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        thdd = u + f,   z = (z1, z2, z3) -> (th, thd, f)
        z_k  = A z_(k-1) + B u_(k-1) + L (th_k - C (A z_(k-1) + B u_(k-1)))
        u    = thdd_d + w_c^2 (th_d - z1) + 2 w_c (thd_d - z2) - z3,   tau = M u + Q thd

    A and B are those of a torque that is held between two samples; with p = exp(-w_o dt), L =
    (1 - p^3, 3 (1 - p)^2 (1 + p) / (2 dt), (1 - p)^3 / dt^2). The observer knows the applied
    torque, u - M^-1 excess, so z3 does not wind up while the torque is limited. The measured
    rates enter only Q thd and the first sample.

    Returns:
        Torque [N m], -z3 [rad/s^2] in place of a sliding variable, new memory.

    Source:
        Gao (2003), Scaling and bandwidth-parameterization based controller tuning, Proc. American
        Control Conference, for controller, observer and their poles; Miklosovic, Radke, Gao
        (2006), Discrete implementation and generalization of the extended state observer, same
        conference, for A, B and L.
    """
    # 1. The observer, with the acceleration of the torque that was applied.
    e = reference.position - feedback.position
    applied = memory.acceleration - solve(model.M, feedback.excess)
    first = Observer(feedback.position, feedback.velocity, memory.observer.disturbance)
    later = observed(gains.w_o, memory.observer, applied, feedback.position, dt)
    z = select(memory.started == 0.0, first, later)
    # 2. The torque: a PD law on the observed motion, without the observed disturbance.
    acceleration = (
        reference.acceleration
        + gains.w_c * gains.w_c * (reference.position - z.position)
        + 2.0 * gains.w_c * (reference.velocity - z.rate)
        - z.disturbance
    )
    torque = inverse_dynamics(model, acceleration, feedback.velocity)
    return ControlOutput(torque, -z.disturbance, e, Memory(z, acceleration, 1.0))
