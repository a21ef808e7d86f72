"""Metrics of a run: pure functions of its arrays."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from parallel_robot.bags.run.run_log import ReferenceMoves, RunLog, head, with_reference
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.errors import InputError, KinematicsError
from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_model.common.units import HINGES, JointUnits
from parallel_robot_model.robots.contract import angles_between
from parallel_robot_model.robots.registry import is_known, robot_of
from parallel_robot_sim.motions import LastPoses, Motion, Motions, poses_of
from parallel_robot_sim.motions import Poses as Poses

TRUE: Literal['true'] = 'true'
SEEN: Literal['seen'] = 'seen'
SMOOTH = 0.02  # s, in which a torque that does not chatter hardly changes
BELOW = 0.5  # s, for which an error must stay below a bound before that counts as reached
FALLS = 3.0  # ratio of the errors of a part's halves; if larger, the robot had not settled
SLOW = 0.01  # of the largest speed of a motion; one that ends slower comes to rest


class Errors(NamedTuple):
    """Tracking errors over a part of a run."""

    # root mean square distance of the end effector from its reference [m]; NaN for a robot
    # whose pose is not a place
    xy_rms_m: float
    xy_max_m: float  # largest distance [m]; NaN for such a robot
    joint_rms_rad: float  # root mean square joint error over all joints [rad]
    sync_rms_rad: float  # root mean square synchronisation error over all joints [rad]
    # root mean square angle by which the end effector is turned from its reference [rad];
    # NaN where no rotation is a part of the pose
    rotation_rms_rad: float = math.nan
    rotation_max_rad: float = math.nan  # largest such angle [rad]


class Torque(NamedTuple):
    """Motor torques over a whole motion."""

    max_nm: float  # largest absolute torque of any joint [N m]
    # sum over the joints of |change of torque|, per second [N m/s]
    total_variation_nm_per_s: float
    # root mean square, over all joints and the window, of the torque minus its moving mean
    # over SMOOTH [N m]; NaN of samples too far apart for one
    chattering_nm: float


class Effort(NamedTuple):
    """What the motors are put to over the window."""

    torque_rms_nm: float = math.nan  # root mean square torque over all joints [N m]
    # mechanical work of all motors, braking as dear as driving: the sum over the joints of
    # the integral of |torque x rate| [J]. The torque is constant over a period, so that is
    # |torque x change of the position|, summed
    energy_j: float = math.nan
    # chattering that does not help to hold the robot on its reference, see
    # :func:`excess_chattering` [N m]; NaN where the ideal torque is not known
    excess_chattering_nm: float = math.nan


class Transient(NamedTuple):
    """How fast the end effector reaches its reference and stays there."""

    # time after which the distance stays below 1 mm, for BELOW or more [s]; None if never,
    # NaN for a robot whose pose is not a place
    to_1_mm_s: float | None
    to_0_1_mm_s: float | None  # the same for 0.1 mm [s]


class Window(NamedTuple):
    """Over which part of a run errors, chattering and effort are taken: its window."""

    start_s: float  # its begin [s]
    stop_s: float  # its end [s]
    run_s: float  # duration of all of the run, also of what is not looked at [s]
    # whether somebody asked for this part; then all metrics are of it alone. Else it is the
    # second half of the motion: from the first time at which the reference moves to that
    # from which on it rests for good
    asked: bool = False
    rests: bool = False  # whether the reference rests before or after the motion
    # root mean square joint errors of its halves [rad], where the second is much less: the
    # robot had not settled; None where it had
    falls: tuple[float, float] | None = None


class Metrics(NamedTuple):
    """All metrics of a run, of its motion: without what follows where that has come to rest."""

    duration_s: float  # duration of the motion [s]
    transient: Transient  # how fast the end effector reaches its reference
    steady: Errors  # tracking errors
    torque: Torque  # torques of the motors
    effort: Effort = Effort()  # what the motors are put to
    # TRUE: of the true motion; SEEN: of what sensors and nominal robot show
    source: Literal['true', 'seen'] = TRUE
    seen: Metrics | None = None  # those of what is seen; None where all that is seen is true
    # over which part errors, chattering and effort are taken
    window: Window = Window(math.nan, math.nan, math.nan)
    # units of the joints: what is said to be in rad and N m is in m and N of slides
    units: JointUnits = HINGES


Value = Callable[[Metrics], float | None]


def of_true(value: Value) -> Value:
    """A metric of the true motion: NaN where all that is known is what was seen."""
    return lambda m: math.nan if m.source == SEEN else value(m)


def of_seen(value: Value) -> Value:
    """A metric of what is seen: NaN where it is that of the true motion."""

    def seen(m: Metrics) -> float | None:
        if m.seen is None or (m.source == TRUE and value(m.seen) == value(m)):
            return math.nan
        return value(m.seen)

    return seen


def poses(log: RunLog, true: bool = False, left: LastPoses | None = None) -> Poses:
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

    Arguments as of :func:`poses`.

    Returns:
        The run, its poses, and why it was cut off; empty when it was not.

    Raises:
        KinematicsError: not even the first sample has a pose, or none has a reference of its time.
    """
    log = with_reference(log)
    if not len(log.time):
        raise KinematicsError('no state has a reference of its time')
    try:
        return log, poses(log, true, left), ''
    except KinematicsError as error:
        reason = str(error)
    good, bad = 0, len(log.time)
    while bad - good > 1:
        middle = (good + bad) // 2
        try:
            poses(head(log, middle), true, left)
            good = middle
        except KinematicsError:
            bad = middle
    part = head(log, max(good, 1))
    return part, poses(part, true, left), f'evaluated up to t = {part.time[-1]:.3f} s: {reason}'


