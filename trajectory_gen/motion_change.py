"""How a motion changes while it is performed: planned, checked, and continuous, or refused."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from trajectory_gen import joint_path, preflight, waypoints
from trajectory_gen.configuration import Motions
from trajectory_gen.motion_message import Points
from trajectory_gen.trajectory import Course, Entry, Part, Poses, Reference, fading

POINTS = 'points of a message'  # name of such a motion


def led_into(course: Course, index: int, motions: Motions) -> Course:
    """A course until a sample, then led into another motion.

    Both go on during ``trajectory.transition``, in which one fades into the other. A motion of
    the same shape is entered at the same share of its way. One of another shape is performed from
    its beginning, and so is any after one that has come to rest; if it begins at rest, it waits
    there until the transition is over. Where it holds the pose in which the robot is, that is the
    one of the sample.

    Raises:
        MotionError: the robot cannot perform it.
    """
    before = course.until(index)
    trajectory = motions.from_pose(tuple(before.sample(index).pose[0].tolist()))
    last, duration = before.parts[-1], trajectory.parameters.transition
    time = (index - last.begin) * course.period
    entry, bare = last.trajectory.entry, last.trajectory.entered(None)
    own_time = float(entry.own_times(time)) if entry else time
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
    return _checked(course, Part(index, trajectory.parameters.shape, entered))


def through(course: Course, index: int, points: Points) -> Course:
    """A course until a sample, then a motion through points, at last at rest.

    It is the motion of least mean square jerk through the points, or a quintic polynomial
    from each to the next where they have derivatives. Pose, rate and acceleration are
    continuous.

    Raises:
        InputError: the points are too uneven for that.
        MotionError: the robot cannot perform it.
    """
    before = course.until(index)
    spline = _spline(before.sample(index), points)
    return _checked(course, Part(index, POINTS, before.parts[-1].trajectory.along(spline)))


def _checked(course: Course, part: Part) -> Course:
    preflight.check(part.trajectory, course.period)
    return course.then(part)


def _rests(state: Poses) -> bool:
    return not (state.rate.any() or state.acceleration.any())


def _spline(state: Reference, points: Points) -> waypoints.Spline:
    """The motion from a state through points.

    Raises:
        InputError: the points are too uneven.
    """
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
