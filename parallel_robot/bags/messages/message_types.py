"""Types of the suite's messages: definition, hash and decoding, without the import of all of ROS.

rosbags knows every type of every distribution, and takes 0.12 s to import them. Those of the suite
stand in message_types.json, which ``python -m parallel_robot.bags.messages.message_types`` prints.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot_model.messages import topics

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


def reserialize(message: bytes, name: str) -> bytes:
    """A message of a type of the suite in little-endian CDR.

    Args:
        message: CDR of any order of bytes, with its encapsulation.
        name: ROS type.

    Raises:
        Exception: the bytes are broken; any length or string in them can be wrong.
    """
    return bytes(_store(name).serialize_cdr(deserialize(message, name), name))


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
    known: dict[str, list[str]] = json.loads(FILE.read_text())
    return known


@functools.cache  # a store compiles what it decodes
def _store(name: str) -> Any:
    from rosbags.typesys import get_types_from_msg  # slow to import
    from rosbags.typesys.store import Typestore

    store = Typestore()
    store.register(get_types_from_msg(message_type(name).definition, name))
    return store


if __name__ == '__main__':
    print(json.dumps(from_rosbags(), indent=1))
