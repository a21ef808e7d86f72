"""What motors and disturbances make of a command: delay, steps, lag, noise, faults."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, inner, kernel, select, some, vector
from parallel_robot_sim.noise_and_delay import (
    COMMAND,
    DISTURBANCE,
    LAGGED,
    OF_COMMANDS,
    OF_LOAD,
    OF_TORQUE,
    newest,
    normals,
    recall,
    remember,
    sample_at,
)
from parallel_robot_sim.sensors import rounded

EARLY = 1e-6  # of a period, by which a time may be missed by rounding


@kernel
def driven(setup: Any, command: Array, limit: Array, time: float, period: float) -> Array:
    """Mean torque of the motors over a period [N m], shape (n,).

    The lag is of first order, so with the command u held over a period h and time constant T

        tau(h) = u + (tau(0) - u) exp(-h / T),  mean = u + (tau(0) - u) (1 - exp(-h / T)) T / h.

    Args:
        setup: PlantSetup with imperfections.
        command: Commanded torque [N m], shape (n,).
        limit: Saturation of the motors [N m], shape (n,).
        time: Start of the period, since the start of the run [s].
        period: Length of the period [s].
    """
    sample, seed = sample_at(time, period), setup.imperfections.seed
    motors = setup.imperfections.actuator
    # 1. The command that has arrived, in whole steps; there is no torque before the first one.
    remember(setup, COMMAND, sample, command)
    zero = np.zeros_like(command)
    asked = command
    if setup.imperfections.depth > 0:
        asked = newest(
            setup, COMMAND, OF_COMMANDS, sample, command, zero, motors.delay, motors.jitter, period
        )
    asked = clip(rounded(asked, vector(motors.resolution)), -limit, limit)
    # 2. The lag.
    before = zero
    if sample > 0:
        before = recall(setup, LAGGED, sample, command)
    lag = vector(motors.lag)
    left = np.exp(-period / lag)
    remember(setup, LAGGED, sample + 1, asked + (before - asked) * left)
    torque = asked + (before - asked) * (1.0 - left) * lag / period
    # 3. Noise, and from its time on, the fault.
    noise = normals(seed, sample, OF_TORQUE, setup.imperfections.draws, command)
    torque = torque + vector(motors.noise) * noise
    failed = sample >= motors.fault_time / period - EARLY
    faulty = vector(motors.effectiveness) * torque + vector(motors.bias)
    return clip(select(failed, faulty, torque), -limit, limit)


@inner
def cogging(setup: Any, position: Array) -> Array:
    """Cogging of motors at their angles, `position` [rad]; torques [N m], shape (n,)."""
    load = setup.imperfections.load
    return vector(load.ripple) * np.sin(load.ripple_periods * position)


@kernel
def held_disturbance(setup: Any, position: Array, time: float, period: float) -> Array:
    """Torque that opposes the motors over a period [N m], shape (n,): all but the sine.

    The noise is white noise behind a low-pass filter of first order, in its steady state. The
    cogging of a motor is a sine of its angle, that of the start of the period; drives do not tell
    it as an effort.

    Args:
        setup: PlantSetup with imperfections.
        position: Actuated joints at the start of the period [rad], shape (n,).
        time: Start of the period, since the start of the run [s].
        period: Length of the period [s].
    """
    sample, load = sample_at(time, period), setup.imperfections.load
    begin = load.pulse_start / period - EARLY
    end = (load.pulse_start + load.pulse_duration) / period - EARLY
    torque = vector(load.constant)
    torque = torque + select((sample >= begin) & (sample < end), 1.0, 0.0) * vector(load.pulse)
    if some(vector(load.ripple) != 0.0):
        torque = torque + cogging(setup, position)
    drawn = normals(setup.imperfections.seed, sample, OF_LOAD, setup.imperfections.draws, position)
    left = math.exp(-2.0 * math.pi * load.bandwidth * period)
    left = select(load.bandwidth > 0.0, left, 0.0)
    noise = drawn
    if sample > 0:
        before = recall(setup, DISTURBANCE, sample - 1, position)
        noise = left * before + np.sqrt(1.0 - left * left) * drawn
    remember(setup, DISTURBANCE, sample, noise)
    return torque + vector(load.noise) * noise
