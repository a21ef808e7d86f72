"""A run as its true motion and as the motion that is seen through sensors and nominal robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import JointReference
from parallel_robot_control.reference_buffer import extrapolate_rows
from parallel_robot_model.common.errors import KinematicsError
from parallel_robot_model.common.units import HINGES, NANOSECONDS, Array, JointUnits
from parallel_robot_model.configuration.fields import (
    ESTIMATOR,
    ZeroAngles,
    corrected,
    declared_in,
    untrue_keys,
)
from parallel_robot_model.configuration.hazard_table import INVALID
from parallel_robot_model.configuration.loop import SWAPPED
from parallel_robot_model.robots import poses as forward
from parallel_robot_model.robots.contract import PLACE
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.configuration import Configuration
from parallel_robot_sim.ideal_torque import torque_of
from parallel_robot_sim.imperfections import JOINT
from parallel_robot_sim.plant_core import ReportedEffort
from parallel_robot_sim.simulation import Simulation
from parallel_robot_sim.timeline import Timeline
from trajectory_gen.trajectory import Reference

# Parameters by which the measured joints differ from the true ones, see docs/noise.md.
GEARS = 'compliance.stiffness'  # where sensors are at the motors
UNTRUE = [*untrue_keys((*declared_in(Configuration), (ESTIMATOR, ZeroAngles))), 'hazards']
MEASURED_REMARK = (
    'the sensors are not ideal ({0}): positions are as they tell them, the pose is the true one'
)


class Poses(NamedTuple):
    """Poses by forward kinematics of the joints."""

    actual: np.ndarray  # poses of the joints, shape (N, m)
    reference: np.ndarray  # poses of the desired joints, shape (N, m)
    # number of their first coordinates that are a place [m]; 0: no distance is defined
    place: int = 2
    units: JointUnits = HINGES  # units of the joints of the robot
    # components of a rotation vector that follow a place in space, 0 to 2
    rotation_components: tuple[int, ...] = ()
    axes: tuple[str, ...] = PLACE  # along which the coordinates of the place are, and more

    @property
    def in_space(self) -> bool:
        """Whether the place is one in space, not in a plane."""
        return self.place == len('xyz')


class LastPoses(NamedTuple):
    """The last poses of a part of a motion, from which the next part goes on."""

    actual: np.ndarray  # the last pose of the joints, shape (m,)
    reference: np.ndarray  # the last one of the desired joints, shape (m,)
    samples: int  # how many there are so far


class Motion(NamedTuple):
    """A motion of which metrics are computed."""

    time: np.ndarray  # since t = 0 [s], shape (N,)
    position: np.ndarray  # actuated joints [rad], shape (N, n)
    reference_position: np.ndarray  # their desired positions [rad], shape (N, n)
    # torque of the motors during the step that ended at each sample [N m], shape (N, n)
    effort: np.ndarray
    poses: Poses  # poses of the robot

    def between(self, begin: float, end: float) -> Motion:
        """The part from one time on, up to another one [s]."""
        return self.rows(slice(*np.searchsorted(self.time, [begin, end])))

    def rows(self, rows: slice | np.ndarray) -> Motion:
        """Some samples, by a slice or by their numbers."""
        poses = self.poses
        return Motion(
            self.time[rows],
            self.position[rows],
            self.reference_position[rows],
            self.effort[rows],
            poses._replace(actual=poses.actual[rows], reference=poses.reference[rows]),
        )


class Motions(NamedTuple):
    """A run as it was, and as it was seen."""

    # the motion of the plant; None where the plant is not known, as that of a real robot
    true: Motion | None
    # what sensors and the nominal robot make of it; None where that is the true motion, or
    # has no poses
    seen: Motion | None
    # torque that holds the true robot on its reference at each sample of the true motion,
    # see ideal_torque.py [N m], shape (N, n); None where it is not known
    ideal: Array | None = None

    @property
    def best(self) -> Motion:
        """The true motion where it is known, else the one that was seen."""
        best = self.seen if self.true is None else self.true
        assert best is not None
        return best

    def between(self, begin: float, end: float) -> Motions:
        """The part from one time on, up to another one [s]."""
        true, seen = (each and each.between(begin, end) for each in (self.true, self.seen))
        ideal = self.ideal
        if ideal is not None and self.true is not None:
            ideal = ideal[slice(*np.searchsorted(self.true.time, [begin, end]))]
        return Motions(true, seen, ideal)


def untrue(values: Mapping[str, Any]) -> list[str]:
    """Parameters of a resolved configuration by which measured joints are not the true ones."""
    ideal = {GEARS} if values.get('compliance.sensor') == JOINT else set()
    keys = (key for key in UNTRUE if key not in ideal)
    return [key for key in keys if np.any(np.asarray(values.get(key, 0.0), object) != 0.0)]


def differs(values: Mapping[str, Any]) -> bool:
    """Whether sensors and nominal robot of a configuration show another motion than the true."""
    prefix = 'true_robot.'
    return bool(untrue(values)) or any(
        value != values.get(f'robot.{key.removeprefix(prefix)}')
        for key, value in values.items()
        if key.startswith(prefix)
    )


def sensor_remarks(values: Mapping[str, Any]) -> list[str]:
    """A line that says that the joints of a run are not the true ones, if they are not."""
    hidden = untrue(values)
    return [MEASURED_REMARK.format(', '.join(hidden))] if hidden else []


def poses_of(
    desired: RobotModel,
    actual: RobotModel,
    guess: Array,
    reference: Array,
    position: Array,
    last: LastPoses | None = None,
) -> Poses:
    """Poses of a motion.

    Args:
        desired: The nominal robot, for which the references are.
        actual: The robot whose joints they are: the true one, or the nominal one for what is seen.
        guess: Pose from which forward kinematics starts, shape (m,).
        reference: Desired positions of the joints [rad], shape (N, n).
        position: The joints [rad], shape (N, n).
        last: Where those before were left; None: there are none.

    Raises:
        KinematicsError: a sample has no pose in the assembly mode of the guess.
    """
    first = last.samples if last else 0
    guess, near = (last.reference, last.actual) if last else (guess, None)
    wanted = forward.poses_of(desired, reference, guess, first=first)
    near = wanted[0] if near is None else near
    found = forward.poses_of(actual, position, near, first=first)
    own = desired.place, desired.joint_units, desired.rotation_components, desired.axes
    return Poses(found, wanted, *own)


def of_simulation(made: Simulation) -> Motions:
    """The motions of a simulation, to the last bit those of its bag.

    Raises:
        InputError: the robot does not reach the motion.
        KinematicsError: a sample of the true motion has no pose.
    """
    return SimulatedMotions(made.configuration).of(made, torque_of(made.configuration))


class SimulatedMotions:
    """The motions of a simulation, part by part: what a part hands on to the next."""

    def __init__(self, configuration: Configuration) -> None:
        nominal, true = configuration.robot, configuration.true_robot
        exact = not untrue(configuration.values)
        guess = np.array(configuration.guess)
        # the joints as measured; None where that is the true motion
        self.measured = None if exact else MeasuredMotion(configuration)
        self._true = PoseTracker(nominal, true, guess)
        self._seen: PoseTracker | None = PoseTracker(nominal, nominal, guess)
        if exact and nominal.parameters == true.parameters:
            self._seen = None

    def of(self, part: Simulation, ideal: Array) -> Motions:
        """The motions of the next part.

        Args:
            part: The part.
            ideal: Ideal torque of its samples, or of more [N m], shape (N, n).

        Raises:
            KinematicsError: a sample of the true motion has no pose.
        """
        run, rows = part.run, slice(part.run.steps)
        loop = part.experiment.loop
        time = loop.period_ns * (part.first + np.arange(run.steps)) / NANOSECONDS  # as stamps tell
        joints, wanted = run.joints[rows], part.reference.position[rows]
        moved = Motion(time, joints, wanted, run.effort[rows], self._true.poses(wanted, joints))
        measured = moved if self.measured is None else self.measured.of(part)
        if self._seen is not None:
            try:
                poses = self._seen.poses(measured.reference_position, measured.position)
                return Motions(moved, measured._replace(poses=poses), ideal[rows])
            except KinematicsError:
                self._seen = None
        return Motions(moved, None, ideal[rows])


class PoseTracker:
    """Poses of a motion, part by part, see :func:`poses_of`."""

    def __init__(self, desired: RobotModel, actual: RobotModel, guess: Array) -> None:
        self._robots = desired, actual, guess
        self._last: LastPoses | None = None

    def poses(self, reference: Array, position: Array) -> Poses:
        """Poses of the next part of the motion.

        Raises:
            KinematicsError: a sample has no pose in the assembly mode of the guess.
        """
        last = self._last
        found = poses_of(*self._robots, reference, position, last)
        count = len(position) + (last.samples if last else 0)
        self._last = LastPoses(found.actual[-1], found.reference[-1], count)
        return found


class MeasuredMotion:
    """The joints of a simulation as measured, part by part, without their poses.

    As of a bag: those of valid states that have a reference, in the order of their stamps.
    """

    def __init__(self, configuration: Configuration) -> None:
        self._values = configuration.values
        self._tick: int = configuration.loop.period_ns
        self._late = round(configuration.imperfections.age * NANOSECONDS / self._tick)
        timeout = configuration.safety.reference_timeout * NANOSECONDS
        self._oldest = round(max(timeout, 2.0 * self._tick)) // self._tick
        self._effort = ReportedEffort(self._late)
        self._before: JointReference  # the last rows of the part before

    def of(self, part: Simulation) -> Motion:
        """The motion of the next part."""
        run, late = part.run, part.timeline.reception.late
        rows, time, reference = self.reference(part.timeline, part.reference, part.first)
        return Motion(
            time,
            corrected(self._values, run.position[rows]),
            reference,
            self._effort.of(run.effort[: run.steps])[rows - np.maximum(late[rows], 0)],
            Poses(run.pose[:0], run.pose[:0]),
        )

    def reference(
        self, timeline: Timeline, desired: Reference, first: int
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """What the states of the next part are to be.

        Args:
            timeline: The course of the part.
            desired: Its desired motion.
            first: Sample of its first row.

        Returns:
            Rows of the part, their times [s], and desired positions then [rad], shape (K, n).
        """
        tick, late = self._tick, self._late
        motion = JointReference(desired.position, desired.velocity, desired.acceleration)
        if first:
            motion = JointReference(*map(np.vstack, zip(self._before, motion, strict=True)))
        begin = first + len(desired.position) - len(motion.position)  # sample of its first row
        self._before = JointReference(*(each[max(len(each) - late, 0) :] for each in motion))
        last = first + len(desired.position) - 1
        reception = timeline.reception
        rows = np.flatnonzero(reception.published & (reception.refused != INVALID))
        measured = first + rows - reception.late[rows]
        valid = (measured >= 0) & (measured <= last + self._oldest)
        rows, measured = rows[valid], measured[valid]
        back = tick * (np.maximum.accumulate(measured) - measured)
        if len(rows) and back.max() <= SWAPPED:
            order = np.argsort(measured, kind='stable')
            rows, measured = rows[order], measured[order]
        known = np.clip(
            measured - late, 0, last
        )  # the newest reference at the stamp, or the first
        reference = extrapolate_rows(
            tick * (measured - late - known), *(each[known - begin] for each in motion)
        )
        return rows, tick * (measured - late) / NANOSECONDS, reference.position
