"""The least error of a controller that knows all but noise: Kalman filter and prediction.

A torque acts from one sample to the next. What is known when it is asked for is the state measured
some samples before; hence no controller has a smaller mean square error at the next
sample than the prediction by the Kalman filter over the samples in between.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_analysis.limit.linear_motion import LinearMotion
from parallel_robot_sim.imperfections import Imperfections

Array = NDArray[np.float64]

EVERY = 5  # samples from one prediction to the next
EXACT = (1e-12, 1e-10)  # rad and rad/s, noise of what is measured exactly


class Noise(NamedTuple):
    """What a controller cannot know.

    Attributes:
        position: Standard deviation of the measured positions [rad], shape (n,).
        velocity: That of the velocities [rad/s], shape (n,); inf where they tell nothing new.
        disturbance: Standard deviation of the disturbance [N m], shape (n,).
        memory: Share of the disturbance that is left after a period.
        motor: Standard deviation of the noise of the motors [N m], shape (n,).
        late: Samples from a measurement to the torque that is computed from it.
    """

    position: Array
    velocity: Array
    disturbance: Array
    memory: float
    motor: Array
    late: int


def noise_of(imperfections: Imperfections, period: float, joints: int) -> Noise:
    """The noise of a plant, in samples of a period [s].

    A step of an encoder counts as noise of a twelfth of its square; jitter only makes states and
    commands later, so it does not count.
    """
    sensor, actuator, load = imperfections.sensor, imperfections.actuator, imperfections.load
    one = np.ones(joints)
    position = np.hypot(sensor.position_noise, np.asarray(sensor.resolution) / math.sqrt(12.0))
    differences = bool(sensor.differentiate)
    left = math.exp(-2.0 * math.pi * load.bandwidth * period) if load.bandwidth > 0.0 else 0.0
    return Noise(
        np.maximum(position * one, EXACT[0]),
        np.full(joints, np.inf)
        if differences
        else np.maximum(np.asarray(sensor.velocity_noise) * one, EXACT[1]),
        np.asarray(load.noise) * one,
        left,
        np.asarray(actuator.noise) * one,
        sum(math.floor(one.delay / period + 0.5) for one in (sensor, actuator)),
    )


def errors(motion: LinearMotion, noise: Noise, period: float) -> tuple[Array, Array]:
    """The least root mean square error over the motion.

    Args:
        motion: The linearised motion.
        noise: What is not known.
        period: Of the samples [s].

    Returns:
        Times [s] and root mean square errors at them, each shape (T,).
    """
    model = _Model(motion, noise)
    count = round(motion.times[-1] / period)
    nearest = np.round(np.arange(count + 1) * period / (motion.times[1] - motion.times[0]))
    places = np.minimum(nearest.astype(int), len(motion.times) - 1)
    covariance = model.start()
    times, found = [], []
    for k in range(count - noise.late):
        covariance = model.measured(covariance, places[k])
        if k % EVERY == 0:
            ahead = covariance
            for later in range(noise.late + 1):
                ahead = model.after(ahead, places[k + later])
            at = k + noise.late + 1
            times.append(at * period)
            found.append(model.error(ahead, places[at]))
        covariance = model.after(covariance, places[k])
    return np.array(times), np.array(found)


def least(motion: LinearMotion, noise: Noise, period: float) -> float:
    """The least root mean square error over the second half of a motion, as metrics count it."""
    times, found = errors(motion, noise, period)
    steady = found[times >= 0.5 * motion.times[-1]]
    return float(np.sqrt(np.mean(steady**2)))


class _Model:
    """Deviations of the plant and its disturbance as one linear system with noise."""

    def __init__(self, motion: LinearMotion, noise: Noise) -> None:
        places, states, joints = motion.torque.shape
        self._states = states
        size = states + joints
        self._transition = np.zeros((places, size, size))
        self._transition[:, :states, :states] = motion.transition
        self._transition[:, :states, states:] = motion.torque
        self._transition[:, states:, states:] = noise.memory * np.eye(joints)
        self._added = np.zeros((places, size, size))
        motors = motion.torque * noise.motor
        self._added[:, :states, :states] = motors @ motors.transpose(0, 2, 1)
        new = (1.0 - noise.memory**2) * noise.disturbance**2
        self._added[:, states:, states:] = np.diag(new)
        used = np.isfinite(np.concatenate((noise.position, noise.velocity)))
        self._output = np.zeros((places, used.sum(), size))
        self._output[:, :, :states] = motion.measured[:, used]
        self._variance = np.diag(np.concatenate((noise.position, noise.velocity))[used] ** 2)
        self._error = motion.error
        self._disturbance = np.diag(noise.disturbance**2)

    def start(self) -> Array:
        """Covariance at the start: the state is known, the disturbance is not."""
        size = self._transition.shape[1]
        covariance = np.zeros((size, size))
        covariance[self._states :, self._states :] = self._disturbance
        return covariance

    def measured(self, covariance: Array, place: int) -> Array:
        """Covariance with the measurement of the same sample."""
        output = self._output[place]
        crossed = covariance @ output.T
        gain = np.linalg.solve(output @ crossed + self._variance, crossed.T).T
        left = np.eye(len(covariance)) - gain @ output
        return left @ covariance @ left.T + gain @ self._variance @ gain.T

    def after(self, covariance: Array, place: int) -> Array:
        """Covariance one sample later, without a measurement."""
        transition = self._transition[place]
        return transition @ covariance @ transition.T + self._added[place]

    def error(self, covariance: Array, place: int) -> float:
        """Root mean square error."""
        shown = self._error[place]
        return math.sqrt(np.trace(shown @ covariance[: self._states, : self._states] @ shown.T))
