"""What viewers of ROS need beside a recorded run: description, frames and paths of the robot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis import recorded_motions
from parallel_robot.analysis.monitor import posture_of
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.messages.message_types import channel_of
from parallel_robot.bags.output import tracked
from parallel_robot.bags.run import recorded_robot
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot.bags.writing.recovery import copy
from parallel_robot_model.common.errors import BagError, KinematicsError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.topics import FRAME, FRAMES, MARKERS, ROBOT_DESCRIPTION
from parallel_robot_model.robots.link import frames as link_frames
from parallel_robot_sim.motions import LastPoses, differs

REFERENCE = 'reference'
PATHS = {REFERENCE: (0.6, 0.6, 0.6), 'end effector': (0.16, 0.32, 0.75)}
WIDTH = 0.001  # m, of a path
ALL = 10_000  # points of a path, more than a screen has dots


class Frames:
    """Adds description, frames and paths to the bag that is a copy of that of a run."""

    def __init__(
        self, windows: Callable[[], Iterator[RunLog]], count: int, seen: bool = False
    ) -> None:
        """Prepare.

        Args:
            windows: Returns the run in parts.
            count: How many states it has, about.
            seen: Whether its joints and its nominal robot may show another motion than the true
                one; then the path is named so.

        Raises:
            InputError: its robot says nothing of its links.
        """
        from rosbags.typesys import Stores, get_typestore  # slow to import

        self._windows, self._states, self._seen = windows, count, seen
        self._first = next(windows())
        self._posture = posture_of(self._first.config)
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self.count = 0

    def write(self, writer: BagWriter) -> None:
        """Append the messages; `count` says how many frames there are.

        Raises:
            OSError: the disk is full or gone.
        """
        for topic in (ROBOT_DESCRIPTION, MARKERS, FRAMES):
            writer.add(channel_of(topic))
        begin = int(self._first.heard[0])
        text = layouts.text_message(self._posture.description)
        writer.write(ROBOT_DESCRIPTION.name, begin, text)
        writer.write(MARKERS.name, begin, self._bytes(self._paths(int(self._first.stamps[0]))))
        for log_time, message in self._frames():
            writer.write(FRAMES.name, log_time, self._bytes(message))
            self.count += 1

    def _frames(self) -> Iterator[tuple[int, Any]]:
        """Frames of the links with their log times."""
        states = (
            state
            for log in self._windows()
            for state in zip(map(int, log.heard), map(int, log.stamps), log.position, strict=True)
        )
        for log_time, stamp, position in tracked(states, self._states, 'states'):
            angles = self._posture.add_state(stamp, position)
            if angles is not None:
                yield (
                    log_time,
                    self._message(FRAMES.type, transforms=self._transforms(stamp, angles)),
                )

    def _transforms(self, stamp: int, angles: np.ndarray) -> list[Any]:
        transforms = []
        links = self._posture.links
        places = (found.tolist() for found in link_frames(links, angles))
        for link, place, turn in zip(links, *places, strict=True):
            vector = dict(zip('xyz', place, strict=True))
            turned = dict(zip('xyzw', turn, strict=True))
            transform = self._message(
                'geometry_msgs/msg/Transform',
                translation=self._message('geometry_msgs/msg/Vector3', **vector),
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
        """The desired path and that of the end effector; none where poses are no places."""
        markers = []
        for (name, colour), points in zip(PATHS.items(), self._tracks(), strict=False):
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
                    self._message('geometry_msgs/msg/Point', x=x, y=y, z=z)
                    for x, y, z in points.tolist()
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

    def _tracks(self) -> list[np.ndarray]:
        """Points of both paths [m], each shape (N, 3), up to a state without a pose."""
        every, left, found = max(1, -(-self._states // ALL)), None, []
        for log in self._windows():
            if not log.referenced.any() and left is not None:
                continue
            try:
                _, poses, cut = recorded_motions.with_poses(log, left=left)
            except KinematicsError:
                if left is None:
                    raise
                break
            if not poses.place:
                return []
            done = left.samples if left else 0
            rows = slice(-done % every, None, every)
            tracks = np.stack([poses.reference, poses.actual])[:, rows, : poses.place]
            points = np.zeros((*tracks.shape[:2], 3))
            points[..., ['xyz'.index(axis) for axis in poses.axes[: poses.place]]] = tracks
            found.append([*points])
            left = LastPoses(poses.actual[-1], poses.reference[-1], done + len(poses.actual))
            if cut:
                break
        return [np.concatenate(parts) for parts in zip(*found, strict=True)]

    def _header(self, stamp: int, frame: str) -> Any:
        sec, nanosec = divmod(stamp, NANOSECONDS)
        time = self._message('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
        return self._message('std_msgs/msg/Header', stamp=time, frame_id=frame)

    def _message(self, kind: str, **fields: Any) -> Any:
        return self._store.types[kind](**fields)

    def _bytes(self, message: Any) -> bytes:
        return bytes(self._store.serialize_cdr(message, message.__msgtype__))


# A copy of a bag, with all that viewers such as Foxglove need to draw the robot.


class ViewerCopy(NamedTuple):
    """A copy that was written."""

    path: Path  # its directory
    frames: int  # number of frames of the robot
    seen: bool  # whether they are of the joints as they are seen, not of the true ones
    doubts: tuple[str, ...]  # defects of the bag, one line each

    def __str__(self) -> str:
        """What the command prints."""
        seen = ', seen' if self.seen else ''
        return f'bag     {self.path}, with {self.frames} frames of the robot{seen}\n'


def write_viewer_copy(
    bag: Path, windows: Callable[[], Iterator[Recording]], out: Path, memory: int = MEMORY
) -> ViewerCopy:
    """Write the copy of a bag.

    Args:
        bag: Directory of the bag, or its MCAP file.
        windows: Returns what it holds, in parts.
        out: Directory of the copy, which must not exist.
        memory: What may be held of the bag [bytes].

    Raises:
        BagError: its robot is not known, or the copy cannot be written.
        WholeNeededError: the bag cannot be read in windows.
    """
    told, count = AlikeLines(), 0
    for log, past, _ in windows():
        told.take(bag, log)
        count += len(log.stamps)
        config, history = log.config, past
    unknown = recorded_robot.unknown(config)
    if unknown:
        raise BagError(f'{bag}: {unknown}')
    seen = not recorded_motions.of_plant(history) or differs(config)
    frames = Frames(lambda: (found.log for found in windows()), count, seen)
    copy(bag, out, memory, frames.write)
    return ViewerCopy(out, frames.count, seen, told.lines)
