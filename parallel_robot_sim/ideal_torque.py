"""The ideal torque of a simulated run: it holds the true robot exactly on the reference.

Only a simulation knows it: it takes the true robot, its friction, and the disturbances that acted.
"""

from __future__ import annotations

import functools

import numpy as np

from parallel_robot_model.common.arrays import Array
from parallel_robot_model.compiler import Boxed, kernel, read_row, write_row
from parallel_robot_model.configuration.fields import PerJoint
from parallel_robot_model.robots.joint_load import JointLoad, net_torque
from parallel_robot_sim.actuators import held_disturbance
from parallel_robot_sim.configuration import Configuration, PlantConfiguration
from parallel_robot_sim.performed_motion import performed, points_of, smooth
from parallel_robot_sim.plant import PlantSetup
from trajectory_gen.trajectory import Trajectory

AROUND = 40  # points around a part that its spline needs to be that of the whole
KEPT = 96  # ideal torques: those of the samples that the laws of a study share


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
    return IdealTorque(trajectory, plant).until((plant.loop.last_index or 0) + 1)


class IdealTorque:
    """The ideal torque along a desired motion of any length, part by part."""

    def __init__(self, trajectory: Trajectory, plant: PlantConfiguration) -> None:
        """Prepare; the motion has the duration of the plant's loop."""
        self._trajectory, self._plant = trajectory, plant
        self._smooth, self._times = smooth(plant), points_of(plant.loop.duration)
        self._setup: PlantSetup | None = None
        self._next = 0

    def until(self, stop: int) -> Array:
        """The torques of the samples that follow the last ones, up to one [N m], shape (N, n)."""
        from scipy.interpolate import make_interp_spline  # slow to import

        plant, period = self._plant, self._plant.loop.period
        # 1. What moves the robot against viscous friction is smooth: few points of it will do.
        middles, velocity = _middles(self._trajectory, period, self._next, stop)
        first, last = np.searchsorted(self._times, middles[[0, -1]])
        times = self._times[max(first - AROUND, 0) : last + AROUND]
        motion = performed(self._trajectory, self._smooth, times)
        degree = min(3, len(motion.times) - 1)
        spline = make_interp_spline(motion.times + 0.5 * period, motion.torque, degree)
        torque = np.ascontiguousarray(spline(middles))
        # 2. Dry friction and disturbances are not.
        friction, disturbance = plant.load
        still = PerJoint((0.0,) * len(plant.loop.joints))
        rest = JointLoad(friction._replace(viscous=still), disturbance)
        state = motion.plant.state
        if self._setup is None:
            memory = Boxed(plant.imperfections.with_memory(state.torque))
            self._setup = motion.plant.setup._replace(imperfections=memory)
        ideal: Array = _with_loads(
            self._setup, rest, state.torque, torque, velocity, self._next, period
        )
        self._next = stop
        return ideal


@functools.lru_cache(maxsize=2)
def _middles(trajectory: Trajectory, period: float, first: int, stop: int) -> tuple[Array, Array]:
    """The middle of the step before each sample [s], and the rates of the joints [rad/s]."""
    middles = np.maximum(np.arange(first, stop) - 0.5, 0.0) * period
    return middles, trajectory.sample(middles).velocity


@kernel
def _with_loads(
    setup: PlantSetup,
    load: JointLoad,
    like: Array,
    torque: Array,
    velocity: Array,
    first: int,
    period: float,
) -> Array:
    """Torques with what the loads of each step take.

    Args:
        setup: The plant, with memory of its own.
        load: Friction and disturbance that are not in the torques yet.
        like: Any torque.
        torque: Torques of the step before each sample [N m], shape (N, n).
        velocity: Rates of the joints in the middle of it [rad/s], shape (N, n).
        first: Number of the first sample.
        period: Of the samples [s].
    """
    ideal = torque.copy()
    for k in range(0 if first else 1, len(torque)):
        begin = (first + k - 1) * period
        rate = read_row(velocity, k, like)
        # net_torque(t) = t - loads, so -net_torque(-t) = t + loads.
        needed = -net_torque(load, -read_row(torque, k, like), rate, begin + 0.5 * period)
        if setup.imperfections.on:
            needed = needed + held_disturbance(setup, like, begin, period)
        write_row(ideal, k, needed)
    return ideal
