"""The topics that a node publishes and subscribes to, and whether its partners are there."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import NANOSECONDS, usual_period
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.layouts import OWN
from parallel_robot_model.messages.topics import DEPTH, JOINT_STATES, QUEUE, Topic
from parallel_robot_model.nodes.joint_reader import OurJoints, SinglePublisher

# Types of messages, from installed interface packages only.

NAME = re.compile(r'([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)')
INDEX = Path('share', 'ament_index', 'resource_index', 'rosidl_interfaces')


def prefixes() -> list[Path]:
    """Where packages are installed: the prefixes of ROS, then the environment of this Python."""
    given = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    return [Path(prefix) for prefix in (*given, sys.prefix) if prefix]


def message_class(type_name: str) -> Any:
    """Import the class of a ROS type such as ``'std_msgs/msg/String'``.

    A name may come over the wire or from a bag: no other module than one of an interface package
    is imported for it.

    Raises:
        InputError: no such type is installed.
    """
    match = NAME.fullmatch(type_name)
    if match and any((prefix / INDEX / match[1]).is_file() for prefix in prefixes()):
        try:
            return getattr(importlib.import_module(f'{match[1]}.{match[2]}'), match[3])
        except (ImportError, AttributeError):
            pass  # as if it were not there
    raise InputError(f'no type {printable(type_name)} is installed')


# Quality of service of the suite's topics, and subscriptions to messages as bytes.


def qos_of(topic: Topic) -> QoSProfile:
    """Quality of service of a topic of the suite."""
    if topic.latched:
        return QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return QoSProfile(depth=DEPTH)


def listen(
    node: Node, topic: Topic, qos: QoSProfile, take: Callable[[bytes, int, int], None]
) -> Subscription:
    """Subscribe to the serialised messages of a topic, with what the middleware knows of each.

    Args:
        node: The node that subscribes.
        topic: Name and type.
        qos: Quality of service.
        take: Called with the message, the time of its reception [ns], and its number, which
            its publisher counts from 1 on; 0 if the middleware does not number messages.
    """

    def pass_on(*arguments: Any) -> None:
        # EventsExecutor passes message and information as one tuple (rclpy 7.1).
        data, information = arguments if len(arguments) == 2 else arguments[0]
        take(
            data,
            information['received_timestamp'],
            information['publication_sequence_number'] or 0,
        )

    signature = inspect.signature(lambda message, information: None)
    pass_on.__signature__ = signature  # type: ignore[attr-defined]
    return node.create_subscription(message_class(topic.type), topic.name, pass_on, qos, raw=True)


UNKNOWN_NODE = 'one that is not known yet'
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # for ROS, of a node that was discovered a moment ago


class Connections:
    """Publishers and subscriptions of one node."""

    def __init__(
        self,
        node: Node,
        loop: LoopParameters,
        on_unknown_publisher: Callable[[Topic, bool], None],
        on_foreign_joints: Callable[[Topic], None],
    ) -> None:
        """Prepare; nothing is connected yet.

        Args:
            node: The node.
            loop: Time mode, and how many subscribers each essential output has.
            on_unknown_publisher: Called for each message that may be of another publisher than
                those before; with its topic, and whether publishers take turns.
            on_foreign_joints: Called for each message that is dropped because none of its joints
                is ours.
        """
        self._node = node
        self._lockstep = loop.lockstep
        self._subscribers = loop.subscribers
        self._on_unknown_publisher, self._on_foreign_joints = (
            on_unknown_publisher,
            on_foreign_joints,
        )
        self._joints = loop.joints
        self._outputs: list[Publisher] = []  # the essential ones
        self._inputs: dict[Topic, Subscription] = {}
        self._watched: dict[Topic, SinglePublisher] = {}  # inputs
        self._complete = False  # whether the essential outputs have had all their subscribers

    def publisher(self, topic: Topic, essential: bool) -> Publisher:
        """Create a publisher; the node is ready when essential ones have their subscribers."""
        kind = message_class(topic.type)
        publisher = self._node.create_publisher(kind, topic.name, qos_of(topic))
        if essential:
            self._outputs.append(publisher)
        return publisher

    def withdraw(self, publisher: Publisher) -> None:
        """Destroy an essential publisher."""
        self._outputs.remove(publisher)
        self._node.destroy_publisher(publisher)

    def subscribe(self, topic: Topic, callback: Callable[[bytes], None], complete: bool) -> None:
        """Subscribe to the serialised messages of a topic, see :meth:`SuiteNode.subscribe`."""
        watched = SinglePublisher(lambda: self._inputs[topic].get_publisher_count() <= 1)
        self._watched[topic] = watched

        ours = OurJoints(topic, self._joints) if topic.type in OWN else None
        shared = False

        def take(data: bytes, _: int, number: int) -> None:
            nonlocal shared
            if ours is not None and ours.is_foreign(data):
                shared = True
                self._on_foreign_joints(topic)
            elif watched.is_unknown(number):
                if watched.contradicted(shared):
                    self._on_unknown_publisher(topic, watched.several())
            else:
                callback(data)

        def take_all(data: bytes, _: int, number: int) -> None:
            self._complete = self._complete or not self.without_subscribers()
            if not self._complete:
                return
            if watched.is_unknown(number):
                self._on_unknown_publisher(topic, watched.several())
            callback(data)

        qos = QoSProfile(depth=QUEUE)
        if not (complete or self._lockstep):
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        listener = take_all if self._lockstep else take
        self._inputs[topic] = listen(self._node, topic, qos, listener)

    def lost(self, topic: Topic) -> int:
        """Number of messages of a topic that were sent and did not come, or too many at once."""
        return self._watched[topic].lost

    def silence(self, topic: Topic) -> float:
        """For how long one publisher of an input was silent when another was heard [s]."""
        return self._watched[topic].silence

    def missing(self) -> str:
        """What the node still waits for; empty when every partner is there."""
        for topic, subscription in self._inputs.items():
            if not subscription.get_publisher_count():
                return f'no publisher of {topic.name}'
        return self.without_subscribers()

    def without_subscribers(self) -> str:
        """The first essential output that lacks subscribers; empty when none does."""
        for publisher in self._outputs:
            count = publisher.get_subscription_count()
            if count < self._subscribers:
                return f'{publisher.topic_name} has {count} of {self._subscribers} subscribers'
        return ''

    def several_publishers(self) -> dict[str, int]:
        """Number of publishers of each topic that has more than one, by its name."""
        counts = {topic.name: one.get_publisher_count() for topic, one in self._inputs.items()}
        for name in (publisher.topic_name for publisher in self._outputs):
            counts[name] = self._node.count_publishers(name)
        return {name: count for name, count in counts.items() if count > 1}

    def shared_outputs(self) -> list[str]:
        """Full names of the essential outputs on which other nodes publish, too."""
        names = [publisher.topic_name for publisher in self._outputs]
        return [name for name in names if self._node.count_publishers(name) > 1]

    def disputes(self) -> list[str]:
        """Topics of which another publisher acts, or would act, just now, with their nodes."""
        turns = [topic for topic, one in self._watched.items() if one.several()]
        return [
            *map(self.publishers_of_input, turns),
            *map(self._publishers_of, self.shared_outputs()),
        ]

    def publishers_of_input(self, topic: Topic) -> str:
        """A line that names the nodes that publish on a topic that this one hears."""
        return self._publishers_of(self._inputs[topic].topic_name)

    def _publishers_of(self, name: str) -> str:
        """A line that names the nodes that publish on a topic, by its full name."""
        publishers = self._node.get_publishers_info_by_topic(name)
        nodes = sorted(
            UNKNOWN_NODE
            if one.node_name == UNKNOWN
            else f'{one.node_namespace.rstrip("/")}/{one.node_name}'
            for one in publishers
        )
        several = '' if len(nodes) == 1 else 's'
        return printable(f'{name} has {len(nodes)} publisher{several}: {", ".join(nodes)}')


# The period with which joint states come, for a node with ``period: auto``.

AUTO = 'auto'
FEW = 20  # steps from a state to the next, at least, of which the period is found
SPAN = NANOSECONDS // 2  # ns, over all of them, at least
LOOK = 0.1  # s, between two looks whether the states suffice
REMINDER = 5.0  # s, from one word that it still waits to the next
PERIOD_SOURCES = (
    'controller',
    'trajectory',
    'recorder',
    'monitor',
)  # nodes whose period counts, in order
ANSWER_TIMEOUT = 5.0  # s, in which one of them answers
ALIKE = 0.01  # share of the period, by which that of another node may differ from it


def wait_for_period(node: Node, joints: tuple[str, ...], end_with_parent: bool) -> int:
    """Wait for joint states, and find their period from their stamps.

    Where another node of the run has about the same period, its is taken: all have one, in
    whatever order they start, also when one starts again.

    Args:
        node: The node that waits; nothing else of it happens meanwhile.
        joints: Names of the joints; messages of others are left out.
        end_with_parent: Whether the process ends when the one that started it has.

    Returns:
        The period, in whole microseconds [ns].
    """
    ours, stamps, parent = OurJoints(JOINT_STATES, joints), [], os.getppid()

    def take(data: bytes, _: int, number: int) -> None:
        stamp = None if ours.is_foreign(data) else layouts.header_stamp(data)
        if stamp is not None:
            stamps.append(stamp)

    qos = QoSProfile(depth=QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
    subscription = listen(node, JOINT_STATES, qos, take)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    others = {
        name: node.create_client(GetParameters, f'{name}/get_parameters')
        for name in PERIOD_SOURCES
        if name != node.get_name()
    }
    reported, period = -REMINDER, 0
    while not period:
        end = time.monotonic() + LOOK
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=LOOK)
        period = period_of(np.array(stamps, np.int64))
        if end_with_parent and os.getppid() != parent:
            raise SystemExit(0)
        if not period and end - reported > REMINDER:
            node.get_logger().warning(f'period {AUTO}: waits for {subscription.topic_name}')
            reported = end
    node.destroy_subscription(subscription)
    agreed = _agreed(node, executor, others, period)
    executor.remove_node(node)
    executor.shutdown()
    for client in others.values():
        node.destroy_client(client)
    return agreed


def _agreed(
    node: Node, executor: SingleThreadedExecutor, names: Mapping[str, Client], period: int
) -> int:
    """The period that another node of the run has, if it is about the same, else this one [ns].

    Those that come first among them are waited for, so that two never take that of each other.
    """
    there = node.get_node_names_and_namespaces()
    for name, client in names.items():
        before = node.get_name() not in PERIOD_SOURCES[: PERIOD_SOURCES.index(name)]
        first = before and (name, node.get_namespace()) in there
        end = time.monotonic() + ANSWER_TIMEOUT
        while first and not client.service_is_ready() and time.monotonic() < end:
            executor.spin_once(timeout_sec=LOOK)
        if not client.service_is_ready():
            continue
        future = client.call_async(GetParameters.Request(names=['period']))
        executor.spin_until_future_complete(future, end - time.monotonic())
        values = future.result().values if future.done() else []
        known = round(values[0].double_value * NANOSECONDS) if values else 0
        if abs(known - period) <= ALIKE * period:
            return known
    return period


def period_of(stamps: np.ndarray) -> int:
    """The period of states, of which single ones may be missing.

    Args:
        stamps: Their stamps, in the order in which they came [ns], shape (N,).

    Returns:
        The period, in whole microseconds [ns]; 0 if they are too few to tell.
    """
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if len(steps) < FEW or steps.sum() < SPAN:
        return 0
    return usual_period(steps)
