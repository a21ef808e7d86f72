"""Topics of the ROS graph: which to record, how they are offered, their numbered messages."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from parallel_robot.bags.messages.message_types import Channel, channel, qos_profile
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.configuration.yaml_file import MOTION
from parallel_robot_model.messages.topics import DEPTH, RECORDED, Topic
from parallel_robot_model.nodes.connections import listen, message_class, prefixes, qos_of
from parallel_robot_model.nodes.ros_client import Services, plain

# Definitions of message types as bags hold them: from rosbags, or from installed files.

SEPARATOR = '\n' + '=' * 80 + '\nMSG: {}\n'
BUILT_IN = (
    *('bool', 'byte', 'char', 'string', 'wstring', 'float32', 'float64'),
    *(f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)),
)


def definition(type_name: str) -> str:
    """Definition of a type and of all types in it.

    Args:
        type_name: ROS type, e.g. ``'std_msgs/msg/String'``.

    Raises:
        InputError: no such type is installed as a .msg file.
    """
    from rosbags.typesys import Stores, get_typestore  # slow to import

    store = get_typestore(Stores.ROS2_JAZZY)
    if type_name in store.types:
        return store.generate_msgdef(type_name, ros_version=2)[0]
    return concatenate(type_name, prefixes())


def concatenate(type_name: str, places: Sequence[Path]) -> str:
    """Join the .msg files of a type and of the types in it, each once.

    Args:
        type_name: ROS type.
        places: Where packages are installed; the first that has a file wins.

    Raises:
        InputError: a .msg file is missing.
    """
    texts: dict[str, str] = {}
    open_types = [type_name]
    while open_types:
        name = open_types.pop(0)
        if name not in texts:
            texts[name] = _read(name, places)
            open_types += _parts(name, texts[name])
    first, *others = texts
    return texts[first] + ''.join(
        SEPARATOR.format(name.replace('/msg/', '/')) + texts[name] for name in others
    )


def _read(type_name: str, places: Sequence[Path]) -> str:
    package, _, name = type_name.partition('/msg/')
    for prefix in places:
        path = prefix / 'share' / package / 'msg' / f'{name}.msg'
        if name and path.is_file():
            return path.read_text()
    raise InputError(f'{type_name} is not installed as a .msg file')


def _parts(type_name: str, text: str) -> list[str]:
    """Types of the fields that are messages; rosbags' parser refuses wide strings and CRLF."""
    found = []
    for line in text.splitlines():
        words = line.partition('#')[0].split()
        kind = words[0].partition('[')[0].partition('<=')[0] if words else ''
        if kind and kind not in BUILT_IN:
            package, _, name = kind.rpartition('/')
            package = package.removesuffix('/msg') or type_name.partition('/')[0]
            found.append(f'{package}/msg/{name}')
    return found


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
        take: Receives the messages, see :func:`connections.listen`.
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


# Parameters of other nodes: their first values and every later change.

Tell = Callable[[str, dict[str, Any]], None]  # full name of a node, its parameters
OTHERS = ('use_sim_time', 'start_stamp')  # these change at the start of a run
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # what rclpy calls a node of which only a topic is known so far
ANSWER_TIMEOUT = 5.0  # s, how long to wait for the answer of a node


class ParameterWatch:
    """Asks each node for its parameters once, and listens for changes."""

    def __init__(self, node: Node, found: Tell, changed: Tell) -> None:
        """Listen.

        Args:
            node: The node that asks.
            found: Called with all parameters of a node that was asked.
            changed: Called with the new values of parameters that were changed.
        """
        self._node = node
        self._found = found
        self._changed = changed
        itself = node.get_fully_qualified_name()
        self._seen: dict[str, float] = {itself: 0.0}  # s, when first seen
        self._present: set[str] = set()
        self._asked, self._answered = {itself}, {itself}
        self._services = Services(node)
        node.create_subscription(ParameterEvent, '/parameter_events', self._on_event, DEPTH)

    def ask(self, names: Iterable[str]) -> None:
        """Ask the nodes among `names`, full names of all that are present, that were not asked."""
        self._present = set(names)
        for name in self._present:
            self._seen.setdefault(name, time.monotonic())
            if name in self._asked or UNKNOWN in name:
                continue
            if self._services.ready(f'{name}/list_parameters', f'{name}/get_parameters'):
                self._asked.add(name)
                self._services.read_parameters(name, partial(self._on_values, name))

    def missing(self) -> list[str]:
        """Nodes that are present but have not answered yet."""
        now = time.monotonic()
        return [
            name
            for name in sorted(self._present - self._answered)
            if now - self._seen[name] < ANSWER_TIMEOUT
        ]

    def _on_values(self, node: str, values: dict[str, Any]) -> None:
        self._answered.add(node)
        self._found(node, values)

    def _on_event(self, event: ParameterEvent) -> None:
        if event.node not in self._seen:  # of another robot, say: all nodes share the topic
            return
        values = {one.name: plain(one.value) for one in event.changed_parameters}
        values |= {
            one.name: plain(one.value) for one in event.new_parameters if one.name == MOTION
        }
        values = {key: value for key, value in values.items() if key not in OTHERS}
        if values:
            self._changed(event.node, values)
