"""A reference motion in the joints of the robot."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    FunctionValue,
    inline_ir,
    kernel,
    read_row,
    vector,
    write_row,
)
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import REACHED, PoseMotion
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen import joint_path, shape_trial, waypoints
from trajectory_gen.shapes import SHAPES, Shape, prepared

# How a motion is entered from the one before it: one fades while the other begins.


class Poses(NamedTuple):
    """Poses with two derivatives, each shape (N, m)."""

    pose: Array
    rate: Array
    acceleration: Array


class Entry(NamedTuple):
    """How a motion is entered from the one before it."""

    before: Callable[[Array], Poses]  # poses of that one by times since the entry [s]
    duration: float  # time in which it fades [s]
    start: float  # time of the motion itself at the entry [s]
    delay: float  # how long it waits there [s]

    def motion_times(self, times: Any) -> Any:
        """Times of the motion itself at times since the entry [s]."""
        return self.start + np.maximum(times - self.delay, 0.0)


def blend(entry: Entry, times: Array, motion: Poses) -> Poses:
    """Poses w before + (1 - w) own, where w falls from 1 to 0: a quintic polynomial.

    Args:
        entry: The entry.
        times: Times since then [s], shape (N,).
        motion: Poses of the motion itself.
    """
    early = times < entry.duration
    if not early.any():
        return motion
    times = times[early]
    weight, slope, bend = fading((1.0, 0.0, 0.0), entry.duration, times)
    (x, v, a), before = (part[early] for part in motion), entry.before(times)
    dx, dv, da = before.pose - x, before.rate - v, before.acceleration - a
    blended = (
        x + weight * dx,
        v + weight * dv + slope * dx,
        a + weight * da + 2.0 * slope * dv + bend * dx,
    )
    made = Poses(*(part.copy() for part in motion))
    for part, rows in zip(made, blended, strict=True):
        part[early] = rows
    return made


def fading(state: tuple[Any, Any, Any], duration: float, times: Array) -> Poses:
    """The quintic polynomial that leads from a state to rest in zero.

    Args:
        state: Value and two derivatives, numbers or shape (m,).
        duration: When it ends [s].
        times: Times before that [s], shape (N,).
    """
    T, u = duration, times[:, np.newaxis] / duration
    a, b, c = state[0], T * state[1], 0.5 * T**2 * state[2]
    left = 1.0 - u
    return Poses(
        (1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)) * a
        + u * left**3 * (1.0 + 3.0 * u) * b
        + u**2 * left**3 * c,
        (
            -30.0 * u**2 * left**2 * a
            + left**2 * (1.0 + 2.0 * u - 15.0 * u**2) * b
            + u * left**2 * (2.0 - 5.0 * u) * c
        )
        / T,
        (
            -60.0 * u * left * (1.0 - 2.0 * u) * a
            - 12.0 * u * left * (3.0 - 5.0 * u) * b
            + 2.0 * left * (1.0 - 8.0 * u + 10.0 * u**2) * c
        )
        / T**2,
    )


LOOKS = (
    64  # times at which a motion is looked at, and as many after its span, for whether it rests
)
STILL = 1e-9  # of the largest rate; less is rest


class TrajectoryParameters(NamedTuple):
    """Which motion, how far ahead it is published, and how fast the joints may become."""

    shape: Annotated[str, Field('', f'the motion: {", ".join(SHAPES)}, or a custom one')]
    lookahead: Annotated[float, Field('s', 'how long before its stamp a sample is sent', 0.0, 0.5)]
    speed_factor: Annotated[
        float, Field('', 'how fast the motion runs; 2: twice as fast as its shape', 1e-6, 1e6)
    ]
    max_joint_speed: Annotated[float, Field('rad/s', 'largest joint speed allowed', 0.0)]
    transition: Annotated[
        float, Field('s', 'time in which a motion that runs is led into a changed one', 0.01, 1e3)
    ]


class Reference(NamedTuple):
    """Desired motion, one row per sample."""

    pose: Array  # pose, shape (N, m); then its two derivatives
    pose_rate: Array
    pose_acceleration: Array
    position: Array  # actuated joints [rad], shape (N, n); then their two derivatives
    velocity: Array
    acceleration: Array
    passive: Array  # other angles of the posture, see JointMotion, shape (N, p)
    # 0-based index of a part that does not reach, -1 if all do, shape (N,)
    out_of_reach: NDArray[np.int64]


def head(reference: Reference, count: int) -> Reference:
    """The first samples of a motion."""
    return Reference._make(each[:count] for each in reference)


class Trajectory:
    """A shape with its parameters on a robot."""

    def __init__(
        self,
        robot: RobotModel,
        parameters: TrajectoryParameters,
        limits: Any,
        shape: Shape,
        given: Any,
        near: tuple[float, ...] = (),
    ) -> None:
        """Prepare a motion.

        Args:
            robot: The robot.
            parameters: Which motion, and how it is published.
            limits: MotionLimits of the robot.
            shape: Its shape.
            given: Parameters of the shape.
            near: Pose near the first one, for a motion in the joints.

        Raises:
            InputError: the shape refuses its parameters, or has another number of coordinates
                than the pose of the robot; no pose fits the joints.
        """
        self.robot, self.parameters, self.limits = robot, parameters, limits
        name = parameters.shape
        if name not in SHAPES:
            shape_trial.check(name, shape, given)
        # what the shape computes the motion from: its parameters, or what it has prepared
        self.shape, self._length = prepared(name, shape, given)
        if near:
            self.shape = joint_path.in_pose(robot, self.shape, near)
        # what was left out of its file of points, if anything
        self.note: str = getattr(given, 'thinned', '')
        self._motion = FunctionValue(shape.motion, self.shape, 0.0)
        self._size = self.robot.pose_size
        # number of coordinates that the shape has; a robot in a plane may not have phi
        self.size = size = len(shape.motion(self.shape, 0.0).pose)
        in_plane = self.robot.planar and self._size < size == 3
        if size != self._size and not in_plane:
            names = ', '.join(
                axis.name for axis in self.robot.module.coordinates(self.robot.parameters)
            )
            raise InputError(
                f'trajectory.shape {name} has {size} coordinates; the pose of '
                f'{self.robot.name} has {self._size}: {names}',
                'trajectory.shape',
            )
        self._pose = vector(np.zeros(self._size))
        self.entry: Entry | None = None  # how the motion is entered from another one, if it is
        still = PoseMotion(self._pose, self._pose, self._pose)
        self._joints = self.robot.kernel('joint_motion', still)

    @property
    def span(self) -> float:
        """Time after which nothing new happens [s]."""
        joining = self.entry.duration if self.entry else 0.0
        return joining + self._length / self.parameters.speed_factor

    @property
    def end(self) -> float | None:
        """Time from which on the robot rests [s]; None for a motion that goes on, or is none."""
        times = self.span * np.linspace(0.0, 2.0, 2 * LOOKS + 1)
        rates = np.abs(self.poses(times).rate).max(axis=1)
        rests = rates[LOOKS:].max() <= STILL * rates.max() > 0.0
        return self.span if rests else None

    @property
    def first_pose(self) -> tuple[float, ...]:
        """The pose at which the motion begins, m numbers."""
        return tuple(self.sample(0.0).pose[0].tolist())

    def at_speed(self, factor: float) -> Trajectory:
        """The same motion at another ``trajectory.speed_factor``."""
        made = copy.copy(self)
        made.parameters = self.parameters._replace(speed_factor=factor)
        return made

    def along(self, spline: waypoints.Spline) -> Trajectory:
        """Another motion of the same robot, within the same limits, at its own speed."""
        made = copy.copy(self)
        made.shape, made._length = spline, waypoints.span(spline)
        made.size = spline.coefficients.shape[2]
        made.parameters = self.parameters._replace(shape='waypoints', speed_factor=1.0)
        made._motion = FunctionValue(waypoints.motion, spline, 0.0)
        made.entry = None
        return made

    def entered(self, entry: Entry | None) -> Trajectory:
        """The same motion, entered from another one, or begun by itself."""
        made = copy.copy(self)
        made.entry = entry
        return made

    def sample(self, times: Any, beyond: bool = True) -> Reference:
        """Evaluate the motion.

        Args:
            times: Times since the start of the motion, or its entry [s], a number or shape (N,).
            beyond: Whether samples after the first that is out of reach are looked at, too; else
                it is the last one. To look for a pose that is not there takes long.

        Returns:
            Pose and joints with two analytic derivatives each; NaN where the robot does not reach.
        """
        robot, poses = self.robot.constants, self.poses(times)
        found, count = _reference(self._joints, robot, self._pose, *poses, beyond)
        return found if beyond else head(found, count)

    def poses(self, times: Any) -> Poses:
        """Poses at times since the start [s], a number or shape (N,)."""
        grid = np.atleast_1d(np.asarray(times, dtype=np.float64))
        own = grid if self.entry is None else self.entry.motion_times(grid)
        speed = self.parameters.speed_factor
        poses = Poses(*_poses(self._motion, self.shape, self._pose, own, speed))
        return poses if self.entry is None else blend(self.entry, grid, poses)


def joints_at(robot: RobotModel, poses: Array) -> Reference:
    """The joints of a robot at rest at poses, shape (N, m)."""
    template = vector(np.zeros(robot.pose_size))
    joints = robot.kernel('joint_motion', PoseMotion(template, template, template))
    still = np.zeros_like(poses)
    found, _ = _reference(joints, robot.constants, template, poses, still, still, True)
    return found


@kernel
def _poses(
    motion: Any, shape: Any, template: Array, times: Array, speed: float
) -> tuple[Array, Array, Array]:
    """Poses at every time, as many coordinates as `template`; `speed` is that of the shape's time.

    A robot in a plane may not have phi.
    """
    pose = np.empty((len(times), len(template)))
    rate = np.empty((len(times), len(template)))
    acceleration = np.empty((len(times), len(template)))
    for k in range(len(times)):
        full = motion(shape, speed * times[k])
        write_row(pose, k, read_row(full.pose, 0, template))
        write_row(rate, k, speed * read_row(full.rate, 0, template))
        write_row(acceleration, k, speed**2 * read_row(full.acceleration, 0, template))
    return pose, rate, acceleration


@kernel
def _reference(
    joint_motion: Any,
    robot: Any,
    template: Array,
    pose: Array,
    pose_rate: Array,
    pose_acceleration: Array,
    beyond: bool,
) -> tuple[Reference, int]:
    """The joints at every pose, and how many were looked at; `template` is any pose."""
    joints = joint_motion(robot, _row(template, pose, pose_rate, pose_acceleration, 0))
    count, n, p = len(pose), len(joints.position), len(joints.passive)
    position = np.empty((count, n))
    velocity = np.empty((count, n))
    acceleration = np.empty((count, n))
    passive = np.empty((count, p))
    out_of_reach = np.empty(count, dtype=np.int64)
    for k in range(count):
        joints = joint_motion(robot, _row(template, pose, pose_rate, pose_acceleration, k))
        write_row(position, k, joints.position)
        write_row(velocity, k, joints.velocity)
        write_row(acceleration, k, joints.acceleration)
        write_row(passive, k, joints.passive)
        out_of_reach[k] = joints.out_of_reach
        if not beyond and joints.out_of_reach != REACHED:
            count = k + 1
            break
    reference = Reference(
        pose,
        pose_rate,
        pose_acceleration,
        position,
        velocity,
        acceleration,
        passive,
        out_of_reach,
    )
    return reference, count


@inline_ir
def _row(template: Array, pose: Array, rate: Array, acceleration: Array, k: int) -> PoseMotion:
    return PoseMotion(
        read_row(pose, k, template),
        read_row(rate, k, template),
        read_row(acceleration, k, template),
    )


# Motions one after another, as they are performed.

MAX_PARTS = 100  # motions; of older ones the first is sampled instead


class Part(NamedTuple):
    """A motion that is performed."""

    begin: int  # index of the sample at which it begins, which still belongs to the one before
    name: str  # its shape, or what else it is
    trajectory: Trajectory  # the motion, whose time counts from there


class MotionSequence:
    """Which motion the samples belong to. It does not change; `then` makes another one."""

    def __init__(self, trajectory: Trajectory, period: float) -> None:
        """Begin with a motion."""
        # the motions, in order; the first begins with the first sample
        self.parts: tuple[Part, ...] = (Part(0, trajectory.parameters.shape, trajectory),)
        self.period = period  # time between samples [s]

    def sample(self, indices: Any) -> Reference:
        """Evaluate the motions at increasing indices of samples, shape (N,)."""
        indices = np.atleast_1d(indices)
        begins = [part.begin for part in self.parts[1:]]
        which = np.searchsorted(begins, indices)  # a sample at a beginning is of the one before
        parts = []
        for k, part in enumerate(self.parts):
            own = indices[which == k]
            if own.size:
                parts.append(part.trajectory.sample((own - part.begin) * self.period))
        return (
            parts[0]
            if len(parts) == 1
            else Reference(*map(np.concatenate, zip(*parts, strict=True)))
        )

    def until(self, index: int) -> MotionSequence:
        """The motions that begin before a sample."""
        return self._with(tuple(part for part in self.parts[1:] if part.begin < index))

    def then(self, part: Part) -> MotionSequence:
        """This course until a motion begins, and that motion."""
        return self._with((*self.until(part.begin).parts[1:], part))

    def _with(self, later: tuple[Part, ...]) -> MotionSequence:
        """A course with the same first motion, and others after it."""
        first = self.parts[0]
        made = MotionSequence(first.trajectory, self.period)
        made.parts = (first, *later[-MAX_PARTS:])
        return made
