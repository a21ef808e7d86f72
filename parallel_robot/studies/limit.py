"""The least error of a controller that knows all but noise: Kalman filter and prediction.

Small deviations x from the desired motion, and the disturbance w of the joints, obey

    x(k+1) = A(k) x(k) + B(k) (u(k) + m(k) - w(k)),    y(k) = C(k) x(k) + r(k),
    w(k+1) = a w(k) + sqrt(1 - a^2) sigma xi(k),       a = exp(-2 pi f T)

with the noise m of the motors and r of the sensors, the bandwidth f of the disturbance and the
period T. A torque acts from one sample to the next and follows from y(0) ... y(k - d), d samples
late. Hence no controller has a smaller mean square error at the next sample than the prediction
by the Kalman filter over the samples in between,

    E |e(k+1)|^2 >= trace(J(k+1) P(k+1 | k-d) J(k+1)^T),

P the covariance of the prediction, J from the state to the end effector.

Source:
    Astrom (1970), Introduction to Stochastic Control Theory, chapter 8; Kalman (1960), J. Basic
    Engineering 82(1).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import internal, kernel, read_row, write_row
from parallel_robot_model.configuration.fields import given_zero_angles
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.ideal_torque import SMALL_STEP, performed, smooth, state_after
from parallel_robot_sim.imperfections import Imperfections
from parallel_robot_sim.plant import PlantSetup, PlantState

# A plant linearised along its desired motion, from sample to sample.


class LinearMotion(NamedTuple):
    """Small deviations from a desired motion, at K points of it.

    A deviation has 2c elements: of the coordinates of the plant, then of their rates.
    """

    times: Array  # times of the points [s], shape (K,)
    transition: Array  # from a sample to the next without torque, shape (K, 2c, 2c)
    torque: Array  # what a torque held over a period adds to the next sample, shape (K, 2c, n)
    measured: Array  # joint positions, then velocities, shape (K, 2n, 2c)
    # what the error is computed from, shape (K, p, 2c): the end effector's x and y [m], or
    # without a plane the joint positions over the root of their number [rad]
    error: Array


def linearise(configuration: Configuration) -> LinearMotion:
    """Linearise the plant of an experiment along the desired motion.

    The plant's own step is differentiated, by central differences. Coulomb friction depends on
    the sign of a velocity alone, so it does not count; motors do not saturate.

    Raises:
        InputError: the robot does not reach the motion.
    """
    motion = performed(configuration.trajectory, smooth(configuration))
    transition, joints, pose = _moved(
        motion.advance,
        motion.plant.setup,
        motion.plant.state,
        motion.points,
        motion.torque,
        configuration.loop.period,
    )
    count = motion.torque.shape[1]
    place = configuration.true_robot.place
    error = pose[:, :place] if place else joints[:, :count] / np.sqrt(count)
    error = np.ascontiguousarray(error)
    return LinearMotion(motion.times, transition, motion.pushed, joints, error)


@kernel
def _moved(
    advance: Any,
    setup: PlantSetup,
    begin: PlantState,
    points: Array,
    torques: Array,
    period: float,
) -> tuple[Array, Array, Array]:
    """What small changes of states change; arguments as of `ideal_torque._pushed`.

    Returns:
        The derivatives by the states of the states a period later, shape (K, 2c, 2c), of the
        positions and rates of the joints, shape (K, 2n, 2c), and of the pose, shape (K, m, 2c).
    """
    count, size = points.shape
    c = len(begin.coordinates)
    first = setup.measure(setup.robot, begin.coordinates, begin.rate)
    n, m = len(first.position), len(first.pose)
    wide = size + 2 * n + m
    slopes, end = np.empty((count, wide, size)), np.empty((2, wide))
    for k in range(count):
        x = points[k].copy()
        for i in range(size):
            for side in range(2):
                x[i] = points[k, i] + (2 * side - 1) * SMALL_STEP
                then = state_after(advance, setup, begin, x, torques[k], period)
                write_row(end[side], 0, then.coordinates)
                write_row(end[side], c, then.rate)
                coordinates = read_row(x, 0, begin.coordinates)
                rate = read_row(x, c, begin.rate)
                shown = setup.measure(setup.robot, coordinates, rate)
                write_row(end[side], size, shown.position)
                write_row(end[side], size + n, shown.velocity)
                write_row(end[side], size + 2 * n, shown.pose)
            x[i] = points[k, i]
            slopes[k, :, i] = (end[1] - end[0]) / (2.0 * SMALL_STEP)
    joints = slopes[:, size : size + 2 * n].copy()
    return slopes[:, :size].copy(), joints, slopes[:, size + 2 * n :].copy()


EVERY = 5  # samples from one prediction to the next
EXACT = (1e-12, 1e-10)  # rad and rad/s, noise of what is measured exactly


class Noise(NamedTuple):
    """What a controller cannot know."""

    position: Array  # standard deviation of the measured positions [rad], shape (n,)
    velocity: Array  # that of the velocities [rad/s], shape (n,); inf where they tell nothing new
    disturbance: Array  # standard deviation of the disturbance [N m], shape (n,)
    memory: float  # share of the disturbance that is left after a period
    motor: Array  # standard deviation of the noise of the motors [N m], shape (n,)
    late: int  # samples from a measurement to the torque that is computed from it

    def moves(self) -> bool:
        """Whether anything unknown moves the robot; if not, its state at the start tells all."""
        return bool(self.disturbance.any() or self.motor.any())


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
    count = round(motion.times[-1] / period)
    nearest = np.round(np.arange(count + 1) * period / (motion.times[1] - motion.times[0]))
    places = np.minimum(nearest.astype(np.int64), len(motion.times) - 1)
    spread = np.concatenate((noise.position, noise.velocity))
    used = np.isfinite(spread)
    squares: Array = _squares(
        motion._replace(measured=np.ascontiguousarray(motion.measured[:, used])),
        noise._replace(position=spread[used]),
        places,
    )
    ends = np.arange(len(squares)) * EVERY + noise.late + 1
    return np.asarray(ends * period, np.float64), np.sqrt(squares)


def least(motion: LinearMotion, noise: Noise, period: float) -> float:
    """The least root mean square error over the second half of a motion, as metrics count it."""
    times, found = errors(motion, noise, period)
    steady = found[times >= 0.5 * motion.times[-1]]
    return float(np.sqrt(np.mean(steady**2)))


@kernel
def _squares(motion: LinearMotion, noise: Noise, places: NDArray[np.int64]) -> Array:
    """Least mean square errors, that of sample EVERY i + late + 1 in element i.

    At first the state is known, the disturbance is not.
    """
    states, joints = motion.torque.shape[1:]
    size, count = states + joints, len(places) - 1 - noise.late
    left, fresh = noise.memory, (1.0 - noise.memory**2) * noise.disturbance**2
    found = np.empty((count + EVERY - 1) // EVERY)
    P = np.zeros((size, size))
    for i in range(joints):
        P[states + i, states + i] = noise.disturbance[i] ** 2
    half, crossed = np.empty((states, size)), np.empty(size)
    for k in range(count):
        # 1. The measurements, one after another: they are independent.
        output = motion.measured[places[k]]
        for i in range(len(output)):
            variance = noise.position[i] ** 2
            for row in range(size):
                crossed[row] = 0.0
                for column in range(states):
                    crossed[row] += P[row, column] * output[i, column]
            for column in range(states):
                variance += output[i, column] * crossed[column]
            for row in range(size):
                gain = crossed[row] / variance
                for column in range(size):
                    P[row, column] -= gain * crossed[column]
        if k % EVERY == 0:
            found[k // EVERY] = _ahead(motion, noise, P, places[k : k + noise.late + 2])
        # 2. A sample later, from P to F P F^T + noise with F = [A B; 0 left].
        A, B = motion.transition[places[k]], motion.torque[places[k]]
        for row in range(states):
            for column in range(size):
                total = 0.0
                for i in range(states):
                    total += A[row, i] * P[i, column]
                for i in range(joints):
                    total += B[row, i] * P[states + i, column]
                half[row, column] = total
        for row in range(states):
            for column in range(row + 1):
                total = 0.0
                for i in range(states):
                    total += half[row, i] * A[column, i]
                for i in range(joints):
                    motor = noise.motor[i] ** 2 * B[row, i]
                    total += (half[row, states + i] + motor) * B[column, i]
                P[row, column] = P[column, row] = total
            for i in range(joints):
                P[row, states + i] = P[states + i, row] = left * half[row, states + i]
        for row in range(joints):
            for column in range(joints):
                P[states + row, states + column] *= left**2
            P[states + row, states + row] += fresh[row]
    return found


@internal
def _ahead(motion: LinearMotion, noise: Noise, P: Array, places: NDArray[np.int64]) -> float:
    """Mean square error at the last of some places from the covariance P at the first.

    A row g of what the error is computed from goes back to the first place, by F^T; on its way
    it meets the noise of each sample.
    """
    states, joints = motion.torque.shape[1:]
    shown = motion.error[places[-1]]
    fresh = (1.0 - noise.memory**2) * noise.disturbance**2
    g, before = np.empty(states + joints), np.empty(states)
    square = 0.0
    for row in range(len(shown)):
        g[:states] = shown[row]
        g[states:] = 0.0
        for k in range(len(places) - 2, -1, -1):
            A, B = motion.transition[places[k]], motion.torque[places[k]]
            before[:] = g[:states]
            for i in range(joints):
                pushed = 0.0
                for j in range(states):
                    pushed += before[j] * B[j, i]
                square += (noise.motor[i] * pushed) ** 2 + fresh[i] * g[states + i] ** 2
                g[states + i] = pushed + noise.memory * g[states + i]
            for i in range(states):
                g[i] = 0.0
                for j in range(states):
                    g[i] += before[j] * A[j, i]
        for i in range(states + joints):
            for j in range(states + joints):
                square += g[i] * P[i, j] * g[j]
    return square


# What geometry alone costs: the error of joints that follow their reference exactly.


def geometry_error(configuration: Configuration, times: Array) -> float:
    """Root mean square error of a robot whose joints seem to be where they should be.

    The references of the joints are those of the nominal robot; the true one stands elsewhere at
    them, and its encoders have zero angles. No law sees that from the joints.

    Args:
        configuration: The experiment.
        times: Times of the motion [s], shape (K,).

    Returns:
        That of the end effector's x and y [m], or of the joints without a plane [rad].

    Raises:
        KinematicsError: the true robot has no pose at some joints.
    """
    robot = configuration.true_robot
    off = np.array(configuration.imperfections.sensor.zero_angle)
    off = off - given_zero_angles(configuration.values)
    if not robot.place:
        return float(np.sqrt(np.mean(off**2)))
    desired = configuration.trajectory.sample(times)
    actual = poses_of(robot, desired.position - off, desired.pose[0])
    squares = ((actual - desired.pose)[:, : robot.place] ** 2).sum(axis=1)
    return float(np.sqrt(np.mean(squares)))
