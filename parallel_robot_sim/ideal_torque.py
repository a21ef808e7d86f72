"""The ideal torque of a simulated run: it holds the true robot exactly on the reference.

Only a simulation knows it: it takes the true robot, its friction, and the disturbances that acted.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    FunctionValue,
    inline_ir,
    kernel,
    largest,
    multiply,
    read_row,
    solve,
    write_row,
)
from parallel_robot_model.configuration.fields import PerJoint
from parallel_robot_model.robots.joint_load import JointLoad, motor_torque
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.configuration import (
    Configuration,
    Plant,
    assemble_plant,
)
from parallel_robot_sim.plant import PlantSetup, PlantState, step, unlimited
from parallel_robot_sim.sensors_actuators import held_disturbance
from trajectory_gen.trajectory import Trajectory

# Coordinates of the plant along a desired motion.

HALF_STEP = 1e-6  # of coordinates, in their units: half the width of a difference
ENOUGH = 1e-8  # correction of coordinates after which the next one is none
MOST = 8  # corrections


def coordinates_of(robot: RobotModel, plant: Plant, poses: Array) -> Array:
    """Coordinates of the plant at poses that follow each other closely.

    Args:
        robot: The true robot.
        plant: The plant of it.
        poses: Poses, shape (N, m).

    Returns:
        Shape (N, c).

    Raises:
        InputError: the robot does not reach a pose.
    """
    start = robot.module.start
    first = np.array(start(robot.parameters, poses[0]), np.float64)
    if len(first) == poses.shape[1]:
        coordinates: Array = _coordinates_at(plant.setup, plant.state, poses, first)
        if np.isfinite(coordinates).all():
            return coordinates
    each: list[Any] = [start(robot.parameters, pose) for pose in poses]
    return np.array(each, np.float64)


@kernel
def _coordinates_at(setup: PlantSetup, state: PlantState, poses: Array, first: Array) -> Array:
    """Coordinates at poses by Newton's method, each from those before; NaN where it fails."""
    x, size = first.copy(), len(first)
    pose, ends = np.empty(size), np.empty((2, size))
    slopes, normal = np.empty((size, size)), np.empty((size, size))  # of each coordinate a row
    coordinates = np.full((len(poses), size), np.nan)
    for k in range(len(poses)):
        for _ in range(MOST):
            write_row(pose, 0, _pose(setup, state, x))
            for i in range(size):
                here = x[i]
                for side in range(2):
                    x[i] = here + (2 * side - 1) * HALF_STEP
                    write_row(ends[side], 0, _pose(setup, state, x))
                x[i] = here
                slopes[i] = (ends[1] - ends[0]) / (2.0 * HALF_STEP)
            for i in range(size):  # solve() is for symmetric matrices
                normal[i] = multiply(slopes, slopes[i])
            correction = solve(normal, multiply(slopes, poses[k] - pose))
            x += correction
            if largest(correction) < ENOUGH:
                coordinates[k] = x
                break
        if not np.isfinite(coordinates[k, 0]):
            break
    return coordinates


@kernel
def _pose(setup: PlantSetup, state: PlantState, x: Array) -> Array:
    """Pose at coordinates, shape (m,)."""
    return setup.measure(setup.robot, read_row(x, 0, state.coordinates), state.rate).pose


# A plant that performs its desired motion exactly, and the torque that this takes.

INTERVAL = 0.02  # s, between two points of a motion, about
SMALL_STEP = (
    1e-5  # of coordinates, rates and torques, in their units: half the width of a difference
)


class PerformedMotion(NamedTuple):
    """A plant that performs its desired motion exactly, at K points of it."""

    times: Array  # times of the points [s], shape (K,)
    points: Array  # coordinates of the plant and their rates, shape (K, 2c)
    torque: Array  # what performs the motion over the next period [N m], shape (K, n)
    pushed: Array  # what a torque held over a period adds to the next sample, shape (K, 2c, n)
    plant: Plant
    advance: FunctionValue  # its step, as FunctionValue


