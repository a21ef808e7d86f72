"""The ideal torque of a simulated run: it holds the true robot exactly on the reference.

Only a simulation knows it: it takes the true robot, its friction, and the disturbances that acted.
"""

from __future__ import annotations

import functools

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, kernel, read_row, write_row
from parallel_robot_model.configuration.fields import PerJoint
from parallel_robot_model.robots.joint_load import JointLoad, net_torque
from parallel_robot_sim.assembly import assemble_plant
from parallel_robot_sim.configuration import Configuration, PlantConfiguration
from parallel_robot_sim.performed_motion import performed, points_of, smooth
from parallel_robot_sim.plant import PlantSetup
from parallel_robot_sim.sensors_actuators import held_disturbance
from trajectory_gen.trajectory import Trajectory

KEPT = 96  # ideal torques: those of the samples that the laws of a study share
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
    return along(configuration.trajectory, configuration.plant)


def along(trajectory: Trajectory, plant: PlantConfiguration) -> Array:
    """The ideal torque of a plant along a desired motion, see :func:`torque_of`."""
    loop = plant.loop._replace(law='', preset='custom')  # else each law would have its own
    return _torque(trajectory, plant._replace(loop=loop))


@functools.lru_cache(maxsize=KEPT)
def _torque(trajectory: Trajectory, plant: PlantConfiguration) -> Array:
    return IdealTorque(trajectory, plant).between(0, (plant.loop.last_index or 0) + 1)


class IdealTorque:
    """The ideal torque of a plant along a desired motion, part by part, see :func:`torque_of`."""

    def __init__(self, trajectory: Trajectory, plant: PlantConfiguration) -> None:
        """Prepare.

        Raises:
            InputError: the plant cannot be put together.
        """
        self._trajectory, self._plant = trajectory, plant
        self._smooth = smooth(plant)
        self._assembled = assemble_plant(self._smooth)
        self._points = points_of(plant.loop.duration)
        self._imperfections = Boxed(plant.imperfections.with_memory(self._assembled.state.torque))

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
        drive = self._plant.imperfections.drive
        if drive.on:  # rotors turn as their joints do, but for what their gears give way
            torque = torque + np.array(drive.rotor_inertia) * acceleration
        # 2. Dry friction and disturbances are not.
        friction, disturbance = self._plant.load
        still = PerJoint((0.0,) * len(self._plant.loop.joints))
        rest = JointLoad(friction._replace(viscous=still), disturbance)
        setup = motion.plant.setup._replace(imperfections=self._imperfections)
        ideal: Array = _with_loads(
            setup, rest, motion.plant.state.torque, torque, position, velocity, period, first
        )
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
    like: Array,
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
        like: Any torque.
        torque: Torques of the step before each sample [N m], shape (N, n).
        position: Joints in the middle of it [rad], shape (N, n).
        velocity: Rates of the joints in the middle of it [rad/s], shape (N, n).
        period: Of the samples [s].
        first: Sample of the first row; no step ends at sample 0.
    """
    ideal = torque.copy()
    for k in range(0 if first else 1, len(torque)):
        begin = (first + k - 1) * period
        rate = read_row(velocity, k, like)
        # net_torque(t) = t - loads, so -net_torque(-t) = t + loads.
        needed = -net_torque(load, -read_row(torque, k, like), rate, begin + 0.5 * period)
        if setup.imperfections.on:
            start = read_row(position, k, like) - 0.5 * period * rate
            needed = needed + held_disturbance(setup, start, begin, period)
        write_row(ideal, k, needed)
    return ideal
