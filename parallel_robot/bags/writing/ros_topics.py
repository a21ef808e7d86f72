"""Topics of the ROS graph: which to record, how they are offered, their numbered messages."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from parallel_robot.bags.messages.message_types import Channel, channel, qos_profile
from parallel_robot.bags.messages.ros_message_definition import definition
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.messages.topics import DEPTH, RECORDED, Topic
from parallel_robot_model.nodes.connections import listen, message_class, qos_of


class RecorderParameters(NamedTuple):
    """Where the bag goes, and what is recorded instead of the suite's topics."""

    out: Annotated[str, Field('', "directory of the bag, must not exist; '': by date and time")]
    command_line: Annotated[str, Field('', "what started the run; '': what started the recorder")]
    topics: Annotated[tuple[str, ...], Field('', 'names of topics')]
    regex: Annotated[str, Field('', 'also topics in whose name this is found')]
    all: Annotated[bool, Field('', 'all topics but the hidden ones')]


class Discovery:
    """Finds the topics that are wanted as they appear."""

    def __init__(self, node: Node, wanted: RecorderParameters) -> None:
        """Prepare.

        Raises:
            InputError: `regex` is not a regular expression.
        """
        self._node = node
        self._all = wanted.all
        self._names = {node.resolve_topic_name(name) for name in wanted.topics}
        self._own = {node.resolve_topic_name(topic.name): topic for topic in RECORDED}
        self._seen: set[str] = set()
        try:
            self._pattern = re.compile(wanted.regex) if wanted.regex else None
        except re.error as error:
            raise InputError(f'recorder.regex is not a regular expression: {error}') from None

    def new(self) -> dict[Topic, tuple[Channel, QoSProfile]]:
        """Wanted topics that were not there before, and how to subscribe to them.

        Warns once about each that cannot be recorded.
        """
        found = {}
        for name, types in self._node.get_topic_names_and_types():
            if name in self._seen or not self._wants(name):
                continue
            publishers = self._node.get_publishers_info_by_topic(name)
            if not publishers:
                continue
            self._seen.add(name)
            try:
                if len(types) > 1:
                    raise InputError(f'it has several types: {", ".join(types)}')
                message_class(types[0])
                offered = channel(
                    name.lstrip('/'),
                    types[0],
                    definition(types[0]),
                    str(publishers[0].topic_type_hash),
                    [_profile(info.qos_profile) for info in publishers],
                )
            except InputError as error:
                self._node.get_logger().warning(f'{name} is not recorded: {error}')
                continue
            profiles = [info.qos_profile for info in publishers]
            latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
            qos = QoSProfile(depth=DEPTH)
            if latched:
                qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            if any(p.reliability == ReliabilityPolicy.BEST_EFFORT for p in profiles):
                qos.reliability = ReliabilityPolicy.BEST_EFFORT
            own = self._own.get(name)
            topic = Topic(name.lstrip('/'), types[0], 0, latched)
            if own is not None and own.type == topic.type and own.name == topic.name:
                topic = own  # whose rhythm is known
            found[topic] = (offered, qos)
        return found

    def _wants(self, name: str) -> bool:
        if name in self._names:
            return True
        hidden = '/_' in name
        found = self._pattern is not None and self._pattern.search(name) is not None
        return not hidden and (self._all or found)


def listen_all(
    node: Node,
    topic: Topic,
    qos: QoSProfile | None,
    take: Callable[[bytes, int, int], None],
) -> Subscription:
    """Subscribe to the serialised messages of a topic, with their reception and number.

    The numbers reveal every loss. The middleware's event for lost messages does not know of those
    that a full queue of the receiver dropped, and waiting for it can deadlock (rmw_fastrtps 890).

    Args:
        node: The node that listens.
        topic: Relative name for topics of the suite, else without its leading slash.
        qos: Quality of service; None: that of the topics of the suite.
        take: Receives the messages, see :func:`subscription.listen`.
    """
    profile = qos or qos_of(topic)
    profile.depth = DEPTH  # latched topics too: every message is wanted
    return listen(node, topic._replace(name=full_name(topic)), profile, take)


def full_name(topic: Topic) -> str:
    """Name of a topic for the node: those of the suite are relative, all others absolute."""
    return topic.name if topic in RECORDED else f'/{topic.name}'


def _profile(qos: QoSProfile) -> dict[str, Any]:
    """Profile of a publisher as bags hold it; its history is not known over the graph."""
    return qos_profile(
        reliable=qos.reliability != ReliabilityPolicy.BEST_EFFORT,
        latched=qos.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    )