def figures(
    motions: Motions,
    start: float | None = None,
    stop: float | None = None,
) -> Metrics:
    """Compute the metrics of a run: of its true motion, and of what is seen of it.

    Where the true motion is not known, all metrics are of what is seen. A motion that has come
    to rest is looked at up to there.

    Args:
        motions: The run.
        start: Time from which on it is looked at [s]; None: from its first sample on.
        stop: Time up to which it is looked at [s]; None: up to its last sample.

    Raises:
        InputError: there is none of the run between `start` and `stop`.
    """
    whole, asked = motions.best, start is not None or stop is not None
    end = None if asked else rest(whole)
    if asked or end is not None:
        first = -math.inf if start is None else start
        last = stop if end is None else end
        motions = _between(motions, first, math.inf if last is None else last)
    found = Metrics(*_figures(motions, asked))
    run = float(whole.time[-1] - whole.time[0])
    rests = found.window.rests or end is not None
    return found._replace(window=found.window._replace(run_s=run, asked=asked, rests=rests))


def _figures(motions: Motions, asked: bool) -> Metrics:
    seen = None if motions.seen is None else evaluate(motions.seen, all_of_it=asked)
    if motions.true is None:
        assert seen is not None
        return seen._replace(source=SEEN, seen=seen)
    found = evaluate(motions.true, motions.ideal, asked)
    return found._replace(seen=seen)


def _between(motions: Motions, first: float, last: float) -> Motions:
    """The part of a run between two times [s], both included."""
    end, time = np.nextafter(last, math.inf), motions.best.time
    part = motions.between(first, end)
    if not first < last or not len(part.best.time):
        raise InputError(nothing_between(first, last, time[0], time[-1]))
    if part.seen is not None and not len(part.seen.time):
        part = part._replace(seen=None)
    return part


def nothing_between(first: float, last: float, begin: float, end: float) -> str:
    """That a run from `begin` to `end` has no part between two times [s], in words."""
    return (
        f'the run is from {begin:g} to {end:g} s; there is no part of it from '
        f'{max(first, begin):g} to {min(last, end):g} s'
    )


