"""Node that publishes the desired motion.

Before the start it publishes the first sample of the motion, at rest. The motion starts at the
common `start_stamp`, or else with the first command of a controller or a call of ``~/start``.
Without a common start, `hold` without a pose waits for the joint states, and holds the pose in
which the robot is then.
A change of its parameters leads it into another motion, a message on ``~/motion`` through points.
"""

from __future__ import annotations

import math
import sys
import threading
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from parallel_robot_model.common.errors import (
    InputError,
    KinematicsError,
    MotionError,
    ParallelRobotError,
)
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.configuration.fields import ESTIMATOR, ZeroAngles, given_zero_angles
from parallel_robot_model.configuration.loop import OLDEST, WAIT
from parallel_robot_model.configuration.yaml_file import MOTION
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.nodes import parameters
from parallel_robot_model.nodes.joint_reader import JointReader
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.parameters import START
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_model.processes import realtime
from parallel_robot_model.robots.poses import poses_of
from trajectory_gen import messages, preflight
from trajectory_gen.configuration import changed, declared, motions_of, resolve, settings
from trajectory_gen.messages import pose_messages, reference_messages
from trajectory_gen.preflight import motion_warnings
from trajectory_gen.trajectory import MotionSequence, Reference, Trajectory

# The pose in which the robot is, from its joint states.


class PoseFinder:
    """Finds the pose of a robot from a joint state."""

    def __init__(self, near: Trajectory, joints: tuple[str, ...], zero_angle: Array) -> None:
        """Prepare to read joint states; the machine code is loaded here.

        Args:
            near: A motion that begins at a pose of the same assembly mode.
            joints: Names of the joints, in order.
            zero_angle: What is taken off measured positions [rad], shape (n,).

        Raises:
            InputError: the robot does not reach that pose.
        """
        guess = near.sample(0.0)
        self._robot, self._guess = near.robot, guess.pose[0]
        self._zero_angle = zero_angle
        self._unusable: Counter[str] = Counter()
        self._reader = JointReader(topics.JOINT_STATES, joints, ('position',), self._unusable)
        self.problem = f'no {topics.JOINT_STATES.name} yet'  # why it is not known, for people
        try:
            poses_of(self._robot, guess.position, self._guess)
        except KinematicsError:
            pose = self._guess.tolist()
            raise InputError(f'the robot does not reach {pose}, the guess of its pose') from None

    def read(self, data: bytes) -> tuple[float, ...] | None:
        """The pose at a serialised joint state, m numbers; None if it cannot be used."""
        self._unusable.clear()
        state = self._reader.read(data)
        if state is None:
            self.problem = ', '.join(self._unusable)
            return None
        _, (position,) = state
        try:
            joints = (position - self._zero_angle)[np.newaxis]
            (pose,) = poses_of(self._robot, joints, self._guess)
        except KinematicsError as error:
            self.problem = str(error)
            return None
        return tuple(pose.tolist())


BATCH = 200  # samples computed at once
SOON = 0.1  # s, until a new motion begins; doubled where the computer takes longer
LATEST = 10.0  # s, after which it is given up
SHAPE = 'trajectory.shape'
GUESS = 'controller.guess'
REMINDER = 5 * NANOSECONDS  # from one word that it still waits to the next
WAITS = 'waits for the pose in which the robot is'


