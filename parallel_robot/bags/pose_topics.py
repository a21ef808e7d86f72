"""Poses that something else than the suite measured, as a tracker or a camera, in a bag."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags import bag_reader
from parallel_robot.bags.bag_reader import Messages
from parallel_robot.bags.limits import MEMORY
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import Topic

TEXTS = {  # type to the number of its texts before the pose
    'geometry_msgs/msg/PoseStamped': 1,
    'geometry_msgs/msg/PoseWithCovarianceStamped': 1,
    'geometry_msgs/msg/TransformStamped': 2,
}
OURS = (topics.POSE.name, topics.POSE_REFERENCE.name)  # computed, not measured
FARTHEST = 1e6  # m, of a pose
HEAD = 4  # bytes of the encapsulation
FEW = 5  # topics that a message names
SHOWN = 60  # characters of a name


class StampedPoses(NamedTuple):
    """Poses in space.

    Attributes:
        stamps: Of their headers [ns], shape (N,).
        place: x, y, z [m], shape (N, 3).
        turned: Quaternions x, y, z, w of any length but zero, shape (N, 4).
        missing: Number of messages whose numbers are none, as where a tracker saw nothing.
    """

    stamps: np.ndarray
    place: Array
    turned: Array
    missing: int

    @property
    def phi(self) -> Array:
        """Angles about z [rad], shape (N,)."""
        x, y, z, w = self.turned.T
        return np.asarray(np.arctan2(2.0 * (w * z + x * y), w**2 + x**2 - y**2 - z**2))


def read(bag: Path, name: str | None = None, memory: int = MEMORY) -> StampedPoses:
    """Read measured poses.

    Args:
        bag: Directory of the bag, or its MCAP file.
        name: Name of their topic; None: the only one that there is.
        memory: What may be held of the bag [bytes].

    Raises:
        BagError: there is no such topic, or its messages are broken.
    """
    found = bag_reader.read(bag, (), _nothing, memory)
    there = {
        topic: kind
        for topic, kind in found.channels.items()
        if kind in TEXTS and topic.rpartition('/')[2] not in OURS
    }
    listed = ', '.join(f'{printable(topic, SHOWN)} ({there[topic]})' for topic in [*there][:FEW])
    if name is None and len(there) != 1:
        if there:
            raise BagError(
                f'{bag} has several topics of poses, {listed}: --pose-topic chooses one'
            )
        kinds = ', '.join(TEXTS)
        raise BagError(
            f'{bag} has no topic of measured poses ({kinds}): --poses FILE.csv has them'
        )
    wanted = f'/{name.lstrip("/")}' if name else next(iter(there))
    if wanted not in there:
        kind, has = found.channels.get(wanted), f'; it has {listed}' if there else ''
        why = 'is not there'
        if wanted.rpartition('/')[2] in OURS:
            why = 'is computed from the joints, not measured'
        elif kind is not None:
            why = f'is of {printable(kind, SHOWN)}, not of poses'
        raise BagError(f'{bag}: --pose-topic {printable(wanted, SHOWN)} {why}{has}')
    topic = Topic(wanted.lstrip('/'), there[wanted])

    def condense(_: Topic, messages: Messages) -> tuple[np.ndarray, Array]:
        return _decoded(bag, topic, messages)

    parts = bag_reader.read(bag, [topic], condense, memory).streams.get(wanted, [])
    if not parts:
        raise BagError(f'{bag} has no messages on {printable(wanted, SHOWN)}')
    stamps, pose = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    seen = (np.abs(pose) <= FARTHEST).all(axis=1) & (pose[:, 3:] != 0.0).any(axis=1)  # nor NaN
    if not seen.any():
        raise BagError(f'{bag}: no message on {printable(wanted, SHOWN)} holds a pose')
    rows = np.flatnonzero(seen)[np.argsort(stamps[seen], kind='stable')]
    return StampedPoses(stamps[rows], pose[rows, :3], pose[rows, 3:], int((~seen).sum()))


def _nothing(_: Topic, messages: Messages) -> None:
    """Only the names of topics are asked for."""


def _decoded(bag: Path, topic: Topic, messages: Messages) -> tuple[np.ndarray, Array]:
    """Stamps and poses of messages of one length; the texts in them may differ."""
    stamps, poses = [], []
    for payload in messages.payloads:
        raw = payload.tobytes()
        order = '<' if raw[1] & 1 else '>'
        try:
            body, place = raw[HEAD:], 8
            for _ in range(TEXTS[topic.type]):
                place += -place % 4
                place += 4 + int(np.frombuffer(body, f'{order}u4', 1, place)[0])
            place += -place % 8
            numbers = np.frombuffer(body, f'{order}f8', 7, place)
            seconds, rest = np.frombuffer(body, f'{order}u4', 2).tolist()
        except (ValueError, IndexError):
            raise BagError(f'{bag}: {topic.name} is not understood: a message is broken') from None
        stamps.append(seconds * NANOSECONDS + rest)
        poses.append(numbers)
    return np.array(stamps, np.int64), np.array(poses)
