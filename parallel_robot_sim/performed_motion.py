"""A plant that performs its desired motion exactly, and the torque that this takes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import FirstClass, inlined, kernel, read_row, write_row
from parallel_robot_model.configuration.fields import PerJoint
from parallel_robot_sim.assembly import Plant, assemble_plant
from parallel_robot_sim.configuration import PlantConfiguration
from parallel_robot_sim.plant import PlantSetup, PlantState, step
from parallel_robot_sim.plant_coordinates import coordinates_of
from trajectory_gen.trajectory import Trajectory

INTERVAL = 0.02  # s, between two points of a motion, about
SMALL = 1e-5  # of coordinates, rates and torques, in their units: half the width of a difference


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


def performed(
    trajectory: Trajectory,
    plant: PlantConfiguration,
    times: Array | None = None,
    assembled: Plant | None = None,
) -> PerformedMotion:
    """A desired motion, performed by a plant without imperfections.

    Args:
        trajectory: The motion.
        plant: The plant.
        times: Times of the points [s], shape (K,); default: those of the whole motion.
        assembled: The plant put together, where that is done.

    Raises:
        InputError: the robot does not reach the motion.
    """
    period = plant.loop.period
    made = assembled or assemble_plant(plant)
    advance = FirstClass(step, made.setup, made.state, made.state.torque, period)
    if times is None:
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
            friction=friction._replace(coulomb=zero, stribeck=zero),
            disturbance=disturbance._replace(amplitude=zero),
        ),
        imperfections=plant.imperfections._replace(on=False),
    )


def points_of(duration: float) -> Array:
    """Times of the points of linearisation of a motion [s], shape (K,)."""
    return np.linspace(0.0, duration, max(round(duration / INTERVAL), 1) + 1)


@inlined
def after(
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
        then = after(advance, setup, begin, x, torque, period)
        write_row(ends[k], 0, then.coordinates)
        write_row(ends[k], c, then.rate)
        for i in range(joints):
            for side in range(2):
                torque[i] = torques[k, i] + (2 * side - 1) * SMALL
                then = after(advance, setup, begin, x, torque, period)
                write_row(end[side], 0, then.coordinates)
                write_row(end[side], c, then.rate)
            torque[i] = torques[k, i]
            slopes[k, :, i] = (end[1] - end[0]) / (2.0 * SMALL)
    return ends, slopes
