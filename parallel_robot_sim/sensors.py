"""What the sensors tell of the joints: zero angles, noise, encoder steps, differences, delay."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel, select, vector
from parallel_robot_model.robots.contract import Measurement
from parallel_robot_sim.drive_step import rotors
from parallel_robot_sim.noise_and_delay import (
    EFFORT,
    OF_POSITION,
    OF_STATES,
    OF_VELOCITY,
    POSITION,
    VELOCITY,
    newest,
    normals,
    recall,
    remember,
    sample_at,
)


@kernel
def rounded(x: Array, step: Array) -> Array:
    """The multiple of `step` next to `x`, element by element; `x` itself where it is zero."""
    return select(step > 0.0, step * np.floor(x / step + 0.5), x)


@inner
def _taken(setup: Any, joints: Measurement, sample: int, period: float) -> tuple[Array, Array]:
    """Positions [rad] and velocities [rad/s] as the sensors take them, each shape (n,)."""
    seed, sensor = setup.imperfections.seed, setup.imperfections.sensor
    angle, speed = joints.position, joints.velocity
    if setup.imperfections.drive.at_motor:
        angle, speed = rotors(setup, joints, sample)
    noise = normals(seed, sample, OF_POSITION, setup.imperfections.draws, joints.position)
    shown = angle + vector(sensor.zero_angle)
    noisy = shown + vector(sensor.position_noise) * noise
    position = rounded(noisy, vector(sensor.resolution))
    noise = normals(seed, sample, OF_VELOCITY, setup.imperfections.draws, joints.position)
    velocity = speed + vector(sensor.velocity_noise) * noise
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
    """Torque of the step that ended when the told state was measured [N m], shape (n,).

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
def keep_sensed(
    setup: Any, joints: Measurement, torque: Array, time: float, period: float
) -> None:
    """Remember what the sensors take at a sample; arguments as of the functions above."""
    sample = sample_at(time, period)
    remember(setup, EFFORT, sample, torque)
    position, velocity = _taken(setup, joints, sample, period)
    remember(setup, POSITION, sample, position)
    remember(setup, VELOCITY, sample, velocity)
