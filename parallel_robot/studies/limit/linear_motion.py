"""A plant linearised along its desired motion, from sample to sample."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, read_row, write_row
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.ideal_torque import SMALL_STEP, after, performed, smooth
from parallel_robot_sim.plant import PlantSetup, PlantState


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
    place = configuration.plant.robot.place
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
    """What small changes of states change; arguments as of `performed_motion._pushed`.

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
                then = after(advance, setup, begin, x, torques[k], period)
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
