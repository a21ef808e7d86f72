"""What is known of the running robots, from what their nodes say."""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from collections.abc import Mapping
from typing import NamedTuple

from parallel_robot_analysis.report.printable import printable

NODES = ('trajectory', 'plant', 'controller', 'recorder', 'player', 'monitor')  # order on a screen
SILENT = 3.0  # s, after which a node, which reports once a second, does not seem to run
GONE = 10.0  # s, after which it is no longer shown
UNPAIRED = 400  # poses that wait for their counterpart
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
        self._poses: OrderedDict[int, tuple[float, float]] = OrderedDict()
        self._references: OrderedDict[int, tuple[float, float]] = OrderedDict()
        self._squares: list[float] = []  # m^2, since the last look

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
        self._pair(stamp, (x, y), self._poses, self._references)

    def pose_reference(self, stamp: int, x: float, y: float) -> None:
        """Take where the platform should be at a stamp [ns]; in m."""
        self._pair(stamp, (x, y), self._references, self._poses)

    def look(self, now: float) -> None:
        """Sum up the poses since the last look and forget nodes that are gone; time in s."""
        self.nodes = {name: one for name, one in self.nodes.items() if now - one.time < GONE}
        if 'controller' not in self.nodes:
            self.law = self.fault = self.limits = ''
        self.error = None
        if self._squares:
            mean = sum(self._squares) / len(self._squares)
            self.error = PlatformError(math.sqrt(mean), math.sqrt(max(self._squares)))
        self.history.append(self.error.rms if self.error else math.nan)
        self._squares.clear()

    def _pair(
        self,
        stamp: int,
        point: tuple[float, float],
        own: OrderedDict[int, tuple[float, float]],
        others: OrderedDict[int, tuple[float, float]],
    ) -> None:
        """Compare a point with that of the same stamp, now or when it comes."""
        other = others.pop(stamp, None)
        if other is not None:
            square = (point[0] - other[0]) ** 2 + (point[1] - other[1]) ** 2
            if math.isfinite(square):
                self._squares.append(square)
            return
        own[stamp] = point
        if len(own) > UNPAIRED:
            own.popitem(last=False)


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
