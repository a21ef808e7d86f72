"""The robot as markers for RViz and its relatives: links, platform, path."""

from __future__ import annotations

from collections import deque

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from parallel_robot_base.topics import FRAME
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_model.planar_3rrr.kinematics import inverse_kinematics
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_model.planar_3rrr.skeleton import skeleton

PROXIMAL = ColorRGBA(r=0.16, g=0.32, b=0.75, a=1.0)
DISTAL = ColorRGBA(r=0.40, g=0.62, b=0.90, a=1.0)
PLATFORM = ColorRGBA(r=0.95, g=0.60, b=0.15, a=1.0)
PATH = ColorRGBA(r=0.85, g=0.20, b=0.25, a=1.0)
WIDTH = 0.012  # m, of the links


class RobotMarkers:
    """Builds the markers; remembers the path."""

    def __init__(self, robot: RobotParameters) -> None:
        """Prepare for one robot."""
        self._robot = robot
        self._path: deque[Point] = deque(maxlen=500)  # 10 s at 50 Hz

    def build(self, stamp: int, pose: np.ndarray) -> MarkerArray:
        """Markers at a pose, shape (3,); `stamp` in nanoseconds."""
        robot = self._robot
        theta = inverse_kinematics(robot, pose).theta
        base, elbow, joint = skeleton(robot, pose, theta)
        self._path.append(_point(pose))
        lists = [
            ('proximal', Marker.LINE_LIST, PROXIMAL, WIDTH, _pairs(base, elbow)),
            ('distal', Marker.LINE_LIST, DISTAL, WIDTH, _pairs(elbow, joint)),
            (
                'platform',
                Marker.LINE_STRIP,
                PLATFORM,
                WIDTH,
                [*map(_point, joint), _point(joint[0])],
            ),
            ('path', Marker.LINE_STRIP, PATH, 0.3 * WIDTH, list(self._path)),
        ]
        time = Time(sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)
        markers = []
        for namespace, kind, color, width, points in lists:
            marker = Marker(ns=namespace, type=kind, color=color, points=points)
            marker.header.frame_id = FRAME
            marker.header.stamp = time
            marker.scale.x = width
            marker.pose.orientation.w = 1.0
            markers.append(marker)
        return MarkerArray(markers=markers)


def _point(xy: np.ndarray) -> Point:
    return Point(x=float(xy[0]), y=float(xy[1]))


def _pairs(start: np.ndarray, end: np.ndarray) -> list[Point]:
    return [_point(xy) for pair in zip(start, end, strict=True) for xy in pair]
