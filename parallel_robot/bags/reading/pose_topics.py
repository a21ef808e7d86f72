"""Poses that something else than the suite measured, as a tracker or a camera, in a bag."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.limits import MEMORY, SortedRows
from parallel_robot.bags.reading import bag_reader
from parallel_robot.bags.reading.bag_reader import Messages
from parallel_robot_model.common.errors import BagError, printable
from parallel_robot_model.common.units import NANOSECONDS, Array
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
        total: Number of the others.
    """

    stamps: np.ndarray
    place: Array
    turned: Array
    missing: int
    total: int

    @property
    def phi(self) -> Array:
        """Angles about z [rad], shape (N,)."""
        x, y, z, w = self.turned.T
        return np.asarray(np.arctan2(2.0 * (w * z + x * y), w**2 + x**2 - y**2 - z**2))


def read(
    bag: Path, name: str | None = None, memory: int = MEMORY, most: int | None = None
) -> StampedPoses:
    """Read measured poses in the order of their stamps.

    Args:
        bag: Directory of the bag, or its MCAP file.
        name: Name of their topic; None: the only one that there is.
        memory: What may be held of the bag [bytes].
        most: How many poses are wanted, evenly; None: all.

    Raises:
        BagError: there is no such topic, or its messages are broken.
        InputError: there is no room to keep them.
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
    kept, missing = SortedRows('the poses'), 0

    def keep(_: Topic, messages: Messages) -> None:
        nonlocal missing
        stamps, pose = _decoded(bag, topic, messages)
        seen = (np.abs(pose) <= FARTHEST).all(axis=1) & (pose[:, 3:] != 0.0).any(axis=1)  # nor NaN
        missing += int((~seen).sum())
        kept.add(stamps[seen], pose[seen])

    bag_reader.read(bag, [topic], keep, memory, held=False)
    if not kept.count and not missing:
        raise BagError(f'{bag} has no messages on {printable(wanted, SHOWN)}')
    if not kept.count:
        raise BagError(f'{bag}: no message on {printable(wanted, SHOWN)} holds a pose')
    stamps, pose = kept.evenly(most)
    return StampedPoses(stamps, pose[:, :3], pose[:, 3:], missing, kept.count)


def _nothing(_: Topic, messages: Messages) -> None:
    """Only the names of topics are asked for."""


def _decoded(bag: Path, topic: Topic, messages: Messages) -> tuple[np.ndarray, Array]:
    """Stamps and poses of messages of one length; the texts in them may differ."""
    raw, count = messages.payloads, len(messages.payloads)
    stamps, poses = np.empty(count, np.int64), np.empty((count, 7))
    try:
        little = raw[:, 1] & 1 == 1
        for order, rows in (('<', np.flatnonzero(little)), ('>', np.flatnonzero(~little))):
            body, place = raw[rows, HEAD:], np.full(len(rows), 8)
            for _ in range(TEXTS[topic.type]):
                place += -place % 4
                place += 4 + _numbers(body, place, 1, f'{order}u4')[:, 0].astype(np.int64)
            place += -place % 8
            poses[rows] = _numbers(body, place, 7, f'{order}f8')
            seconds, rest = _numbers(body, np.zeros_like(place), 2, f'{order}u4').T
            stamps[rows] = seconds.astype(np.int64) * NANOSECONDS + rest
    except IndexError:
        raise BagError(f'{bag}: {topic.name} is not understood: a message is broken') from None
    return stamps, poses


def _numbers(raw: np.ndarray, place: np.ndarray, count: int, kind: str) -> np.ndarray:
    """Numbers that stand in each row from a place on, shape (N, count).

    Raises:
        IndexError: a row ends before.
    """
    columns = place[:, np.newaxis] + np.arange(count * np.dtype(kind).itemsize)
    return raw[np.arange(len(raw))[:, np.newaxis], columns].view(kind)
