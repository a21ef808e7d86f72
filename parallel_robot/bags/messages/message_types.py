"""Types of the suite's messages, messages as bytes, and topics as a bag describes them.

rosbags knows every type of every distribution, and takes 0.12 s to import them. Those of the suite
stand in message_types.json, which ``python -m parallel_robot.bags.messages.message_types`` prints.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from parallel_robot_model.configuration import plain_data
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import DEPTH, Topic

FILE = Path(__file__).with_suffix('.json')


class MessageType(NamedTuple):
    """A message type: the text of its definition with all types in it, and its hash, RIHS01."""

    definition: str
    digest: str


def message_type(name: str) -> MessageType:
    """A type of a topic of the suite.

    Args:
        name: ROS type, e.g. ``'sensor_msgs/msg/JointState'``.

    Raises:
        KeyError: no topic of the suite has it.
    """
    return MessageType(*_known()[name])


def deserialize(message: bytes, name: str) -> Any:
    """Decode a message of a type of the suite.

    Args:
        message: CDR with its encapsulation.
        name: ROS type.

    Raises:
        Exception: the bytes are broken; any length or string in them can be wrong.
    """
    return _store(name).deserialize_cdr(message, name)


def from_rosbags() -> dict[str, MessageType]:
    """What message_types.json must hold, by name: all types of topics of the suite."""
    from rosbags.typesys import Stores, get_typestore  # slow to import

    store = get_typestore(Stores.ROS2_JAZZY)
    found = (topic for topic in vars(topics).values() if isinstance(topic, topics.Topic))
    return {
        name: MessageType(store.generate_msgdef(name, ros_version=2)[0], store.hash_rihs01(name))
        for name in sorted({topic.type for topic in found})
    }


@functools.cache
def _known() -> dict[str, list[str]]:
    return json.loads(FILE.read_text())


@functools.cache  # a store compiles what it decodes
def _store(name: str) -> Any:
    from rosbags.typesys import get_types_from_msg  # slow to import
    from rosbags.typesys.store import Typestore

    store = Typestore()
    store.register(get_types_from_msg(message_type(name).definition, name))
    return store


# Some messages of a topic: as bytes, and decoded.


class Messages(NamedTuple):
    """Some messages of one topic and one length, in the order of the file."""

    log_times: np.ndarray  # when they were recorded [ns], shape (N,)
    payloads: np.ndarray  # the bytes, shape (N, L)


class Samples(NamedTuple):
    """Decoded messages of a topic."""

    joints: tuple[str, ...]  # names in the messages; empty where the type has none
    log_times: np.ndarray  # when they were recorded [ns], shape (N,)
    stamps: np.ndarray  # stamps of their headers [ns], shape (N,); zero where the type has none
    numbers: dict[str, np.ndarray]  # fields by name, each shape (N, n), in the order of the joints

    def rows(self, chosen: np.ndarray) -> Samples:
        """Some of them, by their numbers or by a mask."""
        numbers = {name: values[chosen] for name, values in self.numbers.items()}
        return Samples(self.joints, self.log_times[chosen], self.stamps[chosen], numbers)


# Messages of machines with the other order of bytes.

BIG_ENDIAN = b'\x00\x00'  # first bytes of CDR
HEAD = 4  # bytes of the encapsulation


def little_endian(topic: Topic, messages: Messages) -> Messages:
    """Messages with those in big-endian CDR as little-endian CDR; broken ones as they are."""
    if messages.payloads.shape[1] <= HEAD:
        return messages
    big = ~messages.payloads[:, : len(BIG_ENDIAN)].any(axis=1)
    if not big.any():
        return messages
    payloads = messages.payloads.copy()
    for row in (payloads[k] for k in np.flatnonzero(big)):
        try:
            message = deserialize(row.tobytes(), topic.type)
            found = bytes(_store(topic.type).serialize_cdr(message, topic.type))
        except Exception:  # in broken bytes, anything can go wrong
            continue
        if len(found) <= len(row):
            row[:] = 0
            row[: len(found)] = np.frombuffer(found, np.uint8)
    return Messages(messages.log_times, payloads)


# Topics as a bag describes them: type, definition and quality of service.

FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class Channel(NamedTuple):
    """A topic as a bag describes it."""

    topic: str  # full name, with its leading slash
    type: str  # ROS type
    encoding: str  # format of the definition, e.g. ``ros2msg``
    definition: bytes  # the type and the types in it
    # pairs of key and value: ``offered_qos_profiles`` (YAML), ``topic_type_hash``
    metadata: tuple[tuple[str, str], ...]


def channel(
    name: str, kind: str, definition: str, digest: str, profiles: Iterable[Mapping[str, Any]]
) -> Channel:
    """Describe a topic for a bag.

    Args:
        name: Name of the topic, without leading slash.
        kind: ROS type.
        definition: Text of the type and of all types in it.
        digest: Hash of the type, RIHS01.
        profiles: Quality of service of each publisher.
    """
    metadata = (
        ('offered_qos_profiles', yaml.safe_dump(list(profiles), sort_keys=False)),
        ('topic_type_hash', digest),
    )
    return Channel(f'/{name}', kind, 'ros2msg', definition.encode(), metadata)


@functools.cache
def channel_of(topic: Topic) -> Channel:
    """Describe a topic of the suite for a bag."""
    profiles = [qos_profile(True, topic.latched)]
    return channel(topic.name, topic.type, *message_type(topic.type), profiles)


def qos_profile(reliable: bool, latched: bool) -> dict[str, Any]:
    """Quality of service as rosbag2 writes it."""
    return {
        'history': 'keep_last',
        'depth': 1 if latched else DEPTH,
        'reliability': 'reliable' if reliable else 'best_effort',
        'durability': 'transient_local' if latched else 'volatile',
        'deadline': FOREVER,
        'lifespan': FOREVER,
        'liveliness': 'automatic',
        'liveliness_lease_duration': FOREVER,
        'avoid_ros_namespace_conventions': False,
    }


def profiles_of(channel: Channel) -> list[Any]:
    """Quality of service for metadata.yaml; empty unless it has the form of that version."""
    try:
        profiles = plain_data.load(dict(channel.metadata).get('offered_qos_profiles', ''))
    except ValueError:
        return []
    if isinstance(profiles, list) and all(
        isinstance(each, dict) and isinstance(each.get('reliability'), str) for each in profiles
    ):
        return profiles
    return []


if __name__ == '__main__':
    print(json.dumps(from_rosbags(), indent=1))
