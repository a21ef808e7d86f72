"""The motions of a run in a bag: the true one where the bag is of a plant, and what was seen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags.experiment import SIMULATION
from parallel_robot.bags.history import History
from parallel_robot.bags.run import recorded_robot
from parallel_robot.bags.run.run_log import RunLog, TopicCount, head, with_reference
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.errors import (
    KinematicsError,
    ParallelRobotError,
    WholeNeededError,
)
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.fields import corrected
from parallel_robot_model.messages.topics import COMMANDS, REFERENCE
from parallel_robot_model.robots.registry import is_known, robot_of
from parallel_robot_sim import plant_replay
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.ideal_torque import along
from parallel_robot_sim.imperfections import reported_age
from parallel_robot_sim.motions import (
    LastPoses,
    Motion,
    Motions,
    Poses,
    PoseTracker,
    poses_of,
    sensor_remarks,
    untrue,
)
from parallel_robot_sim.plant import MUJOCO
from parallel_robot_sim.plant_replay import UnderCommands
from parallel_robot_sim.simulation import saturation
from trajectory_gen.configuration import trajectory_of

# The true motion behind noise and delays: the plant moves once more, window by window.

MESSAGES = REFERENCE, COMMANDS  # that are counted
SAME = 1e-9  # rad, to which a plant that moves again tells the same
FEW = 1e-3  # share of its states that may differ: steps of an encoder on another processor


class PlantWindows:
    """The true motion of a bag, in parts; what is special needs the whole bag."""

    def __init__(self, bag: Path, values: Mapping[str, Any], past: History) -> None:
        """Put the plant together.

        Args:
            bag: The bag, for error messages.
            values: Its configuration.
            past: What it says beside the motion.

        Raises:
            WholeNeededError: its plant cannot move again in windows.
        """
        self._bag, self._simulated = bag, past.facts.get('source') == SIMULATION
        try:
            configuration = configure_plant(values)
            self._plant = UnderCommands(configuration)
            self._trajectory = trajectory_of(values)
            nominal, guess = nominal_of(values)
            self._located = PoseTracker(nominal, robot_of(values, 'true_robot'), guess)
        except ParallelRobotError as error:
            raise self._whole(str(error)) from None
        loop = configuration.loop
        special = configuration.plant.engine == MUJOCO or values.get('hazards')
        if special or not (self._simulated or loop.lockstep):
            raise self._whole('it is no simulation without hazards')
        self._tick, self._period, self._age = loop.period_ns, loop.period, reported_age(values)
        self._moved = self._differing = self._references = self._commands = 0
        self._over = False  # the last state had no answer

    def of(self, log: RunLog) -> Motion:
        """The true motion at the states of the next window.

        Raises:
            WholeNeededError: a state or its answer is not there, or there is no pose.
        """
        measured = np.rint((log.stamps + self._age - log.start_stamp) / self._tick).astype(int)
        samples = self._moved + np.arange(len(measured))
        torque = log.answer.copy()
        if np.isnan(torque[-1]).any():  # perhaps the last one of all, after which nothing moves
            torque[-1] = 0.0
        if not np.array_equal(measured, samples) or np.isnan(torque).any() or self._over:
            raise self._whole('it lacks states or commands')
        self._over = bool(np.isnan(log.answer[-1]).any())
        joints, told, effort = self._plant.moved(torque)
        if len(joints) < len(samples):
            raise self._whole('its plant does not move on')
        self._moved += len(joints)
        apart = np.abs(told - log.position).max(axis=1)
        self._differing += int((apart > SAME).sum())
        nothing = TopicCount(0, 0)
        references, commands = (log.messages.get(each.name, nothing) for each in MESSAGES)
        self._references += references.count + references.missing
        self._commands += commands.count
        wanted = self._trajectory.sample(samples * self._period).position
        try:
            poses = self._located.poses(wanted, joints)
        except ParallelRobotError as error:
            raise self._whole(str(error)) from None
        return Motion(self._tick * samples / NANOSECONDS, joints, wanted, effort, poses)

    def check(self) -> None:
        """Refuse a plant that was another one than that of the bag, at its end.

        Raises:
            WholeNeededError: it was, or the bag lacks states at its end.
        """
        if self._simulated and self._moved != self._references:
            raise self._whole('it lacks states')
        if self._commands < self._moved - self._over:
            raise self._whole('it lacks commands')
        if self._differing > FEW * self._moved:
            raise self._whole('its plant is another one')

    def _whole(self, reason: str) -> WholeNeededError:
        return WholeNeededError(f'{self._bag}: {reason}: its plant moves again as a whole alone')


MOST_STEPS = 2  # samples for each state of a bag; if more, too many are missing
PLANNED = 1e-6  # rad, to which references are those that were planned
ROUNDING = 1e-6  # s, much less than between two samples
UNKNOWN = 'the plant of this bag is not known: errors are those seen, by the nominal robot'
LONG = 'it is too long for its plant to move again'
HIDDEN = 'the sensors are not ideal ({0}) and the bag does not tell the true motion: {1}'


class Recorded(NamedTuple):
    """The motions of a bag."""

    log: RunLog  # the run, up to the first sample without a pose
    poses: Poses  # poses of its joints by the nominal robot
    motions: Motions
    cut: str  # why only a part of it is there; empty when all of it is
    remark: str  # why there is no true motion; empty when there is one
    # for how long the motors of a plant that is known gave all they can
    saturated: tuple[str, ...] = ()

    @property
    def remarks(self) -> list[str]:
        """What to know of the figures, one line each."""
        return [*filter(None, [self.remark]), *self.saturated]

    @property
    def doubts(self) -> list[str]:
        """That its joints are not the true ones, where they are not and those are known."""
        return [] if self.motions.true is None else sensor_remarks(self.log.config)

    @property
    def pose(self) -> np.ndarray:
        """Best pose at each state of the log, shape (N, m)."""
        best = self.motions.best
        rows = np.searchsorted(best.time, self.log.time - ROUNDING)
        return best.poses.actual[np.minimum(rows, len(best.time) - 1)]


def poses_of_log(log: RunLog, true: bool = False, left: LastPoses | None = None) -> Poses:
    """Poses of the measured and of the desired joints; the latter by the nominal robot.

    Those of a robot that is not known here are NaN, as many numbers as it has joints.

    Args:
        log: The run.
        true: Whether the measured joints are those of the true robot, else of the nominal one.
        left: Where the poses of the part of the run before were left; None: it is the first part.

    Raises:
        InputError: the robot of the log's configuration cannot be built.
        KinematicsError: a sample has no pose in the assembly mode of the scenario.
    """
    if not is_known(log.config):
        nowhere = np.full_like(log.position, np.nan)
        return Poses(nowhere, nowhere, place=0)
    nominal, guess = nominal_of(log.config)
    actual = robot_of(log.config, 'true_robot') if true else nominal
    return poses_of(nominal, actual, guess, log.reference_position, log.position, left)


def with_poses(
    log: RunLog, true: bool = False, left: LastPoses | None = None
) -> tuple[RunLog, Poses, str]:
    """The run up to the first sample that has no pose, without states that have no reference.

    Arguments as of :func:`poses_of_log`.

    Returns:
        The run, its poses, and why it was cut off; empty when it was not.

    Raises:
        KinematicsError: not even the first sample has a pose, or none has a reference of its time.
    """
    log = with_reference(log)
    if not len(log.time):
        raise KinematicsError('no state has a reference of its time')
    try:
        return log, poses_of_log(log, true, left), ''
    except KinematicsError as error:
        reason = str(error)
    good, bad = 0, len(log.time)
    while bad - good > 1:
        middle = (good + bad) // 2
        try:
            poses_of_log(head(log, middle), true, left)
            good = middle
        except KinematicsError:
            bad = middle
    part = head(log, max(good, 1))
    cut = f'evaluated up to t = {part.time[-1]:.3f} s: {reason}'
    return part, poses_of_log(part, true, left), cut


def of_bag(log: RunLog, past: History) -> Recorded:
    """Find the motions of a bag.

    Where the states do not tell the true joints, the plant moves once more under the commands, or
    torques, of the bag; what it tells must be what the bag says.

    Args:
        log: The run.
        past: What the bag says beside the motion.

    Raises:
        InputError: the robot of the bag cannot be built.
        KinematicsError: not even the first sample has a pose.
    """
    found = _of_bag(log, past, NOTHING)
    true = found.motions.true
    if true is None:
        return found
    return found._replace(motions=found.motions._replace(ideal=_ideal(log, true)))


class InParts:
    """The motions of a run part by part, without the ideal torque, to the last bit as at once."""

    def __init__(self, plant: PlantWindows | None = None) -> None:
        """Begin before the first part; `plant`: tells the true motion, if it is not seen."""
        self._left, self._plant = NOTHING, plant

    def of(self, log: RunLog, past: History, whole: bool = True) -> Recorded:
        """The motions of the next part.

        Args:
            log: The part; of a run that :func:`moves_again`, all of it.
            past: What the bag says beside the motion.
            whole: Whether the plant may move once more, for which the part has to be all there is.

        Raises:
            InputError: the robot of the bag cannot be built.
            KinematicsError: not even the first sample of the part has a pose.
        """
        found = _of_bag(log, past, self._left, whole, self._plant)
        count = len(found.log.time) + (self._left.seen.samples if self._left.seen else 0)
        true = found.motions.true
        self._left = _Left(
            *(
                LastPoses(poses.actual[-1], poses.reference[-1], count)
                for poses in (found.poses, found.poses if true is None else true.poses)
            )
        )
        return found


def moves_again(values: Mapping[str, Any], past: History) -> bool:
    """Whether the plant of a bag has to move once more to tell the true motion: all of it."""
    return of_plant(past) and not recorded_robot.unknown(values) and bool(untrue(values))


class _Left(NamedTuple):
    """Where the poses were left of what was seen and of the true motion."""

    seen: LastPoses | None
    true: LastPoses | None


NOTHING = _Left(None, None)


def _of_bag(
    log: RunLog,
    past: History,
    left: _Left,
    whole: bool = True,
    plant: PlantWindows | None = None,
) -> Recorded:
    """The motions of a bag, or of its next part, without the ideal torque."""
    taken, poses, cut = with_poses(
        log._replace(position=corrected(log.config, log.position)), left=left.seen
    )
    seen = Motion(taken.time, taken.position, taken.reference_position, taken.effort, poses)
    part = head(with_reference(log), len(taken.time))
    unknown = recorded_robot.unknown(log.config)
    if unknown:
        return Recorded(part, poses, Motions(None, seen), cut, unknown)
    if not of_plant(past):
        return Recorded(part, poses, Motions(None, seen), cut, UNKNOWN)
    hidden, saturated = untrue(log.config), tuple(saturation(log.config, part.effort))
    if not hidden:
        if robot_of(log.config) == robot_of(log.config, 'true_robot'):
            return Recorded(part, poses, Motions(seen, None), cut, '', saturated)
        true = seen._replace(poses=poses_of_log(part, True, left.true))
        return Recorded(part, poses, Motions(true, seen), cut, '', saturated)
    if plant is not None:
        return Recorded(part, poses, Motions(plant.of(log), seen), cut, '', saturated)
    other = 'it is not the motion of the plant as it is now' if whole else LONG
    try:
        again = _again(log, past) if whole else None
        reason = other if again is None else ''
    except ParallelRobotError as error:
        again, reason = None, str(error)
    remark = HIDDEN.format(', '.join(hidden), reason) if reason else ''
    return Recorded(part, poses, Motions(again, seen), cut, remark, saturated)


def _ideal(log: RunLog, true: Motion) -> np.ndarray | None:
    """The ideal torque at each sample of a true motion [N m], shape (N, n).

    None where the plant is not known exactly, or its motion is not the one that was planned.
    """
    try:
        configuration, trajectory = configure_plant(log.config), trajectory_of(log.config)
        rows = np.rint(true.time / configuration.loop.period).astype(np.int64)
        last = int(rows[-1])
        if configuration.plant.engine == MUJOCO or not 0 <= rows[0] < last <= MOST_STEPS * len(
            rows
        ):
            return None
        if configuration.loop.last_index != last:  # it ended early, or had no end
            configuration = configuration.with_parts(
                loop=configuration.loop._replace(duration=last * configuration.loop.period)
            )
        planned = trajectory.sample(configuration.loop.period * rows).position
        if np.abs(planned - true.reference_position).max() > PLANNED:
            return None
        return along(trajectory, configuration)[rows]
    except ParallelRobotError:
        return None


def two_motions(values: Mapping[str, Any], past: History, moved: bool) -> tuple[bool, bool]:
    """Whether windows of a bag have a true motion, and one that was seen beside it.

    Args:
        values: Its configuration.
        past: What it says beside the motion.
        moved: Whether its plant moves once more.
    """
    if moved:
        return True, True
    if recorded_robot.unknown(values) or not of_plant(past) or untrue(values):
        return False, True
    return True, robot_of(values) != robot_of(values, 'true_robot')


def of_plant(past: History) -> bool:
    """Whether the suite's plant moved the robot, with parameters that the bag has."""
    nodes = {name.rpartition('/')[2] for name in past.parameters}
    return past.facts.get('source') == SIMULATION or bool(past.facts and 'plant' in nodes)


