"""Topics as a bag describes them: type, definition and quality of service."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import yaml

from parallel_robot.bags.messages.message_types import message_type
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.messages.topics import DEPTH, Topic

FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class Channel(NamedTuple):
    """A topic as a bag describes it.

    Attributes:
        topic: Full name, with its leading slash.
        type: ROS type.
        encoding: Format of the definition, e.g. ``ros2msg``.
        definition: The type and the types in it.
        metadata: Pairs of key and value: ``offered_qos_profiles`` (YAML), ``topic_type_hash``.
    """

    topic: str
    type: str
    encoding: str
    definition: bytes
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
    if isinstance(profiles, list) and all(_has_words(profile) for profile in profiles):
        return profiles
    return []


def _has_words(profile: Any) -> bool:
    return isinstance(profile, dict) and isinstance(profile.get('reliability'), str)
