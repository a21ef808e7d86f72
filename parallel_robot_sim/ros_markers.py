"""The robot as markers for RViz and its relatives: links, platform, path."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_model.robots.tree import COLOURS, OTHER, WIDTH

PATH = ColorRGBA(r=0.85, g=0.20, b=0.25, a=1.0)


class RobotMarkers:
    """Builds the markers; remembers the path."""

    def __init__(self, robot: RobotModel) -> None:
        """Prepare for one robot, whose pose must be a place."""
        self._robot, self._place = robot, robot.place
        self._path: deque[Point] = deque(maxlen=500)  # 10 s at 50 Hz

    def build(self, stamp: int, pose: np.ndarray, position: np.ndarray) -> MarkerArray:
        """Markers of a posture.

        Args:
            stamp: Stamp of the markers [ns].
            pose: Pose, shape (m,).
            position: Actuated joints [rad], shape (n,).
        """
        segments = self._robot.module.segments(self._robot.parameters, pose, position)
        self._path.append(_point(pose[: self._place]))
        time = Time(sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)
        markers = [
            _marker(
                time, part, Marker.LINE_LIST, WIDTH, map(_point, ends.reshape(-1, self._place))
            )
            for part, ends in segments.items()
        ]
        markers.append(_marker(time, 'path', Marker.LINE_STRIP, 0.3 * WIDTH, self._path))
        markers[-1].color = PATH
        return MarkerArray(markers=markers)


def _marker(time: Time, part: str, kind: int, width: float, points: Iterable[Point]) -> Marker:
    r, g, b = COLOURS.get(part, OTHER)
    color = ColorRGBA(r=r, g=g, b=b, a=1.0)
    marker = Marker(ns=part, type=kind, color=color, points=list(points))
    marker.header.frame_id = FRAME
    marker.header.stamp = time
    marker.scale.x = width
    marker.pose.orientation.w = 1.0
    return marker


def _point(place: np.ndarray) -> Point:
    return Point(**dict(zip('xyz', map(float, place), strict=False)))
