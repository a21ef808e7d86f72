"""Node that simulates the robot: effort commands in, joint states out.

The robot is held at its initial pose by its brake until the common `start_stamp`, or else until
the first command. State k is published; the torque computed from it acts from k to k + 1. A robot
that is driven out of its workspace is held and silent until ``~/reset``.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.nodes.background import OUTSIDE, STATE_INDEX
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_model.processes import realtime
from parallel_robot_model.robots.registry import RobotModel, resolve
from parallel_robot_model.robots.tree import COLOURS, OTHER, WIDTH
from parallel_robot_sim.configuration import configure_plant, declared
from parallel_robot_sim.mujoco_simulator import simulator_of
from parallel_robot_sim.plant_run import ENDLESS, REPEAT, PlantRun
from trajectory_gen.messages import pose_fields

# The robot as markers for RViz and its relatives: links, platform, path.

PATH = ColorRGBA(r=0.85, g=0.20, b=0.25, a=1.0)


class RobotMarkers:
    """Builds the markers; remembers the path."""

    def __init__(self, robot: RobotModel) -> None:
        """Prepare for one robot, whose pose must be a place."""
        self._robot, self._axes = robot, robot.axes
        self._path: deque[Point] = deque(maxlen=500)  # 10 s at 50 Hz

    def build(self, stamp: int, pose: np.ndarray, position: np.ndarray) -> MarkerArray:
        """Markers of a posture.

        Args:
            stamp: Stamp of the markers [ns].
            pose: Pose, shape (m,).
            position: Actuated joints [rad], shape (n,).
        """
        segments = self._robot.module.segments(self._robot.parameters, pose, position)
        self._path.append(self._point(pose))
        time = Time(sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)
        markers = [
            _marker(
                time,
                part,
                Marker.LINE_LIST,
                WIDTH,
                map(self._point, ends.reshape(-1, len(self._axes))),
            )
            for part, ends in segments.items()
        ]
        markers.append(_marker(time, 'path', Marker.LINE_STRIP, 0.3 * WIDTH, self._path))
        markers[-1].color = PATH
        return MarkerArray(markers=markers)

    def _point(self, place: np.ndarray) -> Point:
        return Point(**dict(zip(self._axes, map(float, place), strict=False)))


def _marker(time: Time, part: str, kind: int, width: float, points: Iterable[Point]) -> Marker:
    r, g, b = COLOURS.get(part, OTHER)
    color = ColorRGBA(r=r, g=g, b=b, a=1.0)
    marker = Marker(ns=part, type=kind, color=color, points=list(points))
    marker.header.frame_id = FRAME
    marker.header.stamp = time
    marker.scale.x = width
    marker.pose.orientation.w = 1.0
    return marker


STALLED = NANOSECONDS // 50  # ns, lateness of a state above which it is not sent
FORGOTTEN = 10 * NANOSECONDS  # ns; more is no delay: the clock was set


class PlantNode(SuiteNode):
    """Publishes ``joint_states`` every period, or in lockstep after every command."""

    priority = realtime.LOOP
    makes_states = True

    def __init__(self) -> None:
        """Put the robot at its initial pose and start to publish."""
        super().__init__('plant', resolve)
        configuration = configure_plant(self.values)
        robot = configuration.robot
        self.declare_groups(*declared(robot.module), units=robot.joint_units)
        simulator = simulator_of(configuration)
        simulator.warm()
        # the course of the motion
        self.run = PlantRun(
            lambda: simulator_of(configuration), self.loop, self._on_time_out, self._on_driven_out
        )
        self._torque = np.zeros(len(self.loop.joints))  # torque of the command being read
        self._published = 0  # number of states
        self._published_at = 0  # ns, monotonic
        self._advanced_at = 0  # ns, monotonic; the same, but for states that are repeated
        self._stood_still = False  # whether that was said
        self._round_trips: list[int] = []  # ns
        self._delays: list[int] = []  # ns, from the stamp to the publication (wall time)
        self._states = self.publisher(topics.JOINT_STATES)
        self._poses = self.publisher(topics.POSE, essential=False)
        self._pose_message = layouts.pose_stamped(topics.FRAME).draft()
        self._markers = self.publisher(topics.MARKERS, essential=False)
        self._marker_builder = RobotMarkers(simulator.robot)
        self.subscribe(topics.COMMANDS, self.take_command, complete=False)
        self.create_service(Trigger, '~/reset', self._answer_reset)
        if self.lockstep:
            self._time = self.publisher(topics.CLOCK, essential=False)
            self._time_message = layouts.clock().draft()
            self.create_timer(0.5 * REPEAT / NANOSECONDS, self._poll)
            for name, answer in (
                ('pause', self._answer_pause),
                ('resume', self._answer_resume),
                ('step', self._answer_step),
            ):
                self.create_service(Trigger, f'~/{name}', answer)
        else:
            self.start_timer(self.tick)

    def is_settable(self, key: str) -> bool:
        """Whether a parameter can change while the node runs: the samples of ``~/step``."""
        return super().is_settable(key) or key == 'plant.steps'

    def prepare_change(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Accept a new number of steps; everything else is fixed or is the common start."""
        if set(changes) != {'plant.steps'}:
            return super().prepare_change(changes)
        steps = changes['plant.steps']
        if type(steps) is not int or steps < 1:
            raise InputError(f'plant.steps must be a whole number from 1 on, not {steps!r}')
        self.values = {**self.values, **changes}
        return changes, lambda: None

    def set_start(self, stamp: int) -> None:
        """Release the brake at the state with `stamp` [ns]."""
        if self.run.start(stamp):
            self._publish()

    def alarm(self) -> str:
        """How the robot left its workspace, or why the motion stands still (lockstep)."""
        outside = self.run.outside
        return f'{outside}; ~/reset puts it back' if outside else self._standstill()

    def diagnose(self) -> dict[str, Any]:
        """Delays of the publications and round trips of the last second, and the state."""
        values: dict[str, Any] = {}
        for name, times in (('delay', self._delays), ('round trip', self._round_trips)):
            if times:
                p50, p99, largest = 1e-6 * np.percentile(times, [50, 99, 100])
                values[f'{name} p50/p99/max [ms]'] = f'{p50:.3f}/{p99:.3f}/{largest:.3f}'
                times.clear()
        if not self.lockstep:
            values['states without a command in time'] = self.run.skipped
        index = self.run.index
        values['state'] = 'held' if index is None else index
        if index is not None:
            values[STATE_INDEX] = index
        values[OUTSIDE] = bool(self.run.outside)
        return values

    def handled(self) -> int:
        """Number of states published."""
        return self._published

    def tick(self, stamp: int) -> None:
        """Publish the state of a stamp [ns] (wall time)."""
        if not self.run.tick(stamp):
            return
        delay = time.time_ns() - stamp
        if STALLED < delay < FORGOTTEN:  # nobody would take a torque from it in time
            self.counts['states that were not sent: the plant stood still'] += 1
            return
        self._publish()
        self._delays.append(delay)

    def take_command(self, data: bytes) -> None:
        """Take a serialised command; in lockstep, publish the state that it leads to."""
        if not (self.run.simulator.read(data, self._torque) or self._read(data)):
            return
        if not self.run.commanded:
            self._round_trips.append(time.monotonic_ns() - self._published_at)
        if self.run.take_command(self._torque):
            self._publish()

    def _read(self, data: bytes) -> bool:
        """Read a command of another layout; False, and counted, if it is not valid."""
        torque = layouts.read_numbers(data)
        if torque.shape != self._torque.shape or not np.isfinite(torque).all():
            self.counts['commands that are not three finite torques'] += 1
            return False
        self._torque[:] = torque
        return True

    def _poll(self) -> None:
        """Start once there is a controller, and repeat a state without an answer (lockstep)."""
        before, unanswered = self.run.index, time.monotonic_ns() - self._published_at
        if self.run.poll(not self.missing(), unanswered):
            self._publish(repeat=before is not None)
        standstill = self._standstill()
        if standstill and not self._stood_still:
            self.get_logger().warning(standstill)
        self._stood_still = bool(standstill)

    def _standstill(self) -> str:
        """Why the motion does not go on (lockstep); empty if it does."""
        seconds = 1e-9 * (time.monotonic_ns() - self._advanced_at)
        if not (self.lockstep and self.run.is_stalled(seconds)):
            return ''
        why = self.missing() or ', '.join(self.ambiguous()) or 'the controller may say why'
        return (
            f'no command for {seconds:.1f} s after state {self.run.index}: {why}; '
            '~/reset begins the motion again'
        )

    def _publish(self, repeat: bool = False) -> None:
        """Publish the present state of the run, perhaps once more, up to one that is answered."""
        self._publish_state(repeat)
        while self.run.step_unanswered():
            self._publish_state()

    def _publish_state(self, repeat: bool = False) -> None:
        stamp = self.run.stamp
        if self.lockstep:
            self._time.publish(self._time_message.encode(stamp))
        self._published_at = time.monotonic_ns()
        self._advanced_at = self._advanced_at if repeat else self._published_at
        if self.run.simulator.reception.published:
            self._states.publish(self.run.message)
            self._published += 1
        index = stamp // self.period_ns
        if index % topics.SLOW == 0 and self._shows_pose():
            joints = self.run.simulator.measurement()
            pose = joints.pose
            fields = pose_fields(self.run.simulator.robot, pose[np.newaxis])
            self._poses.publish(self._pose_message.encode(stamp, **fields))
            if index % topics.MARKERS_EVERY == 0 and self._markers.get_subscription_count():
                self._markers.publish(self._marker_builder.build(stamp, pose, joints.position))

    def _shows_pose(self) -> bool:
        """Whether a pose is to be published, where that is due."""
        return self.run.simulator.robot.place > 0 and bool(self.run.simulator.reception.shown)

    def _on_time_out(self) -> None:
        self.counts['command time-outs'] += 1
        self.get_logger().warning('no commands: the motors take their safe action')

    def _on_driven_out(self) -> None:
        self.get_logger().error(self.alarm())

    def _answer_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.run.reset()
        if not response.success:
            response.message = 'the common start is still awaited'
        elif self.lockstep:
            response.message = 'the motion begins again within a second'
        else:
            response.message = 'held at the initial pose until the next command'
        return response

    def _answer_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.run.pause()
        return self._answered(response)

    def _answer_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._resume(response)

    def _answer_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._resume(response, int(self.values['plant.steps']))

    def _resume(self, response: Trigger.Response, steps: int = ENDLESS) -> Trigger.Response:
        if self.run.resume(steps):
            self._publish()
        return self._answered(response)

    def _answered(self, response: Trigger.Response) -> Trigger.Response:
        response.success = not self.run.outside
        response.message = self.alarm() or self.run.describe()
        return response


def main() -> int:
    """Run the node."""
    return run_node(PlantNode)


if __name__ == '__main__':
    sys.exit(main())
