"""What is known of the running robots from the reports of their nodes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.units import OF_JOINTS
from parallel_robot_model.messages.layouts import Reader

# Joints as a message tells them, of whatever publisher.

LONGEST_MESSAGE = 1 << 16  # bytes of a message that is looked at


class JointAngle(NamedTuple):
    """Name, angle [rad] and rate [rad/s] of a joint; NaN for what is not told."""

    name: str
    angle: float
    rate: float


def read_joints(data: bytes) -> tuple[JointAngle, ...]:
    """Joints of a serialised sensor_msgs/JointState, in its order; none if it is broken."""
    if len(data) > LONGEST_MESSAGE:
        return ()
    try:
        message = Reader(data)
        message.header()
        names, angles, rates = message.texts(), message.numbers(), message.numbers()
    except ValueError:
        return ()
    told = [
        values.tolist() if len(values) == len(names) else [math.nan] * len(names)
        for values in (angles, rates)
    ]
    return tuple(map(JointAngle, names, *told))


NODES = ('trajectory', 'plant', 'controller', 'recorder', 'player', 'monitor')  # order on a screen
SILENT = 3.0  # s without a report, of one a second, after which a node seems to have stopped
GONE = 10.0  # s without a report, after which it is no longer shown
UNPAIRED = 400  # largest number of poses without a reference, and of references
GAP = 10**8  # ns between two references, beyond which the path is not interpolated
HISTORY = 120  # values of the end-effector error that are kept
LONGEST = 2000  # characters of a value, e.g. the names of all laws
OK, WARNING, ERROR = 0, 1, 2  # levels of diagnostic_msgs/DiagnosticStatus


class Report(NamedTuple):
    """The newest diagnostics of a node."""

    time: float  # when they were heard [s]
    level: int  # 0 ok, 1 warning, 2 error
    text: str  # the message
    values: dict[str, str]  # key to value


class EffectorError(NamedTuple):
    """Distance of the end effector from its reference between two looks [m]."""

    rms: float
    largest: float


class Point(NamedTuple):
    """A position of the end effector [m] at a stamp [ns]."""

    stamp: int
    x: float
    y: float
    z: float = 0.0


class Robot:
    """One robot: the nodes of one namespace."""

    def __init__(self) -> None:
        # name of each node, without namespace, to its newest report
        self.nodes: dict[str, Report] = {}
        # law: the active law; empty while it is not known; fault: text of the fault,
        # 'none', or empty; limits: the limits that acted, 'none', or empty
        self.law = self.fault = self.limits = ''
        self.placed = False  # whether poses were ever heard: only robots with a place publish them
        # error of the end effector between the last two looks; None when there were no poses
        self.error: EffectorError | None = None
        # root mean squares of earlier looks [m], the newest last; NaN without poses
        self.history: deque[float] = deque(maxlen=HISTORY)
        self._joints: tuple[JointAngle, ...] = ()
        self._joints_heard = -math.inf  # s
        self._poses: deque[Point] = deque(maxlen=UNPAIRED)
        self._references: deque[Point] = deque(maxlen=UNPAIRED)

    @property
    def laws(self) -> list[str]:
        """The laws that the controller has."""
        laws = self.value('controller', 'laws')
        return laws.split(', ') if laws else []

    @property
    def unit(self) -> str:
        """Unit of the joints; rad as long as the controller tells no other."""
        return self.value('controller', OF_JOINTS) or 'rad'

    def joints(self, now: float) -> list[JointAngle]:
        """The newest joints at a time [s]: those of the controller, or all without one."""
        if now - self._joints_heard >= SILENT:
            return []
        known = {joint.name: joint for joint in self._joints}
        own = [
            known[name] for name in self.value('controller', 'joints').split(', ') if name in known
        ]
        return own or [*self._joints]

    def value(self, node: str, *keys: str) -> str:
        """Value of the first of some keys that a node reports; empty when it reports none."""
        values = self.nodes[node].values if node in self.nodes else {}
        return next((values[key] for key in keys if key in values), '')

    def report(self, node: str, report: Report) -> None:
        """Take the diagnostics of a node."""
        self.nodes[node] = report
        if node == 'controller':
            fault = report.text.removeprefix('fault: ') if report.level == ERROR else 'none'
            self.status({**report.values, 'fault': fault})

    def status(self, values: Mapping[str, str]) -> None:
        """Take the status of the controller."""
        self.law, self.fault, self.limits = (
            printable(values.get(key, '')) for key in ('law', 'fault', 'limits that acted')
        )

    def pose(self, stamp: int, *place: float) -> None:
        """Take the position of the end effector [m] at a stamp [ns]."""
        self.placed = True
        _append(self._poses, Point(stamp, *place))

    def pose_reference(self, stamp: int, *place: float) -> None:
        """Take the desired position of the end effector [m] at a stamp [ns]."""
        _append(self._references, Point(stamp, *place))

    def take_joints(self, now: float, joints: tuple[JointAngle, ...]) -> None:
        """Take the joints that a message tells; time in s."""
        self._joints = tuple(joint._replace(name=printable(joint.name)) for joint in joints)
        self._joints_heard = now

    def look(self, now: float) -> None:
        """Evaluate the poses since the last look and forget nodes that are gone; time in s."""
        self.nodes = {name: one for name, one in self.nodes.items() if now - one.time < GONE}
        if 'controller' not in self.nodes:
            self.law = self.fault = self.limits = ''
        errors = self._errors()
        self.error = None
        if errors.size:
            self.error = EffectorError(math.sqrt((errors**2).mean()), float(errors.max()))
        self.history.append(self.error.rms if self.error else math.nan)

    def _errors(self) -> np.ndarray:
        """Remove all poses up to the last reference; their distances from it [m], shape (N,).

        When the nodes were started by hand, references have stamps of their own: the reference is
        interpolated between two of them, with an error below a nanometre.
        """
        if not self._references:
            return np.zeros(0)
        start, end = self._references[0].stamp, self._references[-1].stamp
        poses = [self._poses.popleft() for pose in [*self._poses] if pose.stamp <= end]
        known, asked = (
            np.array([(p[0] - start, *p[1:]) for p in points], float).reshape(-1, 4).T
            for points in (self._references, poses)
        )
        newest = np.searchsorted(known[0], asked[0], side='right') - 1
        later = np.minimum(newest + 1, len(known[0]) - 1)
        used = (newest >= 0) & (known[0][later] - known[0][newest] <= GAP)
        path = (np.interp(asked[0], known[0], row) for row in known[1:])
        apart = [row - desired for row, desired in zip(asked[1:], path, strict=True)]
        errors = np.linalg.norm(apart, axis=0)
        return errors[used & np.isfinite(errors)]


def _append(points: deque[Point], point: Point) -> None:
    """Append a point; one with an earlier stamp replaces all others."""
    if points and point.stamp <= points[-1].stamp:
        points.clear()
    points.append(point)


class Robots:
    """All robots of a ROS domain."""

    def __init__(self) -> None:
        self._robots: dict[str, Robot] = {}

    def __getitem__(self, namespace: str) -> Robot:
        """The robot of a namespace, e.g. ``/left``; empty for none."""
        return self._robots.setdefault(namespace, Robot())

    def names(self) -> list[str]:
        """Namespaces in which nodes run."""
        return sorted(name for name, robot in self._robots.items() if robot.nodes)

    def report(
        self, now: float, status: str, node: str, level: int, text: str, values: Mapping[str, str]
    ) -> None:
        """Take one status of ``/diagnostics``; others than those of the suite are ignored.

        Args:
            now: Time [s].
            status: Name of the status.
            node: Full name of the node, its hardware_id.
            level: 0 ok, 1 warning, 2 error.
            text: Its message.
            values: Its keys and values.
        """
        namespace, slash, name = node.rpartition('/')
        if slash and status == f'{name}: loop':
            shown = {printable(key): printable(value, LONGEST) for key, value in values.items()}
            report = Report(now, level, printable(text), shown)
            self[printable(namespace)].report(printable(name), report)

    def look(self, now: float) -> None:
        """Evaluate all robots; time in s."""
        for robot in self._robots.values():
            robot.look(now)
        self._robots = {name: robot for name, robot in self._robots.items() if robot.nodes}


Tell = Callable[[bool, str], None]  # whether it was done, and the answer of the node
