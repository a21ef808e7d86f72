"""Time delay control: what one sample ago could not be explained is cancelled now (TDC)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import Array, ControlOutput, Field, InputError, kernel

TITLE = 'TDC'
MODEL = False


class Gains(NamedTuple):
    """Gains, the same for every joint."""

    inertia: Annotated[
        float, Field('kg m^2', 'Mbar, less than twice the least eigenvalue of M', 1e-9)
    ]
    Kp: Annotated[float, Field('1/s^2', 'gain of the error', 0.0)]
    Kd: Annotated[float, Field('1/s', 'gain of its rate', 0.0)]


def validate_gains(gains: Gains) -> list[str]:
    """Refuse gains with which the error would not vanish.

    Whether Mbar is small enough depends on the robot and is not judged here.

    Raises:
        InputError: p^2 + Kd p + Kp is not Hurwitz.
    """
    if gains.Kp > 0.0 and gains.Kd > 0.0:
        return []
    raise InputError(
        f'p^2 + Kd p + Kp must be Hurwitz: Kp and Kd positive, not {gains.Kp:g} and {gains.Kd:g}'
    )


class Memory(NamedTuple):
    """The last sample, each shape (n,)."""

    torque: Array  # demanded torque [N m]
    velocity: Array  # measured rates [rad/s]
    started: float  # 0 before the first update, then 1


def initial_memory(joints: int) -> Memory:
    """Zeros: the first update has nothing to estimate from."""
    zero = np.zeros(joints)
    return Memory(zero, zero, 0.0)


@kernel
def unexplained(inertia, feedback, memory, dt):
    """N_k: what the torque of the last interval was for besides Mbar thdd [N m], shape (n,).

    Args:
        inertia: Mbar [kg m^2].
        feedback: Motion now, and what the limits took from the last torque.
        memory: With torque, velocity and started as of Memory.
        dt: Length of the interval [s].
    """
    applied = memory.torque - feedback.excess
    acceleration = (feedback.velocity - memory.velocity) / dt
    return memory.started * (applied - inertia * acceleration)


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        Mbar thdd + N = tau,   N_k = tau_(k-1) - Mbar (thd_k - thd_(k-1)) / dt
        tau = Mbar (thdd_d + Kd e' + Kp e) + N_k

    N is everything but Mbar thdd: coupled inertia, Coriolis, gravity, friction, load. The delay is
    one sample, the shortest possible; N_k is its mean since the last sample. The torque of the
    last sample is what the limits let through, so nothing winds up.

    Stable for || I - M^-1 Mbar || < 1, that is for Mbar below twice the least eigenvalue of M. An
    error of N decays by the factor 1 - Mbar / M at every sample; that this be fast enough for Kp
    and Kd, Mbar must be well above dt Kp / Kd times the largest eigenvalue.

    Returns:
        Torque [N m], e [rad] in place of a sliding variable, new memory.

    Source:
        Youcef-Toumi, Ito (1990), A time delay controller for systems with unknown dynamics, J.
        Dynamic Systems, Measurement, and Control 112(1); Hsia, Gao (1990), Robot manipulator
        control using decentralized linear time-invariant time-delayed joint controllers, Proc.
        IEEE Int. Conf. Robotics and Automation.
    """
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    # 1. N of the last interval; nothing is known of it at the first sample.
    N = unexplained(gains.inertia, feedback, memory, dt)
    # 2. The torque for linear dynamics of the error.
    torque = gains.inertia * (reference.acceleration + gains.Kd * e_dot + gains.Kp * e) + N
    return ControlOutput(torque, e, e, Memory(torque, feedback.velocity, 1.0))
