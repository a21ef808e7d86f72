"""What sensors tell of the joints, and what motors make of a command."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, internal, kernel, select, some
from parallel_robot_model.robots.contract import Measurement
from parallel_robot_sim.drive_step import rotors
from parallel_robot_sim.noise_and_delay import (
    COMMAND,
    DISTURBANCE,
    EFFORT,
    LAGGED,
    OF_COMMANDS,
    OF_LOAD,
    OF_POSITION,
    OF_STATES,
    OF_TORQUE,
    OF_VELOCITY,
    POSITION,
    VELOCITY,
    newest,
    normals,
    recall,
    record,
    sample_at,
)

# What the sensors tell of the joints: zero angles, noise, encoder steps, differences, delay.


@kernel
def rounded(x: Array, step: Array) -> Array:
    """The multiple of `step` next to `x`, element by element; `x` itself where it is zero."""
    return select(step > 0.0, step * np.floor(x / step + 0.5), x)


@internal
def _taken(setup: Any, joints: Measurement, sample: int, period: float) -> tuple[Array, Array]:
    """Positions [rad] and velocities [rad/s] as the sensors take them, each shape (n,)."""
    seed, sensor = setup.imperfections.seed, setup.imperfections.sensor
    angle, speed = joints.position, joints.velocity
    if setup.imperfections.drive.at_motor:
        angle, speed = rotors(setup, joints, sample)
    noise = normals(seed, sample, OF_POSITION, setup.imperfections.draws, joints.position)
    shown = angle + sensor.zero_angle
    noisy = shown + sensor.position_noise * noise
    position = rounded(noisy, sensor.resolution)
    noise = normals(seed, sample, OF_VELOCITY, setup.imperfections.draws, joints.position)
    velocity = speed + sensor.velocity_noise * noise
    if sensor.differentiate:
        velocity = np.zeros_like(position)
        if sample > 0:
            velocity = (position - recall(setup, POSITION, sample - 1, position)) / period
    return position, velocity


@kernel
def sensed(setup: Any, joints: Measurement, time: float, period: float) -> tuple[Array, Array]:
    """Positions [rad] and velocities [rad/s] that the controller receives, each shape (n,).

    Before the first state arrives, the controller receives that of the start.

    Args:
        setup: PlantSetup with imperfections.
        joints: The true ones.
        time: Time since the start [s].
        period: Of the samples [s].
    """
    sample, sensor = sample_at(time, period), setup.imperfections.sensor
    position, velocity = _taken(setup, joints, sample, period)
    if setup.imperfections.depth == 0:
        return position, velocity
    first_position, first_velocity = position, velocity
    if 0 < sample <= setup.imperfections.depth:
        first_position = recall(setup, POSITION, 0, position)
        first_velocity = recall(setup, VELOCITY, 0, position)
    delay, jitter = sensor.delay, sensor.jitter
    return (
        newest(
            setup, POSITION, OF_STATES, sample, position, first_position, delay, jitter, period
        ),
        newest(
            setup, VELOCITY, OF_STATES, sample, velocity, first_velocity, delay, jitter, period
        ),
    )


@kernel
def effort_at_stamp(setup: Any, torque: Array, time: float, period: float) -> Array:
    """Torque of the step that ended when the published state was measured [N m], shape (n,).

    Args:
        setup: PlantSetup with imperfections.
        torque: Torque of the step that has just ended [N m], shape (n,).
        time: Time since the start [s].
        period: Of the samples [s].
    """
    sample, late = sample_at(time, period), sample_at(setup.imperfections.age, period)
    if late == 0:
        return torque
    if sample <= late:
        return np.zeros_like(torque)
    return recall(setup, EFFORT, sample - late, torque)


@kernel
def record_sensed(
    setup: Any, joints: Measurement, torque: Array, time: float, period: float
) -> None:
    """Remember what the sensors take at a sample; arguments as of the functions above."""
    sample = sample_at(time, period)
    record(setup, EFFORT, sample, torque)
    position, velocity = _taken(setup, joints, sample, period)
    record(setup, POSITION, sample, position)
    record(setup, VELOCITY, sample, velocity)


# What motors and disturbances make of a command: delay, steps, lag, noise, faults.

EARLY = 1e-6  # of a period, by which a time may be missed by rounding


@kernel
def driven(
    setup: Any, command: Array, least: Array, greatest: Array, time: float, period: float
) -> Array:
    """Mean torque of the motors over a period [N m], shape (n,).

    The lag is of first order, so with the command u held over a period h and time constant T

        tau(h) = u + (tau(0) - u) exp(-h / T),  mean = u + (tau(0) - u) (1 - exp(-h / T)) T / h.

    Args:
        setup: PlantSetup with imperfections.
        command: Commanded torque [N m], shape (n,).
        least: Lower saturation of the motors [N m], shape (n,).
        greatest: The upper one [N m], shape (n,).
        time: Start of the period, since the start of the run [s].
        period: Length of the period [s].
    """
    sample, seed = sample_at(time, period), setup.imperfections.seed
    motors = setup.imperfections.actuator
    # 1. The command that has arrived, in whole steps; there is no torque before the first one.
    record(setup, COMMAND, sample, command)
    zero = np.zeros_like(command)
    demand = command
    if setup.imperfections.depth > 0:
        demand = newest(
            setup, COMMAND, OF_COMMANDS, sample, command, zero, motors.delay, motors.jitter, period
        )
    demand = clip(rounded(demand, motors.resolution), least, greatest)
    # 2. The lag.
    before = zero
    if sample > 0:
        before = recall(setup, LAGGED, sample, command)
    lag = motors.lag
    left = np.exp(-period / lag)
    record(setup, LAGGED, sample + 1, demand + (before - demand) * left)
    torque = demand + (before - demand) * (1.0 - left) * lag / period
    # 3. Noise, and from its time on, the fault.
    noise = normals(seed, sample, OF_TORQUE, setup.imperfections.draws, command)
    torque = torque + motors.noise * noise
    failed = sample >= motors.fault_time / period - EARLY
    faulty = motors.effectiveness * torque + motors.bias
    return clip(select(failed, faulty, torque), least, greatest)


@internal
def cogging(setup: Any, position: Array) -> Array:
    """Cogging of motors at their angles, `position` [rad]; torques [N m], shape (n,)."""
    load = setup.imperfections.load
    return load.ripple * np.sin(load.ripple_periods * position)


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
    torque = load.constant
    torque = torque + select((sample >= begin) & (sample < end), 1.0, 0.0) * load.pulse
    if some(load.ripple != 0.0):
        torque = torque + cogging(setup, position)
    drawn = normals(setup.imperfections.seed, sample, OF_LOAD, setup.imperfections.draws, position)
    left = math.exp(-2.0 * math.pi * load.bandwidth * period)
    left = select(load.bandwidth > 0.0, left, 0.0)
    noise = drawn
    if sample > 0:
        before = recall(setup, DISTURBANCE, sample - 1, position)
        noise = left * before + np.sqrt(1.0 - left * left) * drawn
    record(setup, DISTURBANCE, sample, noise)
    return torque + load.noise * noise