def rest(motion: Motion) -> float | None:
    """Time from which on the reference of a run rests to the end [s]; None where it moves on."""
    return _moves(motion).rest


def _moves(motion: Motion) -> ReferenceMoves:
    """Where the reference of a motion moves."""
    moves = ReferenceMoves()
    moves.add(motion.time, motion.reference_position)
    return moves


def _falls(motion: Motion, part: slice) -> tuple[float, float] | None:
    """Errors of the halves of a part of a run [rad], where it had not settled; else None."""
    speeds = np.abs(np.diff(motion.reference_position, axis=0)).max(axis=1, initial=0.0)
    if speeds.size and speeds[-1] < SLOW * speeds.max():
        return None  # errors fall with the speed
    error = (motion.reference_position - motion.position)[part]
    before, after = (_rms(half) if len(half) else 0.0 for half in np.array_split(error, 2))
    return (before, after) if before > FALLS * after > 0.0 else None


def evaluate(motion: Motion, ideal: np.ndarray | None = None, all_of_it: bool = False) -> Metrics:
    """Compute the metrics of a run.

    Args:
        motion: The run.
        ideal: The ideal torque of each of its samples, see ideal_torque.py [N m], shape (N, n);
            None where it is not known.
        all_of_it: Whether the window is all of it, else the second half of its motion.
    """
    first = 0 if all_of_it else _moves(motion).first
    half = slice(0 if all_of_it else (first + len(motion.time)) // 2, None)
    times = motion.time[half]
    distance = distances(motion.poses)
    return Metrics(
        float(motion.time[-1] - motion.time[0]),
        Transient(_settled(motion.time, distance, 1e-3), _settled(motion.time, distance, 1e-4)),
        errors(
            distance[half],
            (motion.reference_position - motion.position)[half],
            rotation_errors(motion.poses)[half],
        ),
        torque(motion.time, motion.effort, half),
        effort(motion, half, ideal),
        window=Window(
            float(times[0]),
            float(times[-1]),
            float(motion.time[-1] - motion.time[0]),
            rests=first > 0,
            falls=None if all_of_it else _falls(motion, half),
        ),
        units=motion.poses.units,
    )


def distances(pose: Poses) -> np.ndarray:
    """Distance of the end effector from its reference [m], shape (N,); NaN without a place."""
    if not pose.place:
        return np.full(len(pose.actual), np.nan)
    return np.linalg.norm((pose.actual - pose.reference)[:, : pose.place], axis=1)


def rotation_errors(pose: Poses) -> np.ndarray:
    """Angle by which the end effector is turned from its reference, in [0, pi] [rad], shape (N,).

    In a plane the difference of phi, in space the angle of the rotation from one to the other; NaN
    where no rotation is a part of the pose.
    """
    if pose.place == len('xy') and pose.actual.shape[1] > pose.place:
        apart = pose.actual[:, pose.place] - pose.reference[:, pose.place]
        return np.abs(np.remainder(apart + math.pi, 2.0 * math.pi) - math.pi)
    return angles_between(pose.actual, pose.reference, pose.rotation_components)


def errors(distance: np.ndarray, error: np.ndarray, rotation: np.ndarray | None = None) -> Errors:
    """Compute the tracking errors over all samples given.

    Args:
        distance: Distance of the end effector from its reference [m], shape (N,).
        error: Error of the joints [rad], shape (N, n).
        rotation: See :func:`rotation_errors` [rad], shape (N,); None or NaN: none.
    """
    found = Errors(
        _rms(distance), float(distance.max()), _rms(error), _rms(synchronisation_error(error))
    )
    if rotation is None or np.isnan(rotation).any():
        return found
    return found._replace(rotation_rms_rad=_rms(rotation), rotation_max_rad=float(rotation.max()))


def torque(time: np.ndarray, effort: np.ndarray, part: slice = slice(None)) -> Torque:
    """Compute the metrics of the torque.

    Args:
        time: Time of the samples [s], shape (N,).
        effort: Torques [N m], shape (N, n).
        part: The samples over which chattering is measured.
    """
    duration = float(time[-1] - time[0])
    variation = float(np.abs(np.diff(effort, axis=0)).sum())
    return Torque(
        float(np.abs(effort).max()),
        variation / duration if duration else 0.0,
        _rms(rough(effort, smooth_over(time))[part]),
    )


def effort(motion: Motion, part: slice = slice(None), ideal: np.ndarray | None = None) -> Effort:
    """Compute the effort of a run over a part of its samples; arguments as of :func:`evaluate`."""
    moved = np.diff(motion.position, axis=0, prepend=motion.position[:1])
    excess = math.nan
    if ideal is not None:
        excess = excess_chattering(motion.time, motion.effort, ideal, part)
    work = float(np.abs(motion.effort * moved)[part].sum())
    return Effort(_rms(motion.effort[part]), work, excess)


def excess_chattering(
    time: np.ndarray, effort: np.ndarray, ideal: np.ndarray, part: slice = slice(None)
) -> float:
    """Root mean square of the chattering that does not help [N m].

    A torque that cancels a disturbance changes as quickly as the disturbance; that is no fault.
    Of what the torque differs from its moving mean, as much of that of the ideal torque is taken
    away for each joint as leaves least, from none of it to all of it:

        min_s rms(rough(torque) - s rough(ideal)),    0 <= s <= 1

    The chattering of the difference, s = 1, would call it effort when a law does nothing about a
    disturbance; a difference of two chatterings would let noise take the place of what a law does
    not cancel. With s, noise counts in full, a torque that does nothing not at all, and a torque
    that comes too late as far as it is out of phase.

    Args:
        time: Time of the samples [s], shape (N,).
        effort: Torques [N m], shape (N, n).
        ideal: Torques that hold the robot on its reference [N m], shape (N, n).
        part: The samples over which it is measured.
    """
    half = smooth_over(time)
    found, useful = rough(effort, half)[part], rough(ideal, half)[part]
    most = np.sum(useful**2, axis=0)
    alike = np.sum(found * useful, axis=0)
    share = np.clip(np.divide(alike, most, out=np.zeros_like(most), where=most > 0.0), 0.0, 1.0)
    return _rms(found - share * useful)


def _settled(time: np.ndarray, distance: np.ndarray, bound: float) -> float | None:
    """Time from which the distance stays below `bound` to the end, for BELOW or more [s].

    None if it does not, NaN of NaN.
    """
    if np.isnan(distance).any():
        return math.nan
    above = np.flatnonzero(distance >= bound)
    if not above.size:
        return 0.0
    first = above[-1] + 1
    stays = first < len(time) and time[-1] - time[first] >= BELOW - 1e-9
    return float(time[first] - time[0]) if stays else None


def smooth_over(time: np.ndarray) -> int:
    """Samples on each side of a moving mean over SMOOTH; `time` of samples [s], shape (N,)."""
    return samples_beside(float(np.median(np.diff(time)))) if len(time) > 1 else 1


def samples_beside(period: float) -> int:
    """The same by the period [s]; 0 where it is too long for a chattering."""
    return round(0.5 * SMOOTH / period)


def rough(torque: np.ndarray, half: int) -> np.ndarray:
    """Torques minus their moving mean over so many samples on each side, shape (N, n).

    NaN without a sample on each side: what changes between the samples is not known then.
    """
    if not half:
        return np.full_like(torque, math.nan)
    longer = np.pad(torque, ((half, half), (0, 0)), mode='edge')
    total = np.zeros_like(torque)
    for k in range(2 * half + 1):  # not by np.convolve, whose last bits are the processor's
        total += longer[k : k + len(torque)]
    return torque - total / (2 * half + 1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
