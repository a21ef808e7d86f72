"""The topics that a node publishes and subscribes to, and whether its partners are there."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from parallel_robot_model.common.errors import printable
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages.layouts import OWN
from parallel_robot_model.messages.topics import QUEUE, Topic
from parallel_robot_model.nodes.message_types import message_class
from parallel_robot_model.nodes.our_joints import OurJoints
from parallel_robot_model.nodes.single_publisher import SinglePublisher
from parallel_robot_model.nodes.subscription import listen, qos_of

NOT_KNOWN = 'one that is not known yet'
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # for ROS, of a node that was discovered a moment ago


class Connections:
    """Publishers and subscriptions of one node."""

    def __init__(
        self,
        node: Node,
        loop: LoopParameters,
        on_stranger: Callable[[Topic, bool], None],
        on_others: Callable[[Topic], None],
    ) -> None:
        """Prepare; nothing is connected yet.

        Args:
            node: The node.
            loop: Time mode, and how many subscribers each essential output has.
            on_stranger: Called for each message that may be of another publisher than those
                before; with its topic, and whether publishers take turns.
            on_others: Called for each message that is dropped because none of its joints is ours.
        """
        self._node = node
        self._lockstep = loop.lockstep
        self._subscribers = loop.subscribers
        self._on_stranger, self._on_others = on_stranger, on_others
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
            if ours is not None and ours.others(data):
                shared = True
                self._on_others(topic)
            elif watched.strange(number):
                if watched.contradicted(shared):
                    self._on_stranger(topic, watched.several())
            else:
                callback(data)

        def take_all(data: bytes, _: int, number: int) -> None:
            self._complete = self._complete or not self.without_subscribers()
            if not self._complete:
                return
            if watched.strange(number):
                self._on_stranger(topic, watched.several())
            callback(data)

        qos = QoSProfile(depth=QUEUE)
        if not (complete or self._lockstep):
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        heard = take_all if self._lockstep else take
        self._inputs[topic] = listen(self._node, topic, qos, heard)

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
            NOT_KNOWN
            if one.node_name == UNKNOWN
            else f'{one.node_namespace.rstrip("/")}/{one.node_name}'
            for one in publishers
        )
        several = '' if len(nodes) == 1 else 's'
        return printable(f'{name} has {len(nodes)} publisher{several}: {", ".join(nodes)}')
