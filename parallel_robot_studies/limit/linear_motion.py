"""A plant linearised along its desired motion, from sample to sample."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_base.arrays import Array
from parallel_robot_base.fields import PerJoint
from parallel_robot_compiler import FirstClass, inlined, kernel, read_row, write_row
from parallel_robot_sim.assembly import Plant, assemble_plant
from parallel_robot_sim.configuration import Configuration, PlantConfiguration
from parallel_robot_sim.plant import PlantSetup, PlantState, step
from parallel_robot_studies.limit.coordinates import coordinates_of
from trajectory_gen.trajectory import Trajectory

INTERVAL = 0.02  # s, between two points of linearisation, about
SMALL = 1e-5  # of coordinates, rates and torques, in their units: half the width of a difference


class LinearMotion(NamedTuple):
    """Small deviations from a desired motion, at K points of it.

    A deviation has 2c elements: of the coordinates of the plant, then of their rates.

    Attributes:
        times: Times of the points [s], shape (K,).
        transition: From a sample to the next without torque, shape (K, 2c, 2c).
        torque: What a torque held over a period adds to the next sample, shape (K, 2c, n).
        measured: Joint positions, then velocities, shape (K, 2n, 2c).
        error: What the error is computed from, shape (K, p, 2c): the end effector's x and y
            [m], or without a plane the joint positions over the root of their number [rad].
    """

    times: Array
    transition: Array
    torque: Array
    measured: Array
    error: Array


def linearise(configuration: Configuration) -> LinearMotion:
    """Linearise the plant of an experiment along the desired motion.

    The plant's own step is differentiated, by central differences. Coulomb friction depends on
    the sign of a velocity alone, so it does not count; motors do not saturate.

    Raises:
        InputError: the robot does not reach the motion.
    """
    motion = performed(configuration.trajectory, smooth(configuration.plant))
    transition, joints, pose = _moved(
        motion.advance,
        motion.plant.setup,
        motion.plant.state,
        motion.points,
        motion.torque,
        configuration.loop.period,
    )
    count = motion.torque.shape[1]
    planar = configuration.plant.robot.module.PLANAR
    error = pose[:, :2] if planar else joints[:, :count] / np.sqrt(count)
    error = np.ascontiguousarray(error)
    return LinearMotion(motion.times, transition, motion.pushed, joints, error)


def points_of(duration: float) -> Array:
    """Times of the points of linearisation of a motion [s], shape (K,)."""
    return np.linspace(0.0, duration, max(round(duration / INTERVAL), 1) + 1)


class PerformedMotion(NamedTuple):
    """A plant that performs its desired motion exactly, at K points of it.

    Attributes:
        times: Times of the points [s], shape (K,).
        points: Coordinates of the plant and their rates, shape (K, 2c).
        torque: What performs the motion over the next period [N m], shape (K, n).
        pushed: What a torque held over a period adds to the next sample, shape (K, 2c, n).
        plant: The plant.
        advance: Its step, as FirstClass.
    """

    times: Array
    points: Array
    torque: Array
    pushed: Array
    plant: Plant
    advance: FirstClass


def performed(trajectory: Trajectory, plant: PlantConfiguration) -> PerformedMotion:
    """A desired motion, performed by a plant without imperfections.

    Raises:
        InputError: the robot does not reach the motion.
    """
    period = plant.loop.period
    made = assemble_plant(plant)
    advance = FirstClass(step, made.setup, made.state, made.state.torque, period)
    times = points_of(plant.loop.duration)
    around = (times[:, np.newaxis] + period * np.array([-1.0, 0.0, 1.0, 2.0])).ravel()
    coordinates = coordinates_of(plant.robot, made, trajectory.sample(around).pose)
    before, now, after, later = (coordinates[k::4] for k in range(4))
    rates, next_rates = (after - before) / (2.0 * period), (later - now) / (2.0 * period)
    points = np.hstack((now, rates))
    still = np.zeros((len(times), len(made.state.torque)))
    ends, pushed = _pushed(advance, made.setup, made.state, points, still, period)
    half = now.shape[1]
    missing = next_rates - ends[:, half:]
    torque = np.linalg.pinv(pushed[:, half:]) @ missing[:, :, np.newaxis]
    return PerformedMotion(
        times, points, np.ascontiguousarray(torque[:, :, 0]), pushed, made, advance
    )


def smooth(plant: PlantConfiguration) -> PlantConfiguration:
    """The plant without what cannot be differentiated, and without imperfections."""
    friction, disturbance = plant.load
    zero = PerJoint((0.0,) * len(plant.loop.joints))
    return plant._replace(
        parameters=plant.parameters._replace(torque_limit=PerJoint((np.inf,) * len(zero))),
        load=plant.load._replace(
            friction=friction._replace(coulomb=zero),
            disturbance=disturbance._replace(amplitude=zero),
        ),
        imperfections=plant.imperfections._replace(on=False),
    )


@inlined
def _after(
    advance: Any, setup: PlantSetup, begin: PlantState, x: Array, torque: Array, period: float
) -> PlantState:
    """State a period after the state `x`, shape (2c,); `begin` is any state."""
    coordinates = read_row(x, 0, begin.coordinates)
    rate = read_row(x, len(begin.coordinates), begin.rate)
    state = PlantState(coordinates, rate, begin.torque, 0.0)
    return advance(setup, state, read_row(torque, 0, begin.torque), period)


@kernel
def _pushed(
    advance: Any,
    setup: PlantSetup,
    begin: PlantState,
    points: Array,
    torques: Array,
    period: float,
) -> tuple[Array, Array]:
    """Where states end under torques.

    Args:
        advance: The plant's step, as FirstClass.
        setup: The plant.
        begin: Any state of it.
        points: States, shape (K, 2c).
        torques: Torques [N m], shape (K, n).
        period: Of the samples [s].

    Returns:
        The states a period later, shape (K, 2c), and their derivatives by the torques.
    """
    count, size = points.shape
    joints, c = torques.shape[1], len(begin.coordinates)
    ends, slopes = np.empty((count, size)), np.empty((count, size, joints))
    end = np.empty((2, size))
    for k in range(count):
        x, torque = points[k], torques[k].copy()
        after = _after(advance, setup, begin, x, torque, period)
        write_row(ends[k], 0, after.coordinates)
        write_row(ends[k], c, after.rate)
        for i in range(joints):
            for side in range(2):
                torque[i] = torques[k, i] + (2 * side - 1) * SMALL
                after = _after(advance, setup, begin, x, torque, period)
                write_row(end[side], 0, after.coordinates)
                write_row(end[side], c, after.rate)
            torque[i] = torques[k, i]
            slopes[k, :, i] = (end[1] - end[0]) / (2.0 * SMALL)
    return ends, slopes


@kernel
def _moved(
    advance: Any,
    setup: PlantSetup,
    begin: PlantState,
    points: Array,
    torques: Array,
    period: float,
) -> tuple[Array, Array, Array]:
    """What small changes of states change; arguments as of :func:`_pushed`.

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
                x[i] = points[k, i] + (2 * side - 1) * SMALL
                after = _after(advance, setup, begin, x, torques[k], period)
                write_row(end[side], 0, after.coordinates)
                write_row(end[side], c, after.rate)
                coordinates = read_row(x, 0, begin.coordinates)
                rate = read_row(x, c, begin.rate)
                shown = setup.measure(setup.robot, coordinates, rate)
                write_row(end[side], size, shown.position)
                write_row(end[side], size + n, shown.velocity)
                write_row(end[side], size + 2 * n, shown.pose)
            x[i] = points[k, i]
            slopes[k, :, i] = (end[1] - end[0]) / (2.0 * SMALL)
    joints = slopes[:, size : size + 2 * n].copy()
    return slopes[:, :size].copy(), joints, slopes[:, size + 2 * n :].copy()
