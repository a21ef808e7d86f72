"""A plant linearised along its desired motion, from sample to sample."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.fields import PerJoint
from parallel_robot_base.kernel import entry_point
from parallel_robot_base.vector_types import vector
from parallel_robot_sim.assembly import assemble_plant
from parallel_robot_sim.configuration import Configuration, PlantConfiguration
from parallel_robot_sim.plant import PlantState, step

Array = NDArray[np.float64]

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
    period, duration = configuration.loop.period, configuration.loop.duration
    plant = assemble_plant(_smooth(configuration.plant))
    robot = configuration.plant.robot
    still = vector(np.zeros(len(configuration.loop.joints)))
    advance = entry_point(step, plant.setup, plant.state, still, period)
    measure = entry_point(
        robot.module.measure, robot.constants, plant.state.coordinates, plant.state.rate
    )
    count = len(plant.state.coordinates)

    def after(x: Array, torque: Array) -> Array:
        state = PlantState(vector(x[:count]), vector(x[count:]), still, 0.0)
        end = advance(plant.setup, state, vector(torque), period)
        return np.concatenate((end.coordinates, end.rate))

    def shown(x: Array) -> Array:
        joints = measure(robot.constants, vector(x[:count]), vector(x[count:]))
        if robot.module.PLANAR:
            error = np.array(joints.pose[:2])
        else:
            error = np.array(joints.position) / np.sqrt(len(still))
        return np.concatenate((joints.position, joints.velocity, error))

    times = np.linspace(0.0, duration, max(round(duration / INTERVAL), 1) + 1)
    parts: list[tuple[Array, Array, Array]] = []
    for before, x, following in _coordinates(configuration, times):
        at = np.concatenate((x, (following - before) / (2.0 * period)))
        torque = _feedforward(after, at, (following - 2.0 * x + before) / period, len(still))
        parts.append(
            (
                _derivative(functools.partial(after, torque=torque), at),
                _derivative(functools.partial(after, at), torque),
                _derivative(shown, at),
            )
        )
    transition, added, output = (np.array(part) for part in zip(*parts, strict=True))
    ends = 2 * len(still)
    return LinearMotion(times, transition, added, output[:, :ends], output[:, ends:])


def _smooth(plant: PlantConfiguration) -> PlantConfiguration:
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


def _coordinates(configuration: Configuration, times: Array) -> Array:
    """Coordinates of the plant a period before, at and after some times, shape (K, 3, c)."""
    robot = configuration.plant.robot
    around = configuration.loop.period * np.array([-1.0, 0.0, 1.0])
    poses = configuration.trajectory.sample((times[:, np.newaxis] + around).ravel()).pose
    found: Any = np.array([robot.module.start(robot.parameters, pose) for pose in poses])
    return found.reshape(len(times), 3, -1)


def _feedforward(
    after: Callable[[Array, Array], Array], x: Array, change: Array, joints: int
) -> Array:
    """Torque that changes the rates by `change` within a period, shape (n,)."""
    zero = np.zeros(joints)
    gain = _derivative(functools.partial(after, x), zero)[len(change) :]
    without = (after(x, zero) - x)[len(change) :]
    return np.asarray(np.linalg.lstsq(gain, change - without, rcond=None)[0], np.float64)


def _derivative(function: Callable[[Array], Array], at: Array) -> Array:
    """Derivative by central differences, shape (outputs, inputs)."""
    steps = SMALL * np.eye(len(at))
    columns = [(function(at + one) - function(at - one)) / (2.0 * SMALL) for one in steps]
    return np.array(columns).T
