"""What viewers of ROS need beside a recorded run: description, frames and paths of the robot."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from parallel_robot.analysis import metrics
from parallel_robot.analysis.posture import posture_of
from parallel_robot.bags.bag_writer import BagWriter
from parallel_robot.bags.channels import channel_of
from parallel_robot.bags.progress import tracked
from parallel_robot.bags.run_log import RunLog
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.topics import FRAME, FRAMES, MARKERS, ROBOT_DESCRIPTION

REFERENCE = 'reference'
PATHS = {REFERENCE: (0.6, 0.6, 0.6), 'end effector': (0.16, 0.32, 0.75)}
WIDTH = 0.001  # m, of a path
ALL = 10_000  # points of a path, more than a screen has dots


class Frames:
    """Adds description, frames and paths to the bag that is a copy of that of a run."""

    def __init__(self, log: RunLog, seen: bool = False) -> None:
        """Prepare.

        Args:
            log: The run.
            seen: Whether its joints and its nominal robot may show another motion than the true
                one; then the path is named so.

        Raises:
            InputError: its robot says nothing of its links.
        """
        from rosbags.typesys import Stores, get_typestore  # slow to import

        self._log, self._seen = log, seen
        self._posture = posture_of(log.config)
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self.count = 0

    def write(self, writer: BagWriter) -> None:
        """Append the messages; `count` says how many frames there are.

        Raises:
            OSError: the disk is full or gone.
        """
        for topic in (ROBOT_DESCRIPTION, MARKERS, FRAMES):
            writer.add(channel_of(topic))
        begin = int(self._log.heard[0])
        text = layouts.text_message(self._posture.description)
        writer.write(ROBOT_DESCRIPTION.name, begin, text)
        writer.write(MARKERS.name, begin, self._bytes(self._paths(int(self._log.stamps[0]))))
        for log_time, message in self._frames():
            writer.write(FRAMES.name, log_time, self._bytes(message))
            self.count += 1

    def _frames(self) -> Iterator[tuple[int, Any]]:
        """Frames of the links with their log times."""
        log = self._log
        states = zip(map(int, log.heard), map(int, log.stamps), log.position, strict=True)
        for log_time, stamp, position in tracked(states, len(log.stamps), 'states'):
            angles = self._posture.add_state(stamp, position)
            if angles is not None:
                yield (
                    log_time,
                    self._message(FRAMES.type, transforms=self._transforms(stamp, angles)),
                )

    def _transforms(self, stamp: int, angles: np.ndarray) -> list[Any]:
        transforms = []
        for link, half in zip(self._posture.links, angles / 2.0, strict=True):
            x, y = link.origin
            turned = {'x': 0.0, 'y': 0.0, 'z': float(np.sin(half)), 'w': float(np.cos(half))}
            transform = self._message(
                'geometry_msgs/msg/Transform',
                translation=self._message('geometry_msgs/msg/Vector3', x=x, y=y, z=0.0),
                rotation=self._message('geometry_msgs/msg/Quaternion', **turned),
            )
            transforms.append(
                self._message(
                    'geometry_msgs/msg/TransformStamped',
                    header=self._header(stamp, link.parent),
                    child_frame_id=link.name,
                    transform=transform,
                )
            )
        return transforms

    def _paths(self, stamp: int) -> Any:
        """The desired path and that of the end effector; empty for one that is not planar."""
        _, poses, _ = metrics.with_poses(self._log)
        paths = (poses.reference, poses.actual) if poses.planar else ()
        markers = []
        for (name, colour), path in zip(PATHS.items(), paths, strict=False):
            points = path[:: -(-len(path) // ALL), :2].tolist()
            r, g, b = colour
            marker = self._message(
                'visualization_msgs/msg/Marker',
                header=self._header(stamp, FRAME),
                ns=f'{name}, seen' if self._seen and name != REFERENCE else name,
                id=0,
                type=4,  # LINE_STRIP
                action=0,
                pose=self._message(
                    'geometry_msgs/msg/Pose',
                    position=self._message('geometry_msgs/msg/Point', x=0.0, y=0.0, z=0.0),
                    orientation=self._message(
                        'geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0
                    ),
                ),
                scale=self._message('geometry_msgs/msg/Vector3', x=WIDTH, y=0.0, z=0.0),
                color=self._message('std_msgs/msg/ColorRGBA', r=r, g=g, b=b, a=1.0),
                lifetime=self._message('builtin_interfaces/msg/Duration', sec=0, nanosec=0),
                frame_locked=False,
                points=[
                    self._message('geometry_msgs/msg/Point', x=x, y=y, z=0.0) for x, y in points
                ],
                colors=[],
                texture_resource='',
                texture=self._message(
                    'sensor_msgs/msg/CompressedImage',
                    header=self._header(0, ''),
                    format='',
                    data=np.zeros(0, np.uint8),
                ),
                uv_coordinates=[],
                text='',
                mesh_resource='',
                mesh_file=self._message(
                    'visualization_msgs/msg/MeshFile', filename='', data=np.zeros(0, np.uint8)
                ),
                mesh_use_embedded_materials=False,
            )
            markers.append(marker)
        return self._message(MARKERS.type, markers=markers)

    def _header(self, stamp: int, frame: str) -> Any:
        sec, nanosec = divmod(stamp, NANOSECONDS)
        time = self._message('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
        return self._message('std_msgs/msg/Header', stamp=time, frame_id=frame)

    def _message(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _bytes(self, message: Any) -> bytes:
        return bytes(self._store.serialize_cdr(message, message.__msgtype__))
