"""The running graph as the screen sees it: messages are read when the screen asks for them.

Nothing wakes the process up in between, and all subscriptions except that of the latched status
are best effort, so that the nodes are not held up.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.task import Future

from parallel_robot.watch.robots import Robot, Robots, Tell, read_joints
from parallel_robot_model.messages import cdr, layouts, topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.nodes.connections import message_class
from parallel_robot_model.nodes.middleware import tool_node
from parallel_robot_model.nodes.ros_client import Services, messages_of, reported

DIAGNOSTICS = Topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', 0)
ANSWER_TIMEOUT = 3.0  # s, for the answer of a node
ROUNDS = 10  # of the executor in a look, while an answer is waited for


class RosGraph:
    """Listens to the nodes of a ROS domain; use as a context manager.

    Attributes:
        DEPTH: Messages of a topic that may come between two looks; more are dropped.
        SERVICES: Services of the watched robot that can be asked for.
    """

    DEPTH = 200
    SERVICES: tuple[str, ...] = (
        'controller/set_parameters',
        'controller/emergency_stop',
        'controller/clear_fault',
    )

    def __init__(self, robots: Robots, name: str = 'parallel_robot_top') -> None:
        """Prepare.

        Args:
            robots: What is read goes there.
            name: Name of the node.
        """
        self._robots, self._name = robots, name
        self._exit = ExitStack()
        self._namespace = ''
        self._subscriptions: list[tuple[Subscription, Callable[[bytes], None]]] = []
        self._asked: dict[Future, tuple[float, Tell]] = {}
        self._pose = layouts.pose_stamped(topics.FRAME)
        self._state = b''  # the newest joint state since the last look

    def __enter__(self) -> RosGraph:
        node = tool_node(self._name, enable_rosout=False)
        self._node = self._exit.enter_context(node)
        self._services = Services(self._node)  # those of the watched robot
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._listen(DIAGNOSTICS, self._on_diagnostics)
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    def watch(self, namespace: str) -> None:
        """Read what one robot tells, by its namespace, and no longer what another does."""
        while len(self._subscriptions) > 1:
            self._node.destroy_subscription(self._subscriptions.pop()[0])
        self._services.clear()
        self._services.ready(*(f'{namespace}/{name}' for name in self.SERVICES))
        self._namespace, self._state = namespace, b''
        for topic, take in self.takers().items():
            self._listen(topic._replace(name=f'{namespace}/{topic.name}'), take)

    def takers(self) -> dict[Topic, Callable[[bytes], None]]:
        """Topics of the watched robot that are read, each with what takes its messages."""
        return {
            topics.STATUS: self._on_status,
            topics.JOINT_STATES: self._keep_state,
            topics.POSE: partial(self._on_pose, Robot.pose),
            topics.POSE_REFERENCE: partial(self._on_pose, Robot.pose_reference),
        }

    def look(self) -> None:
        """Take all that has come since the last look."""
        for subscription, take in self._subscriptions:
            with subscription.handle:
                for _ in range(self.DEPTH):
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    take(taken[0])
        if self._state:
            joints, self._state = read_joints(self._state), b''
            self._robots[self._namespace].take_joints(time.monotonic(), joints)
        self._robots.look(time.monotonic())
        self.answers()

    def answers(self) -> None:
        """Tell those who asked what the nodes have answered."""
        for _ in range(ROUNDS if self._asked else 0):
            self._executor.spin_once(timeout_sec=0.0)
        for future, (deadline, tell) in [*self._asked.items()]:
            if future.done():
                tell(*_outcome(future.result()))
            elif time.monotonic() > deadline:
                tell(False, 'the node does not answer')
            else:
                continue
            del self._asked[future]

    def switch_law(self, law: str, tell: Tell) -> None:
        """Ask the controller to take another law."""
        self.set_parameter('controller', 'law', law, tell)

    def set_parameter(self, node: str, key: str, value: Any, tell: Tell) -> None:
        """Ask a node to change a parameter."""
        self.ask(f'{node}/set_parameters', tell, parameters=messages_of({key: value}))

    def emergency_stop(self, tell: Tell) -> None:
        """Ask the controller for its safe action."""
        self.ask('controller/emergency_stop', tell)

    def clear_fault(self, tell: Tell) -> None:
        """Ask the controller to end its safe action."""
        self.ask('controller/clear_fault', tell)

    def ask(self, name: str, tell: Tell, **fields: Any) -> None:
        """Ask a service of the watched robot; its answer is shown when it has come."""
        service = f'{self._namespace}/{name}'
        if service in self._services and self._services.ready(service):
            future = self._services.send(service, **fields)
            self._asked[future] = (time.monotonic() + ANSWER_TIMEOUT, tell)
        else:
            tell(False, f'there is no {name.partition("/")[0]}')

    def _listen(self, topic: Topic, take: Callable[[bytes], None]) -> None:
        qos = QoSProfile(depth=self.DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        if topic.latched:
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        subscription = self._node.create_subscription(
            message_class(topic.type), topic.name, take, qos, raw=True
        )
        self._subscriptions.append((subscription, take))

    def _on_diagnostics(self, data: bytes) -> None:
        for status in _statuses(data):
            self._robots.report(
                time.monotonic(),
                status.name,
                status.hardware_id,
                int.from_bytes(status.level, 'little'),
                status.message,
                reported(status),
            )

    def _on_status(self, data: bytes) -> None:
        for status in _statuses(data):
            self._robots[self._namespace].status(reported(status))

    def _keep_state(self, data: bytes) -> None:
        self._state = data

    def _on_pose(self, take: Callable[..., None], data: bytes) -> None:
        records = self._pose.decode(data)
        if records is not None:
            stamp = int(cdr.stamps_of(records)[0])
            robot = self._robots[self._namespace]
            take(robot, stamp, *(float(records[axis][0]) for axis in 'xyz'))


def _statuses(data: bytes) -> list[Any]:
    try:
        return list(deserialize_message(data, DiagnosticArray).status)
    except Exception:  # rmw raises a bare RuntimeError or MemoryError on broken bytes
        return []


def _outcome(answer: Any) -> tuple[bool, str]:
    """Whether a node did what it was asked for, and its message."""
    if hasattr(answer, 'results'):  # of parameters that were to be set
        done = any(result.successful for result in answer.results)
        text = ', '.join(result.reason for result in answer.results)
    else:
        done, text = bool(answer.success), str(answer.message)
    return done, text if done else f'refused: {text}'
