"""What is known of the running robots, from what their nodes say."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from parallel_robot_base.printable import printable

NODES = ('trajectory', 'plant', 'controller', 'recorder', 'player', 'monitor')  # order on a screen
SILENT = 3.0  # s, after which a node, which reports once a second, does not seem to run
GONE = 10.0  # s, after which it is no longer shown
UNPAIRED = 400  # poses that wait for references, and references that are known
GAP = 10**8  # ns, between two references, across which nothing is known of the path
HISTORY = 120  # looks at the platform error that are remembered
LONGEST = 2000  # characters of a figure: the names of all laws, say
OK, WARNING, ERROR = 0, 1, 2  # levels of diagnostic_msgs/DiagnosticStatus


class Report(NamedTuple):
    """The newest diagnostics of a node.

    Attributes:
        time: When they were heard [s].
        level: 0 ok, 1 warning, 2 error.
        text: The message.
        figures: Key to value.
    """

    time: float
    level: int
    text: str
    figures: dict[str, str]


class PlatformError(NamedTuple):
    """Distance between platform and reference between two looks [m]."""

    rms: float
    largest: float


class Point(NamedTuple):
    """A place of the platform [m] at a stamp [ns]."""

    stamp: int
    x: float
    y: float


class Robot:
    """One robot: the nodes of one namespace.

    Attributes:
        nodes: Name of each node, without namespace, to its newest report.
        law: The active law; empty while it is not known.
        fault: Text of the fault, 'none', or empty.
        limits: The limits that acted, 'none', or empty.
        error: Platform error between the last two looks; None when there were no poses.
        history: Root mean squares of earlier looks [m], the newest last; NaN without poses.
    """

    def __init__(self) -> None:
        """Know nothing."""
        self.nodes: dict[str, Report] = {}
        self.law = self.fault = self.limits = ''
        self.error: PlatformError | None = None
        self.history: deque[float] = deque(maxlen=HISTORY)
        self._poses: deque[Point] = deque(maxlen=UNPAIRED)
        self._references: deque[Point] = deque(maxlen=UNPAIRED)

    @property
    def laws(self) -> list[str]:
        """The laws that the controller has."""
        laws = self.figure('controller', 'laws')
        return laws.split(', ') if laws else []

    def figure(self, node: str, *keys: str) -> str:
        """Value of the first of some keys that a node reports; empty when it reports none."""
        figures = self.nodes[node].figures if node in self.nodes else {}
        return next((figures[key] for key in keys if key in figures), '')

    def report(self, node: str, report: Report) -> None:
        """Take the diagnostics of a node."""
        self.nodes[node] = report
        if node == 'controller':
            fault = report.text.removeprefix('fault: ') if report.level == ERROR else 'none'
            self.status({**report.figures, 'fault': fault})

    def status(self, values: Mapping[str, str]) -> None:
        """Take what the controller says of itself."""
        self.law, self.fault, self.limits = (
            printable(values.get(key, '')) for key in ('law', 'fault', 'limits that acted')
        )

    def pose(self, stamp: int, x: float, y: float) -> None:
        """Take where the platform was at a stamp [ns]; in m."""
        _append(self._poses, Point(stamp, x, y))

    def pose_reference(self, stamp: int, x: float, y: float) -> None:
        """Take where the platform should be at a stamp [ns]; in m."""
        _append(self._references, Point(stamp, x, y))

    def look(self, now: float) -> None:
        """Sum up the poses since the last look and forget nodes that are gone; time in s."""
        self.nodes = {name: one for name, one in self.nodes.items() if now - one.time < GONE}
        if 'controller' not in self.nodes:
            self.law = self.fault = self.limits = ''
        errors = self._errors()
        self.error = None
        if errors.size:
            self.error = PlatformError(math.sqrt((errors**2).mean()), float(errors.max()))
        self.history.append(self.error.rms if self.error else math.nan)

    def _errors(self) -> np.ndarray:
        """Distance of each pose from the reference at its stamp [m], shape (N,), and forget it.

        References are on a grid of their own when the nodes were started by hand: between two of
        them the reference is interpolated, which costs less than a nanometre.
        """
        if not self._references:
            return np.zeros(0)
        start, end = self._references[0].stamp, self._references[-1].stamp
        poses = [self._poses.popleft() for pose in [*self._poses] if pose.stamp <= end]
        known, asked = (
            np.array([(p.stamp - start, p.x, p.y) for p in points], float).reshape(-1, 3).T
            for points in (self._references, poses)
        )
        newest = np.searchsorted(known[0], asked[0], side='right') - 1
        later = np.minimum(newest + 1, len(known[0]) - 1)
        used = (newest >= 0) & (known[0][later] - known[0][newest] <= GAP)
        path = (np.interp(asked[0], known[0], row) for row in known[1:])
        x, y = (row - desired for row, desired in zip(asked[1:], path, strict=True))
        errors = np.hypot(x, y)
        return errors[used & np.isfinite(errors)]


def _append(points: deque[Point], point: Point) -> None:
    """Append a point; one of an earlier stamp begins anew."""
    if points and point.stamp <= points[-1].stamp:
        points.clear()
    points.append(point)


class Robots:
    """All robots of a ROS domain."""

    def __init__(self) -> None:
        """Know none."""
        self._robots: dict[str, Robot] = {}

    def __getitem__(self, namespace: str) -> Robot:
        """The robot of a namespace, e.g. ``/left``; empty for none."""
        return self._robots.setdefault(namespace, Robot())

    def names(self) -> list[str]:
        """Namespaces in which nodes run."""
        return sorted(name for name, robot in self._robots.items() if robot.nodes)

    def report(
        self, now: float, status: str, node: str, level: int, text: str, figures: Mapping[str, str]
    ) -> None:
        """Take one status of ``/diagnostics``; those of other suites are left out.

        Args:
            now: Time [s].
            status: Its name.
            node: Full name of the node, its hardware_id.
            level: 0 ok, 1 warning, 2 error.
            text: Its message.
            figures: Its keys and values.
        """
        namespace, slash, name = node.rpartition('/')
        if slash and status == f'{name}: loop':
            values = {printable(key): printable(value, LONGEST) for key, value in figures.items()}
            report = Report(now, level, printable(text), values)
            self[printable(namespace)].report(printable(name), report)

    def look(self, now: float) -> None:
        """Sum up all robots; time in s."""
        for robot in self._robots.values():
            robot.look(now)
        self._robots = {name: robot for name, robot in self._robots.items() if robot.nodes}
