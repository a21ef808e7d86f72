"""A running robot for Foxglove and Lichtblick: its topics as they are, description and frames.

The server has no capability: whoever connects can look and nothing else.
"""

from __future__ import annotations

import collections
import signal
import socket
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from parallel_robot.analysis.monitor import Posture, posture_of
from parallel_robot.bags.messages.message_types import message_type
from parallel_robot.live.graph_source import Watched, known_values, of_robot
from parallel_robot.live.guard import OPEN, is_loopback
from parallel_robot.live.ros_live_graph import LiveGraph
from parallel_robot.watch.robots import Robots
from parallel_robot_model.common.errors import InputError, ParallelRobotError, optional
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.processes.termination_signals import termination_signals
from parallel_robot_model.robots.link import frames

PORT = 8765  # where Foxglove looks for a server
LOOK = 0.02  # s, between two looks at the graph
EVERY = 10  # looks, from one check of what runs to the next


class Server:
    """Sends to all that subscribe; late subscribers of latched topics get the last message."""

    def __init__(self, host: str, port: int, namespace: str) -> None:
        """Listen; the topics of a robot, by its namespace, are there from the beginning.

        Raises:
            InputError: foxglove-sdk is not installed, or the port cannot be had.
        """
        self._library = optional('foxglove')
        self._channels: dict[str, Any] = {}
        self._latched: dict[str, bytes] = {}
        self._late: collections.deque[str] = collections.deque()  # who wants latched messages
        self._frames = self._library.channels.FrameTransformsChannel('/tf')
        self.offer(namespace)
        try:
            self._server = self._library.start_server(
                name='parallel_robot', host=host, port=port, server_listener=self
            )
        except Exception as error:  # the library has its own, without a base
            raise InputError(f'cannot listen on {host} port {port}: {error}') from None
        self.port: int = self._server.port

    def offer(self, namespace: str) -> None:
        """Have the channels of a robot, by its namespace, before there is anything to send.

        The library tells clients of a new channel a moment before it lets them subscribe to it.
        """
        for topic in (*topics.RECORDED, topics.ROBOT_DESCRIPTION):
            name = f'{namespace}/{topic.name}'
            if name not in self._channels:
                text = message_type(topic.type).definition.encode()
                schema = self._library.Schema(name=topic.type, encoding='ros2msg', data=text)
                self._channels[name] = self._library.Channel(
                    name, message_encoding='cdr', schema=schema
                )

    def send(self, topic: Topic, data: bytes) -> None:
        """Send a serialised message of a topic by its full name."""
        if topic.latched:
            self._latched[topic.name] = data
        self._channels[topic.name].log(data, log_time=time.time_ns())

    def send_latched(self) -> None:
        """Send to late subscribers what they missed."""
        while self._late:
            name = self._late.popleft()
            if name in self._latched:
                self._channels[name].log(self._latched[name], log_time=time.time_ns())

    def send_frames(self, posture: Posture, stamp: int, angles: Any) -> None:
        """Send the frames of all links; stamp in nanoseconds."""
        messages = self._library.messages
        sec, nanosec = divmod(stamp, NANOSECONDS)
        places = (found.tolist() for found in frames(posture.links, angles))
        transforms = [
            messages.FrameTransform(
                timestamp=messages.Timestamp(sec, nanosec),
                parent_frame_id=link.parent,
                child_frame_id=link.name,
                translation=messages.Vector3(**dict(zip('xyz', place, strict=True))),
                rotation=messages.Quaternion(**dict(zip('xyzw', turn, strict=True))),
            )
            for link, place, turn in zip(posture.links, *places, strict=True)
        ]
        self._frames.log(messages.FrameTransforms(transforms=transforms), log_time=time.time_ns())

    def close(self) -> None:
        """End all connections."""
        self._server.stop()

    # Called by the library, in a thread of its own.

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Note that somebody is late; the subscription itself may still be on its way."""
        self._late.append(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Nothing: the library knows who is left."""


class FoxgloveGraph(LiveGraph):
    """Passes on each message of the suite's topics of one robot."""

    def __init__(self, robots: Robots, send: Callable[[Topic, bytes], None]) -> None:
        """Prepare; `send` takes the messages."""
        super().__init__(robots)
        self._send = send

    def takers(self) -> dict[Topic, Callable[[bytes], None]]:
        """All that a bag has, and what is read here."""
        taken = super().takers()

        def both(topic: Topic, data: bytes) -> None:
            self._send(topic._replace(name=f'{self._namespace}/{topic.name}'), data)
            if topic in taken:
                taken[topic](data)

        return {topic: partial(both, topic) for topic in topics.RECORDED}


def serve(host: str, port: int, namespace: str | None, given: Mapping[str, Any] | None) -> None:
    """Serve until a signal ends it.

    Args:
        host: Address to listen on.
        port: Its port; 0 for any.
        namespace: Full name of that of the robot; None for the first that is heard.
        given: Configuration of a graph that was started here; None for any other.

    Raises:
        InputError: the port cannot be had.
    """
    server, robots = Server(host, port, namespace or ''), Robots()
    ended: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, _: ended.append(number))
        for number in termination_signals()
    }
    print(f'foxglove  ws://{host}:{server.port}', flush=True)
    if not is_loopback(str(socket.getaddrinfo(host, server.port)[0][4][0])):
        print(OPEN, file=sys.stderr)
    try:
        graph = FoxgloveGraph(robots, server.send)
        with graph:
            picture = _Picture(graph, Watched(graph, robots, namespace), server, given)
            while not ended:
                picture.look()
                time.sleep(LOOK)
    finally:
        server.close()
        for number, handler in handlers.items():
            signal.signal(number, handler)


class _Picture:
    """The robot that is shown, and its links as soon as its nodes have said what it is."""

    def __init__(
        self,
        graph: FoxgloveGraph,
        watched: Watched,
        server: Server,
        given: Mapping[str, Any] | None,
    ) -> None:
        self._graph, self._watched, self._server, self._given = graph, watched, server, given
        self._seen: dict[str, Any] = {}
        self._posture: Posture | None = None
        self._joints: tuple[str, ...] = ()
        self._looks = 0

    def look(self) -> None:
        """Pass on what has come."""
        self._graph.look()
        self._server.send_latched()
        if self._looks % EVERY == 0:
            changed = self._watched.changed()
            self._server.offer(self._watched.namespace)
            if changed and 'controller' in self._watched.parameters:
                self._prepare()
        self._looks += 1
        if self._posture is None:
            return
        heard = self._graph.heard(topics.JOINT_STATES, self._joints)
        for stamp, position in zip(heard.stamps.tolist(), heard.fields[0], strict=True):
            angles = self._posture.add_state(stamp, position)
            if angles is not None:
                self._server.send_frames(self._posture, stamp, angles)

    def _prepare(self) -> None:
        """Make the links of the robot that the nodes know."""
        values = known_values(self._watched.parameters, self._given)
        seen = of_robot(values)
        if seen == self._seen and not self._watched.started:
            return
        self._seen = seen
        self._joints = tuple(values['joints'])
        try:
            self._posture = posture_of(values)
        except ParallelRobotError as error:
            self._posture = None
            print(f'warning: no picture: {error}', file=sys.stderr)
            return
        topic = topics.ROBOT_DESCRIPTION
        text = layouts.text_message(self._posture.description)
        self._server.send(topic._replace(name=f'{self._watched.namespace}/{topic.name}'), text)