def _again(log: RunLog, past: History) -> Motion | None:
    """The true motion by the plant that moves once more; None if it is another one."""
    configuration = configure_plant(log.config)
    loop = configuration.loop
    if configuration.plant.engine == MUJOCO:
        return None
    tick, age = loop.period_ns, reported_age(log.config)
    measured = np.rint((log.stamps + age - log.start_stamp) / tick).astype(int)
    count = int(measured[-1]) + 1
    simulated = past.facts.get('source') == SIMULATION
    if simulated:  # its last states may be lost, or their stamps be ahead
        references = log.messages[REFERENCE.name]
        count = references.count + references.missing
    reference = trajectory_of(log.config).sample(np.arange(count) * loop.period)
    if simulated or loop.lockstep:
        again = plant_replay.under_commands(configuration, log.command, reference)
    elif len(log.stamps) == count and not age:
        again = plant_replay.under_torques(configuration, log.effort, reference)
    else:
        again = None
    if again is None or not _told(log, again, measured):
        return None
    nominal, guess = nominal_of(log.config)
    true, rows = robot_of(log.config, 'true_robot'), slice(len(again.joints))
    wanted = reference.position[rows]
    poses = poses_of(nominal, true, guess, wanted, again.joints)
    time = tick * np.arange(len(wanted)) / NANOSECONDS
    return Motion(time, again.joints, wanted, again.effort, poses)


def _told(log: RunLog, again: plant_replay.PlantReplay, measured: NDArray[np.int64]) -> bool:
    """Whether a plant told what a bag says, but for few states; `measured`: their samples."""
    rows = np.flatnonzero(again.reception.published[: len(again.measured)])
    samples = rows - again.reception.late[rows]
    kept = np.isin(samples, measured)  # states that are not valid are not read
    rows, samples = rows[kept], samples[kept]
    if (np.diff(measured) >= 0).all():  # they were put in order
        rows = rows[np.argsort(samples, kind='stable')]
    told = again.measured[rows]
    if len(told) != len(log.position):
        return False
    return bool(np.mean(np.abs(told - log.position).max(axis=1) > SAME) <= FEW)