def performed(
    trajectory: Trajectory,
    configuration: Configuration,
    times: Array | None = None,
    assembled: Plant | None = None,
) -> PerformedMotion:
    """A desired motion, performed by a plant without imperfections.

    Args:
        trajectory: The motion.
        configuration: That of the plant.
        times: Times of the points [s], shape (K,); default: those of the whole motion.
        assembled: The plant put together, where that is done.

    Raises:
        InputError: the robot does not reach the motion.
    """
    period = configuration.loop.period
    made = assembled or assemble_plant(configuration)
    advance = FunctionValue(step, made.setup, made.state, made.state.torque, period)
    if times is None:
        times = points_of(configuration.loop.duration)
    around = (times[:, np.newaxis] + period * np.array([-1.0, 0.0, 1.0, 2.0])).ravel()
    coordinates = coordinates_of(configuration.true_robot, made, trajectory.sample(around).pose)
    before, now, after, later = (coordinates[k::4] for k in range(4))
    rates, next_rates = (after - before) / (2.0 * period), (later - now) / (2.0 * period)
    points = np.hstack((now, rates))
    still = np.zeros((len(times), len(made.state.torque)))
    ends, pushed = _end_states(advance, made.setup, made.state, points, still, period)
    half = now.shape[1]
    missing = next_rates - ends[:, half:]
    torque = np.linalg.pinv(pushed[:, half:]) @ missing[:, :, np.newaxis]
    return PerformedMotion(
        times, points, np.ascontiguousarray(torque[:, :, 0]), pushed, made, advance
    )


def smooth(configuration: Configuration) -> Configuration:
    """The plant without what cannot be differentiated, and without imperfections."""
    friction, disturbance = configuration.joint_load
    zero = PerJoint((0.0,) * configuration.joints)
    return configuration.with_parts(
        plant=unlimited(configuration.plant),
        joint_load=JointLoad(
            friction._replace(coulomb=zero, stribeck=zero, offset=zero, load=zero),
            disturbance._replace(amplitude=zero),
        ),
        imperfections=configuration.imperfections._replace(on=False),
    )


def points_of(duration: float) -> Array:
    """Times of the points of linearisation of a motion [s], shape (K,)."""
    return np.linspace(0.0, duration, max(round(duration / INTERVAL), 1) + 1)


@inline_ir
def state_after(
    advance: Any, setup: PlantSetup, template: PlantState, x: Array, torque: Array, period: float
) -> PlantState:
    """State a period after the state `x`, shape (2c,); `template` is any state."""
    coordinates = read_row(x, 0, template.coordinates)
    rate = read_row(x, len(template.coordinates), template.rate)
    state = PlantState(coordinates, rate, template.torque, 0.0)
    return advance(setup, state, read_row(torque, 0, template.torque), period)


@kernel
def _end_states(
    advance: Any,
    setup: PlantSetup,
    template: PlantState,
    points: Array,
    torques: Array,
    period: float,
) -> tuple[Array, Array]:
    """Where states end under torques.

    Args:
        advance: The plant's step, as FunctionValue.
        setup: The plant.
        template: Any state of it.
        points: States, shape (K, 2c).
        torques: Torques [N m], shape (K, n).
        period: Of the samples [s].

    Returns:
        The states a period later, shape (K, 2c), and their derivatives by the torques.
    """
    count, size = points.shape
    joints, c = torques.shape[1], len(template.coordinates)
    ends, slopes = np.empty((count, size)), np.empty((count, size, joints))
    end = np.empty((2, size))
    for k in range(count):
        x, torque = points[k], torques[k].copy()
        then = state_after(advance, setup, template, x, torque, period)
        write_row(ends[k], 0, then.coordinates)
        write_row(ends[k], c, then.rate)
        for i in range(joints):
            for side in range(2):
                torque[i] = torques[k, i] + (2 * side - 1) * SMALL_STEP
                then = state_after(advance, setup, template, x, torque, period)
                write_row(end[side], 0, then.coordinates)
                write_row(end[side], c, then.rate)
            torque[i] = torques[k, i]
            slopes[k, :, i] = (end[1] - end[0]) / (2.0 * SMALL_STEP)
    return ends, slopes


# what of a configuration a plant depends on
PLANT_PARTS = ('loop', 'true_robot', 'plant', 'joint_load', 'safety', 'imperfections')
CACHE_SIZE = 96  # ideal torques: those of the samples that the laws of a study share
DEGREE = 5  # of the polynomial between two points, through the nearest six


def torque_of(configuration: Configuration) -> Array:
    """The ideal torque of an experiment, whatever its law.

    That of inverse dynamics of the true robot along the reference, and against friction and
    the disturbance of each sample. Noise of the motors is none of it.

    Returns:
        The torque of the step that ends at each sample [N m], shape (N, n), as the plant tells
        the torque that acted.

    Raises:
        InputError: the robot does not reach the motion.
    """
    return along(configuration.trajectory, configuration)


def along(trajectory: Trajectory, configuration: Configuration) -> Array:
    """The ideal torque of a plant along a desired motion, see :func:`torque_of`."""
    loop = configuration.loop._replace(law='', preset='custom')  # else each law would have its own
    plant = configuration.with_parts(loop=loop)
    return _torque(trajectory, *(getattr(plant, part) for part in PLANT_PARTS))


