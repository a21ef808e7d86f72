"""The running graph as the page sees it: states, references, parameters; requests to its nodes."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterEvent

from parallel_robot.live.source import Description
from parallel_robot.watch.robots import Robots, Tell
from parallel_robot.watch.ros_graph import ANSWER_TIMEOUT, RosGraph
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.yaml_file import is_configuration
from parallel_robot_model.messages import cdr, topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.nodes.joint_reader import JointReader
from parallel_robot_model.nodes.ros_client import plain

LONGEST = 2000  # messages of a topic that may wait: two seconds
ROUNDS = 3  # of the executor in a look, for answers of the nodes
ASKED = ('controller', 'trajectory')  # nodes whose parameters are wanted
FIELDS = {
    topics.JOINT_STATES: (('position',), ('velocity', 'effort')),
    topics.REFERENCE: (('position', 'velocity', 'acceleration'), ()),
}
PARAMETER_EVENTS = 100  # that may wait


class Heard(NamedTuple):
    """Messages of joints: stamps [ns], shape (N,), and for each field its rows, shape (N, n)."""

    stamps: NDArray[np.int64]
    fields: tuple[Array, ...]


class LiveGraph(RosGraph):
    """Listens to one robot."""

    DEPTH = LONGEST
    SERVICES = (
        *RosGraph.SERVICES,
        'plant/reset',
        'trajectory/set_parameters',
        *(f'{node}/{kind}_parameters' for node in ASKED for kind in ('list', 'get', 'describe')),
    )

    def __init__(self, robots: Robots) -> None:
        """Prepare; reports of the nodes go into `robots`."""
        super().__init__(robots, 'parallel_robot_live')
        # parameters of the nodes that were asked, by node; empty while not known
        self.parameters: dict[str, dict[str, Any]] = {}
        # what they say of their parameters, by node and name
        self.descriptions: dict[str, dict[str, Description]] = {}
        self._messages: dict[Topic, list[bytes]] = {topics.JOINT_STATES: [], topics.REFERENCE: []}
        self._readers: dict[tuple[Topic, tuple[str, ...]], JointReader] = {}
        self._waiting: dict[str, float] = {}  # nodes that were asked and have not answered: when

    def __enter__(self) -> LiveGraph:
        super().__enter__()
        self._node.create_subscription(
            ParameterEvent, '/parameter_events', self._on_event, PARAMETER_EVENTS
        )
        return self

    def takers(self) -> dict[Topic, Callable[[bytes], None]]:
        """Topics of the robot that are read."""
        kept = {topic: messages.append for topic, messages in self._messages.items()}
        return {topics.STATUS: self._on_status, **kept}

    def watch(self, namespace: str) -> None:
        """Read one robot, by its namespace."""
        self.parameters, self.descriptions = {}, {}
        self._waiting.clear()
        super().watch(namespace)

    def look(self) -> None:
        """Take all that has come since the last look."""
        super().look()
        for messages in self._messages.values():
            del messages[:-LONGEST]
        for _ in range(ROUNDS):
            self._executor.spin_once(timeout_sec=0.0)

    def heard(self, topic: Topic, joints: tuple[str, ...]) -> Heard:
        """Messages of states or references since the last call.

        Args:
            topic: JOINT_STATES or REFERENCE.
            joints: Names of the joints, in order.
        """
        messages = self._messages[topic]
        taken, messages[:] = messages[:], []
        key = (topic, joints)
        if key not in self._readers:
            needed, optional = FIELDS[topic]
            self._readers[key] = JointReader(
                topic, joints, needed, Counter(), dict.fromkeys(optional, math.nan)
            )
        return _read_all(self._readers[key], taken, topic, len(joints))

    def ask_parameters(self) -> None:
        """Ask the nodes for their parameters, where they are not known."""
        for node in ASKED:
            now = time.monotonic()
            asked = self._waiting.get(node, -math.inf)  # an answer can be lost as well
            if node in self.parameters or now - asked < ANSWER_TIMEOUT:
                continue
            name = f'{self._namespace}/{node}'
            if self._services.ready(f'{name}/list_parameters'):
                self._waiting[node] = now
                self._services.read_parameters(name, partial(self._take_parameters, node))

    def reset(self, tell: Tell) -> None:
        """Put the robot of the plant back to its start."""
        self.ask('plant/reset', tell)

    def _take_parameters(self, node: str, found: dict[str, Any]) -> None:
        self.parameters[node] = found
        self._waiting.pop(node, None)
        service = f'{self._namespace}/{node}/describe_parameters'
        self._services.send(service, partial(self._take_descriptions, node), names=[*found])

    def _take_descriptions(self, node: str, answer: Any) -> None:
        self.descriptions[node] = {one.name: _description(one) for one in answer.descriptors}

    def _on_event(self, event: ParameterEvent) -> None:
        space, _, node = event.node.rpartition('/')
        if space != self._namespace or node not in ASKED:
            return
        if any(is_configuration(one.name) for one in event.new_parameters):  # it started anew
            self.parameters.pop(node, None)
            self._waiting.pop(node, None)
        elif node in self.parameters:
            changed = {one.name: plain(one.value) for one in event.changed_parameters}
            self.parameters[node] = {**self.parameters[node], **changed}


def _read_all(reader: JointReader, messages: list[bytes], topic: Topic, joints: int) -> Heard:
    """Read messages; those of one layout are read together."""
    needed, optional = FIELDS[topic]
    layout, names = reader.layout, [*needed, *optional]
    if layout and messages and set(names) <= set(layout.dtype.names or ()):
        length = len(layout.template)
        records = layout.decode(b''.join(data[:length] for data in messages), len(messages))
        if records is not None:
            rows = tuple(records[name][:, reader.order] for name in names)
            if all(np.isfinite(row).all() for row in rows):
                return Heard(cdr.stamps_of(records), rows)
    read = [found for found in map(reader.read, messages) if found is not None]
    stamps = np.array([stamp for stamp, _ in read], dtype=np.int64)
    columns = zip(*(vectors for _, vectors in read), strict=True) if read else [()] * len(names)
    return Heard(stamps, tuple(np.array(column).reshape(-1, joints) for column in columns))


def _description(told: Any) -> Description:
    """What a node says of a parameter."""
    ranges = [*told.floating_point_range, *told.integer_range]
    low, high = (ranges[0].from_value, ranges[0].to_value) if ranges else (None, None)
    return Description(told.description, low, high, told.read_only)
