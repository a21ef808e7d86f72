"""The supervisor's own node: asks whether the nodes of a run are ready, and starts them."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from parallel_robot_model.common.errors import RunError, printable
from parallel_robot_model.configuration.plain_data import whole_number
from parallel_robot_model.messages.topics import OUTPUTS
from parallel_robot_model.nodes.background import OUTSIDE, STATE_INDEX
from parallel_robot_model.nodes.middleware import tool_node
from parallel_robot_model.processes.node_processes import Work

ANSWER_TIMEOUT = 0.2  # s, for a question that can be asked again
START_TIMEOUT = 60.0  # s, for the answer to a start
CHECK_INTERVAL = 2.0  # s, between two checks how busy the nodes are
BUSY = 0.05  # share of a core; waiting for messages takes less
SILENT = 'it does not answer'


class Session:
    """Talks to the nodes of a run; use as a context manager.

    Attributes:
        state: Index of the last state that the plant reported, -1 before the first report.
        driven_out: Whether the plant reported that the robot was driven out of its workspace.
        alarms: What each node last reported as wrong; empty for nothing.
    """

    def __init__(
        self,
        nodes: Iterable[str],
        watch: Callable[[], None],
        namespace: str = '',
        middleware: str = 'udp',
    ) -> None:
        """Prepare.

        Args:
            nodes: Names of the nodes.
            watch: Called again and again while waiting; raises to give up.
            namespace: Full name of the namespace of the nodes; empty for none.
            middleware: The parameter of that name.
        """
        self._watch = watch
        self._names = list(nodes)
        self._namespace = namespace
        self._transport = middleware
        self._exit = ExitStack()
        self.state = -1
        self.driven_out = False
        self.alarms = dict.fromkeys(self._names, '')

    def __enter__(self) -> Session:
        """Create the node."""
        node = tool_node('parallel_robot_run', self._transport, namespace=self._namespace)
        self._node = self._exit.enter_context(node)
        self._ready = {
            name: self._node.create_client(Trigger, f'{name}/ready') for name in self._names
        }
        self._set = {
            name: self._node.create_client(SetParameters, f'{name}/set_parameters')
            for name in self._names
        }
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self.take_diagnostics, 10)
        return self

    def __exit__(self, *_: object) -> None:
        """Destroy the node."""
        self._exit.close()

    def spin(self, seconds: float) -> None:
        """Process what arrives within a time [s], then call `watch`."""
        rclpy.spin_once(self._node, timeout_sec=seconds)
        self._watch()

    def wait_until_ready(
        self, seconds: float, work: Callable[[str], Work], show: Callable[[Collection[str]], None]
    ) -> None:
        """Wait until every node says that it is ready.

        A node whose service is there, that does not answer yet and that works, is compiling: it
        has all the time it needs. Time in which others have the processors does not count.

        Args:
            seconds: How long to wait while no such node is busy [s].
            work: What a node has done.
            show: Called with the names of those that are not ready, again and again.

        Raises:
            RunError: one is not ready in time, or another suite runs on the same ROS domain.
        """
        waiting = dict.fromkeys(self._names, SILENT)
        done = {name: work(name) for name in self._names}
        deadline = looked = time.monotonic()
        deadline += seconds
        while waiting:
            seen: dict[str, bool] = {}  # of those that do not answer, whether they are there
            for name in list(waiting):
                show(waiting)
                answer = self._call(self._ready[name], Trigger.Request())
                if answer is not None and answer.success:
                    del waiting[name]
                elif answer is not None:
                    waiting[name] = answer.message
                else:
                    seen[name] = self._ready[name].service_is_ready()
            now = time.monotonic()
            if now - looked > CHECK_INTERVAL:
                new = {name: work(name) for name in waiting}
                ran = {name: new[name].ran - done[name].ran for name in seen}
                held = {name: new[name].waited - done[name].waited for name in seen}
                enough = BUSY * (now - looked)
                if any(ran[name] + held[name] > enough for name in seen if seen[name]):
                    deadline = now + seconds
                else:
                    deadline += min(max(held.values(), default=0.0), now - looked)
                looked, done = now, new
            if waiting and now > deadline:
                silent = {name: says for name, says in waiting.items() if says == SILENT}
                name, reason = next(iter((silent or waiting).items()))  # others wait for it
                raise RunError(f'{name} is not ready after {seconds:g} s: {reason}')
        for topic in OUTPUTS.values():
            count = self._node.count_publishers(topic.name)
            if count > 1:
                raise RunError(
                    f'{topic.name} has {count} publishers: another suite runs on this ROS domain; '
                    'set ROS_DOMAIN_ID to a number of your own or choose another --namespace'
                )

    def silent(self, names: Iterable[str]) -> list[str]:
        """Those of some nodes that do not answer."""
        return [
            name
            for name in names
            if not self._call(self._ready[name], Trigger.Request(), CHECK_INTERVAL)
        ]

    def start(self, name: str, stamp: int) -> None:
        """Give a node the stamp of t = 0 [ns].

        Raises:
            RunError: the node does not take it.
        """
        parameter = Parameter('start_stamp', Parameter.Type.INTEGER, stamp).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        answer = self._call(self._set[name], request, START_TIMEOUT)
        result = answer.results[0] if answer and answer.results else None
        if result is None or not result.successful:
            reason = result.reason if result else SILENT
            raise RunError(f'{name} does not start: {reason}')

    def trigger(self, service: str) -> str:
        """Call a service without arguments, as ``'controller/clear_fault'``; returns its answer.

        Raises:
            RunError: it does not answer.
        """
        client = self._node.create_client(Trigger, service)
        try:
            answer = self._call(client, Trigger.Request(), START_TIMEOUT)
        finally:
            self._node.destroy_client(client)
        if answer is None:
            raise RunError(f'{service}: {SILENT}')
        return str(answer.message)

    def _call(self, client: Any, request: Any, seconds: float = ANSWER_TIMEOUT) -> Any:
        """Answer of a service, None when there is none in time."""
        self._watch()
        if not client.wait_for_service(ANSWER_TIMEOUT):
            return None
        future = client.call_async(request)
        deadline = time.monotonic() + seconds
        while not future.done() and time.monotonic() < deadline:
            rclpy.spin_until_future_complete(self._node, future, timeout_sec=ANSWER_TIMEOUT)
            self._watch()
        return future.result() if future.done() else None

    def take_diagnostics(self, message: DiagnosticArray) -> None:
        """Take progress and alarms from diagnostics, which are of any node of the domain."""
        for status in message.status:
            space, _, name = status.hardware_id.rpartition('/')
            if space != self._namespace:
                continue
            if name in self.alarms:
                failed = status.level == DiagnosticStatus.ERROR
                self.alarms[name] = printable(status.message) if failed else ''
            if name == 'plant':
                values = {item.key: item.value for item in status.values}
                index = whole_number(values.get(STATE_INDEX, ''))
                self.state = self.state if index is None else index
                self.driven_out |= values.get(OUTSIDE) == str(True)
