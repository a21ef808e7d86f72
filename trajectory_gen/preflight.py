"""The check of a whole motion before its first message."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.errors import InputError, MotionError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import first_sample
from trajectory_gen import joint_path, waypoints
from trajectory_gen.configuration import MotionConfiguration
from trajectory_gen.messages import Points
from trajectory_gen.trajectory import (
    LOOKS,
    Entry,
    MotionSequence,
    Part,
    Poses,
    Reference,
    Trajectory,
    fading,
)

MOST_SAMPLES = 100_000  # samples of a motion that are checked
ROUNDING = 1e-9  # of a mean speed, relative
AT_ONCE = 5000  # of them; between two such parts, other threads take their turn


def grid(trajectory: Trajectory, period: float) -> np.ndarray:
    """Times of the samples of a motion that are checked [s], shape (N,)."""
    count = min(np.ceil(trajectory.span / period), MOST_SAMPLES)
    return np.linspace(0.0, max(trajectory.span, count * period), int(count) + 1)


def check(trajectory: Trajectory, period: float, samples: Reference | None = None) -> None:
    """Refuse a motion that the robot cannot perform.

    Every sample (of a very long motion, MOST_SAMPLES of them) is checked for joint speed and
    for what the robot itself forbids, e.g. singularities; only the first failure is reported.

    Args:
        trajectory: The motion.
        period: Time between samples [s].
        samples: Its first samples, one per period, which then are not computed again.

    Raises:
        MotionError: it names the time, the part that fails and the allowed value.
    """
    times = grid(trajectory, period)
    for first in range(0, len(times), AT_ONCE):
        part = times[first : first + AT_ONCE + 1]  # the last is the next first
        reference = samples and _rows(samples, first, part, period)
        _check(trajectory, part, reference or trajectory.sample(part))


def _rows(samples: Reference, first: int, times: np.ndarray, period: float) -> Reference | None:
    """The rows from `first` on, if they are there and of exactly these times."""
    stop = first + len(times)
    if len(samples.pose) < stop or not np.array_equal(times, np.arange(first, stop) * period):
        return None
    return Reference._make(each[first:stop] for each in samples)


def _check(trajectory: Trajectory, times: np.ndarray, reference: Reference) -> None:
    robot, fastest = trajectory.robot, trajectory.parameters.max_joint_speed
    failures = robot.module.infeasible(robot.parameters, trajectory.limits, reference)
    unreached = np.flatnonzero(reference.out_of_reach >= 0)
    reached = slice(unreached[0] if unreached.size else None)
    speeds = np.abs(reference.velocity[reached])
    # What happens between two samples shows in their distance.
    steps = np.diff(reference.position[reached], axis=0) / np.diff(times[reached])[:, None]
    speeds[1:] = np.maximum(speeds[1:], (1.0 - ROUNDING) * np.abs(steps))
    text = 'joint speed {} rad/s is above trajectory.max_joint_speed, {} rad/s'
    too_fast = first_sample(speeds > fastest, speeds, text, fastest)
    if too_fast is not None:
        units = (
            robot.joint_units if too_fast.part is None else robot.joint_units.one(too_fast.part)
        )
        failures = [*failures, too_fast._replace(reason=units.of(too_fast.reason))]
    if failures:
        first = min(failures, key=lambda failure: failure.sample)
        where = robot.module.PARTS[first.part is None]
        raise MotionError(first.reason, float(times[first.sample]), where, first.part)


# Doubts about a motion whose numbers look like those of other units, or are not all used.

TURN = 2.0 * math.pi  # rad, an angle beyond which may be in degrees
LONG = 1000.0  # s, a time that may be in another unit
FAR = 50.0  # m, a distance that may be in mm
USUAL = 100.0  # s, the longest time that is usual
UNITS = {'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9}  # s


def motion_warnings(trajectory: Trajectory) -> tuple[str, ...]:
    """What a motion looks like that was given in other units, one line each; often nothing."""
    robot, name = trajectory.robot, trajectory.parameters.shape
    axes = robot.module.coordinates(robot.parameters)
    warnings = [trajectory.note] if trajectory.note else []
    poses = trajectory.poses(np.linspace(0.0, trajectory.span, LOOKS + 1)).pose
    for axis, values in zip(axes, poses.T, strict=True):
        most = float(values[np.argmax(np.abs(values))])
        if axis.unit == 'rad' and abs(most) > TURN:
            warnings.append(
                f'{name}: {axis.name} reaches {most:.4g} rad, {most / TURN:.3g} turns: '
                f'if that is in degrees, it must be {math.radians(most):.4g} rad'
            )
        elif axis.unit == 'm' and abs(most) > FAR:
            warnings.append(
                f'{name}: {axis.name} reaches {most:.4g} m: '
                f'if that is in mm, it must be {1e-3 * most:.4g} m'
            )
    if name != 'waypoints':
        return tuple(warnings)
    length = trajectory.span * trajectory.parameters.speed_factor
    if length > LONG:
        unit = next((unit for unit, size in UNITS.items() if length * size <= USUAL), 'ns')
        warnings.append(
            f'waypoints.times last {length:.4g} s: if they are in {unit}, they must be divided '
            f'to last {length * UNITS[unit]:.4g} s'
        )
    if trajectory.size > len(axes):
        names = ', '.join(axis.name for axis in axes)
        warnings.append(
            f'waypoints.points have phi, which is not used: the pose of {robot.name} is {names}'
        )
    return tuple(warnings)


# How a motion changes while it is performed: planned, checked, and continuous, or refused.

POINTS = 'points of a message'  # name of such a motion


def transition_to(
    sequence: MotionSequence, index: int, motions: MotionConfiguration
) -> MotionSequence:
    """A course until a sample, then led into another motion.

    Both go on during ``trajectory.transition``, in which one fades into the other. A motion of
    the same shape is entered at the same share of its way. One of another shape is performed from
    its beginning, and so is any after one that has come to rest; if it begins at rest, it waits
    there until the transition is over. Where it holds the pose in which the robot is, that is the
    one of the sample.

    Raises:
        MotionError: the robot cannot perform it.
    """
    before = sequence.until(index)
    trajectory = motions.at_pose(tuple(before.sample(index).pose[0].tolist())).trajectory
    last, duration = before.parts[-1], trajectory.parameters.transition
    time = (index - last.begin) * sequence.period
    entry, bare = last.trajectory.entry, last.trajectory.entered(None)
    own_time = float(entry.motion_times(time)) if entry else time
    rests = _rests(last.trajectory.poses(time))
    start = 0.0
    if last.name == trajectory.parameters.shape and bare.span and not rests:
        start = own_time / bare.span * trajectory.span
    delay = duration if start == 0.0 and _rests(trajectory.poses(0.0)) else 0.0
    # A transition that is not over yet goes on as a polynomial from where it is.
    pairs = zip(last.trajectory.poses(time), bare.poses(own_time), strict=True)
    left = [here[0] - there[0] for here, there in pairs]

    def faded(times: Array) -> Poses:
        poses = bare.poses(own_time + times)
        if not np.any(left):
            return poses
        rest = fading((left[0], left[1], left[2]), duration, times)
        return Poses(*(a + b for a, b in zip(poses, rest, strict=True)))

    entered = trajectory.entered(Entry(faded, duration, start, delay))
    return _checked(sequence, Part(index, trajectory.parameters.shape, entered))


def through(sequence: MotionSequence, index: int, points: Points) -> MotionSequence:
    """A course until a sample, then a motion through points, at last at rest.

    It is the motion of least mean square jerk through the points, or a quintic polynomial
    from each to the next where they have derivatives. Pose, rate and acceleration are
    continuous.

    Raises:
        InputError: the points are too uneven for that.
        MotionError: the robot cannot perform it.
    """
    before = sequence.until(index)
    spline = _spline(before.sample(index), points)
    return _checked(sequence, Part(index, POINTS, before.parts[-1].trajectory.along(spline)))


def _checked(sequence: MotionSequence, part: Part) -> MotionSequence:
    check(part.trajectory, sequence.period)
    return sequence.then(part)


def _rests(state: Poses) -> bool:
    return not (state.rate.any() or state.acceleration.any())


def _spline(state: Reference, points: Points) -> waypoints.Spline:
    """The motion from a state through points."""
    times = np.concatenate([[0.0], points.times])
    pose = np.concatenate([state.pose, points.pose])
    if points.rate is None or points.acceleration is None:
        from trajectory_gen import spline  # it loads scipy, which takes long

        start = state.pose_rate[0], state.pose_acceleration[0]
        made = spline.fit(times, pose, periodic=False, smoothing=0.0, start=start)
        offset = np.abs(made(times) - pose).max()
        if not offset <= waypoints.RESIDUAL * np.abs(pose).max():
            raise InputError('the times of the points are too uneven; leave some out')
        coefficients = spline.polynomials(made, times)
    else:
        rate = np.concatenate([state.pose_rate, points.rate])
        acceleration = np.concatenate([state.pose_acceleration, points.acceleration])
        motions = np.stack([pose, rate, acceleration], axis=1)
        coefficients = joint_path.hermite(np.diff(times), motions)
    return waypoints.Spline(times, np.ascontiguousarray(coefficients), False)