class TrajectoryNode(SuiteNode):
    """Publishes ``reference`` on the grid of the period and ``pose_reference`` more slowly."""

    priority = realtime.LOOP
    _settable: frozenset[str] = frozenset()

    def __init__(self) -> None:
        """Check the whole motion, then start to publish."""
        super().__init__('trajectory', resolve)
        self._motions = motions_of(self.values)
        self._pose_finder = self._make_pose_finder()
        trajectory, robot = self._motions.trajectory, self._motions.robot.module
        self._settable = frozenset(key for key, _ in settings(self._motions))
        shapes = self._motions.shapes
        groups = declared(robot, shapes)
        self.declare_groups(
            ('robot', robot.Parameters),
            (ESTIMATOR, ZeroAngles),
            *groups,
            units=trajectory.robot.joint_units,
            motions=shapes,
        )
        if self.loop.start_stamp != WAIT:  # else who starts it says so
            for doubt in motion_warnings(trajectory):
                self.get_logger().warning(doubt)
        if self._pose_finder is None:
            preflight.check(trajectory, self.loop.period)
        self._motions.load_kernels()
        self._start = max(0, self.loop.start_stamp)  # ns; 0 while it is not known
        self._sequence = MotionSequence(trajectory, self.loop.period)
        self._requested_motion: bytes | None = None  # a message that waits to be looked at
        self._lock = threading.Lock()  # held while samples are published, or change
        self._batch: tuple[int, MotionSequence, np.ndarray, np.ndarray | None] | None = None
        self._start_requested = False
        self._state_stamp = 0  # ns, stamp of the last state (lockstep)
        self._late = 0  # ns, age of the states, as the first one tells it (lockstep)
        self._sent = -1  # index of the last sample of the motion that was published
        self._published = 0  # number of references
        self._reference = self.publisher(topics.REFERENCE)
        self._pose = self.publisher(topics.POSE_REFERENCE, essential=False)
        self.create_service(Trigger, '~/start', self._answer_start)
        self.create_subscription(JointTrajectory, '~/motion', self._on_motion, 1, raw=True)
        if self.lockstep:
            self.subscribe(topics.JOINT_STATES, self._on_state)
            return
        if self.loop.start_stamp == 0:
            self.subscribe(topics.COMMANDS, self._on_command)
        self._rest = _at_rest(trajectory)
        if self._pose_finder is not None:
            self.subscribe(topics.JOINT_STATES, self._on_joints, complete=False)
        ahead = round(trajectory.parameters.lookahead * NANOSECONDS)
        self.start_timer(self._tick, ahead)

    def is_settable(self, key: str) -> bool:
        """Whether a parameter can change while the node runs: the motion, and all shapes."""
        return super().is_settable(key) or key in self._settable

    def prepare_change(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Check a change of the motion, and let the changed one follow what has been sent.

        It is taken over here, while it can still be refused: what has been sent soon reaches it.
        """
        if START in changes or not all(map(self.is_settable, changes)):
            return super().prepare_change(changes)
        made = changed(self._motions, {**self.values, **changes})
        trajectory, text = made.trajectory, ''
        shape, performed = trajectory.parameters.shape, self._sequence.parts[-1].name
        if made.inputs != self._motions.inputs or (SHAPE in changes and shape != performed):
            stamp = self._schedule(partial(preflight.transition_to, motions=made))
            text = f'{shape} from stamp {stamp} on, in {trajectory.parameters.transition:g} s'
        stored = {key: value for key, value in settings(made) if key in changes}

        def apply() -> None:
            self._motions, self.values = made, {**self.values, **stored}
            if text:
                self._announce(text)

        return stored, apply

    def missing(self) -> str:
        """What the node still waits for; empty when it is ready."""
        return self.alarm() or super().missing()

    def alarm(self) -> str:
        """Why there is no reference yet; empty when there is one."""
        return f'{WAITS}: {self._pose_finder.problem}' if self._pose_finder else ''

    def set_start(self, stamp: int) -> None:
        """Start the motion with its first sample at `stamp` [ns]."""
        self._start = stamp

    def handled(self) -> int:
        """Number of references published."""
        return self._published

    def _tick(self, stamp: int) -> None:
        """Publish the sample of one stamp (wall time)."""
        waits = self.alarm()
        if waits:
            if stamp % REMINDER < self.period_ns:
                self.get_logger().warning(waits)
            return
        if not self._start and self._start_requested:
            self._start = stamp
        if self._start and stamp >= self._start:
            self._publish((stamp - self._start) // self.period_ns)
        elif self.loop.start_stamp == 0:
            rest = reference_messages(self.loop.joints, stamp, self._rest)
            self._reference.publish(rest.tobytes())
            self._published += 1

    def _make_pose_finder(self) -> PoseFinder | None:
        """What finds the pose in which the robot is; None where it is known, or not needed."""
        own, robot = self._motions.motion, self._motions.robot
        held = own.shape == 'hold' and not self._motions.parameters_of('hold').pose
        if self.lockstep or self.loop.start_stamp or not held:
            return None
        guess = self.values[GUESS]
        if guess:
            self._motions = self._motions.at_pose(robot.pose_of(GUESS, guess))
        return PoseFinder(
            self._motions.trajectory, self.loop.joints, given_zero_angles(self.values)
        )

    def _on_joints(self, data: bytes) -> None:
        """Hold the pose of the first joint state that tells one."""
        finder = self._pose_finder
        pose = finder.read(data) if finder else None
        if finder is None or pose is None:
            return
        trajectory = self._motions.at_pose(pose).trajectory
        try:
            preflight.check(trajectory, self.loop.period)
        except MotionError as error:
            finder.problem = str(error)
            return
        axes = self._motions.robot.module.coordinates(self._motions.robot.parameters)
        numbers = zip(axes, pose, strict=True)
        text = ', '.join(f'{axis.name} = {number:.6g} {axis.unit}' for axis, number in numbers)
        self.get_logger().info(f'holds the pose in which the robot is: {text}')
        self._motions = self._motions.at_pose(pose)
        self._sequence, self._rest = (
            MotionSequence(trajectory, self.loop.period),
            _at_rest(trajectory),
        )
        self._pose_finder = None  # at last: samples are published from here on

    def _on_command(self, _: bytes) -> None:
        self._start_requested = True

    def _answer_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = not self._start and self.loop.start_stamp != WAIT
        response.message = 'started' if response.success else 'has started or waits for its stamp'
        self._start_requested = self._start_requested or response.success
        return response

    def _on_state(self, data: bytes) -> None:
        """Keep the reference ahead of the plant (lockstep)."""
        stamp = layouts.header_stamp(data)
        if stamp is None or (self.loop.start_stamp == WAIT and not self._start):
            return
        start = self._start or self.loop.step_start
        if not self._state_stamp or stamp <= self._state_stamp:
            self._late = start - stamp if 0 < start - stamp <= OLDEST else 0
        k = (stamp + self._late - start) // self.period_ns
        if k < 0 or (self.last_index is not None and k > self.last_index):
            self.counts['joint states that are not of this motion'] += 1
            return
        repeats = stamp <= self._state_stamp and not (
            self.loop.hazards and k
        )  # stamps may be ahead
        if not self._start or repeats:
            self._sent = k - 1  # a new run, or the plant repeats a state: references are missing
        self._start, self._state_stamp = start, stamp
        if self._sent < k + BATCH // 2:
            first = self._sent + 1 if self.loop.hazards else max(self._sent + 1, k)
            for index in range(first, k + BATCH + 1):  # states may have been lost
                self._publish(index)

    def _on_motion(self, data: bytes) -> None:
        """Take a message with a new motion; of several that wait, the newest counts."""
        waits, self._requested_motion = self._requested_motion is not None, data
        if not waits:
            self.background.do(self._change_motion)

    def _change_motion(self) -> None:
        """Go on with the motion of the message that waits, or say why not."""
        data, self._requested_motion = self._requested_motion, None
        try:
            self._start_motion(data or b'')
        except ParallelRobotError as error:
            self.counts['new motions refused'] += 1
            text = f'new motion refused: {error}'
            self.get_logger().warning(text, throttle_duration_sec=0.1)

    def _start_motion(self, data: bytes) -> None:
        """Let the motion of a message follow the samples that have been sent."""
        robot = self._motions.robot
        names = [axis.name for axis in robot.module.coordinates(robot.parameters)]
        points = messages.read(data, names)
        stamp = self._schedule(partial(preflight.through, points=points))
        self._announce(
            f'{len(points.times)} points from stamp {stamp} on, in {points.times[-1]:g} s'
        )

    def _schedule(self, plan: Callable[[MotionSequence, int], MotionSequence]) -> int:
        """Let a new motion follow the samples that have been sent.

        Returns:
            Stamp of that sample [ns].
        """
        soon = 0.0 if self.lockstep else SOON
        while soon <= LATEST:
            begin = self._sent + math.ceil(soon / self.loop.period)
            if self._sent < 0 or (self.last_index is not None and begin >= self.last_index):
                raise InputError('the motion has not begun, or has come to its end')
            sequence = plan(self._sequence, begin)
            with self._lock:
                if self._sent <= begin:
                    self._sequence = sequence
                    return self._start + begin * self.period_ns
            soon *= 2.0
        raise InputError(f'its check takes longer than {LATEST:g} s')

    def _announce(self, text: str) -> None:
        """Announce the new motion, for people and for bags."""
        self.get_logger().info(f'new motion: {text}')
        parameters.declare_text(self, MOTION, text, 'motion that was asked for while it ran')

    def _publish(self, k: int) -> None:
        """Publish sample `k` of the motion; nothing after its end."""
        with self._lock:
            self._publish_next(k)

    def _publish_next(self, k: int) -> None:
        last = self.last_index
        if k <= self._sent or (last is not None and k > last):
            return
        first = k // BATCH * BATCH
        if self._batch is None or self._batch[:2] != (first, self._sequence):
            indices = np.arange(first, first + BATCH)
            stamps = self._start + indices * self.period_ns
            samples = self._sequence.sample(indices)
            references = reference_messages(self.loop.joints, stamps, samples)
            robot = self._motions.robot
            poses = pose_messages(robot, stamps, samples.pose) if robot.place else None
            self._batch = (first, self._sequence, references, poses)
        _, _, references, poses = self._batch
        self._reference.publish(references[k - first].tobytes())
        self._published += 1
        if poses is not None and k % topics.SLOW == 0:
            self._pose.publish(poses[k - first].tobytes())
        self._sent = k


def _at_rest(trajectory: Trajectory) -> Reference:
    """The first sample of a motion, without derivatives."""
    first = trajectory.sample(0.0)
    still = np.zeros_like(first.velocity)
    return first._replace(velocity=still, acceleration=still)


def main() -> int:
    """Run the node."""
    return run_node(TrajectoryNode)


if __name__ == '__main__':
    sys.exit(main())