@functools.lru_cache(maxsize=CACHE_SIZE)
def _torque(trajectory: Trajectory, *parts: Any) -> Array:
    plant = Configuration({}).with_parts(**dict(zip(PLANT_PARTS, parts, strict=True)))
    return IdealTorque(trajectory, plant).between(0, (plant.loop.last_index or 0) + 1)


class IdealTorque:
    """The ideal torque of a plant along a desired motion, part by part, see :func:`torque_of`."""

    def __init__(self, trajectory: Trajectory, plant: Configuration) -> None:
        """Prepare.

        Raises:
            InputError: the plant cannot be put together.
        """
        self._trajectory, self._plant = trajectory, plant
        self._smooth = smooth(plant)
        self._assembled = assemble_plant(self._smooth)
        self._points = points_of(plant.loop.duration)
        self._imperfections = plant.imperfections.constants(len(plant.loop.joints))

    def between(self, first: int, stop: int) -> Array:
        """The torques of samples that follow those asked for before [N m], shape (N, n).

        Raises:
            InputError: the robot does not reach the motion.
        """
        period = self._plant.loop.period
        # 1. What moves the robot against viscous friction is smooth: few points of it will do.
        middles, position, velocity, acceleration = _middles(self._trajectory, period, first, stop)
        begin, end = np.searchsorted(self._points, middles[[0, -1]])
        times = self._points[max(begin - DEGREE - 1, 0) : end + DEGREE]
        motion = performed(self._trajectory, self._smooth, times, self._assembled)
        torque = between_points(motion.times + 0.5 * period, motion.torque, middles)
        # 2. Dry friction and disturbances are not.
        friction, disturbance = self._plant.joint_load
        if any(friction.load):  # without viscous friction, which is no load of the gears
            torque = torque - np.array(friction.viscous) * velocity
        else:
            friction = friction._replace(viscous=PerJoint((0.0,) * velocity.shape[1]))
        rest = JointLoad(friction, disturbance)
        setup = motion.plant.setup._replace(imperfections=self._imperfections)
        ideal: Array = _with_loads(
            setup, rest, motion.plant.state.torque, torque, position, velocity, period, first
        )
        drive = self._plant.imperfections.drive
        if drive.on:  # rotors turn as their joints do, but for what their gears give way
            ideal = ideal + np.array(drive.gear.rotor_inertia) * acceleration
        return ideal


def between_points(times: Array, values: Array, wanted: Array) -> Array:
    """Values of a smooth curve between points of it: Lagrange through the nearest six.

    A spline through all points is no nearer, and takes long to import.

    Args:
        times: Evenly spaced times of the points [s], shape (K,).
        values: The curve there, shape (K, m).
        wanted: Times of the values wanted [s], shape (N,).
    """
    last = len(times) - 1
    degree = min(DEGREE, last)
    place = (wanted - times[0]) * (last / (times[-1] - times[0]))
    first = np.clip(place.astype(int) - degree // 2, 0, last - degree)
    nodes = np.arange(degree + 1)
    curve = np.zeros((len(wanted), values.shape[1]))
    for node in nodes:
        others = np.delete(nodes, node)
        weight = np.prod(((place - first)[:, np.newaxis] - others) / (node - others), axis=1)
        curve += weight[:, np.newaxis] * values[first + node]
    return curve


@functools.lru_cache(maxsize=2)
def _middles(
    trajectory: Trajectory, period: float, first: int, stop: int
) -> tuple[Array, Array, Array, Array]:
    """The middle of the step before samples [s], joints with two derivatives [rad, s] there."""
    middles = np.maximum(np.arange(first, stop) - 0.5, 0.0) * period
    motion = trajectory.sample(middles)
    return middles, motion.position, motion.velocity, motion.acceleration


@kernel
def _with_loads(
    setup: PlantSetup,
    load: JointLoad,
    template: Array,
    torque: Array,
    position: Array,
    velocity: Array,
    period: float,
    first: int,
) -> Array:
    """Torques with what the loads of each step take.

    Args:
        setup: The plant, with memory of its own.
        load: Friction and disturbance that are not in the torques yet.
        template: Any torque.
        torque: Torques of the step before each sample [N m], shape (N, n).
        position: Joints in the middle of it [rad], shape (N, n).
        velocity: Rates of the joints in the middle of it [rad/s], shape (N, n).
        period: Of the samples [s].
        first: Sample of the first row; no step ends at sample 0.
    """
    ideal = torque.copy()
    for k in range(0 if first else 1, len(torque)):
        begin = (first + k - 1) * period
        rate = read_row(velocity, k, template)
        needed = motor_torque(load, read_row(torque, k, template), rate, begin + 0.5 * period)
        if setup.imperfections.on:
            start = read_row(position, k, template) - 0.5 * period * rate
            needed = needed + held_disturbance(setup, start, begin, period)
        write_row(ideal, k, needed)
    return ideal
