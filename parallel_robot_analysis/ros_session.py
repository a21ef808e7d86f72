"""The supervisor's own node: asks whether the others are ready, and gives them their start."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable
from types import TracebackType
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from parallel_robot_bags.plain_data import whole_number
from parallel_robot_base.errors import DRIVEN_OUT, RunError
from parallel_robot_base.topics import COMMANDS, JOINT_STATES, REFERENCE
from parallel_robot_ros import middleware

PATIENCE = 0.2  # s, for the answer to a question that can be asked again
LOOK = 2.0  # s, between two looks at how busy the nodes are
BUSY = 0.05  # share of a core; waiting for messages takes less
START_PATIENCE = 10.0  # s, for the answer to a start
SILENT = 'it does not answer'
PLANT = 'plant: loop'  # end of the name of the plant's status, which may be in a namespace


class Session:
    """Talks to the nodes of a run; use as a context manager.

    Attributes:
        state: Last state that the plant reported, -1 before the first report.
        driven_out: Whether the plant reported that the robot was driven out of its workspace.
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
        self._middleware = middleware
        self._watch = watch
        self._names = list(nodes)
        self._namespace = namespace
        self.state = -1
        self.driven_out = False

    def __enter__(self) -> Session:
        """Create the node."""
        with middleware.transport(self._middleware):
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            self._node = rclpy.create_node('parallel_robot_run', namespace=self._namespace)
        self._ready = {
            name: self._node.create_client(Trigger, f'{name}/ready') for name in self._names
        }
        self._set = {
            name: self._node.create_client(SetParameters, f'{name}/set_parameters')
            for name in self._names
        }
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Destroy the node."""
        self._node.destroy_node()
        rclpy.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Process what arrives within a time, then look after the run."""
        rclpy.spin_once(self._node, timeout_sec=seconds)
        self._watch()

    def wait_until_ready(
        self, seconds: float, work: Callable[[str], float], show: Callable[[Collection[str]], None]
    ) -> None:
        """Wait until every node says that it is ready.

        A node that is there, does not answer yet and uses its processor has the time it needs: it
        compiles.

        Args:
            seconds: How long to wait for nodes that do nothing.
            work: Processor time that a node has used [s].
            show: Called with the names of those that are not ready, again and again.

        Raises:
            RunError: one is not ready in time, or another suite runs on the same ROS domain.
        """
        waiting = dict.fromkeys(self._names, SILENT)
        used = dict.fromkeys(self._names, 0.0)
        deadline = looked = time.monotonic()
        deadline += seconds
        while waiting:
            busy = set()
            for name in list(waiting):
                show(waiting)
                answer = self._call(self._ready[name], Trigger.Request())
                if answer is not None and answer.success:
                    del waiting[name]
                elif answer is not None:
                    waiting[name] = answer.message
                elif self._ready[name].service_is_ready():
                    busy.add(name)
            now = time.monotonic()
            if now - looked > LOOK:
                enough = BUSY * (now - looked)
                if any(work(name) - used[name] > enough for name in busy):
                    deadline = now + seconds
                looked, used = now, {name: work(name) for name in waiting}
            if waiting and now > deadline:
                silent = {name: says for name, says in waiting.items() if says == SILENT}
                name, reason = next(iter((silent or waiting).items()))  # others wait for it
                raise RunError(f'{name} is not ready after {seconds:g} s: {reason}')
        for topic in (JOINT_STATES, REFERENCE, COMMANDS):
            count = self._node.count_publishers(topic.name)
            if count > 1:
                raise RunError(
                    f'{topic.name} has {count} publishers: another suite runs on this ROS domain; '
                    'set ROS_DOMAIN_ID to a number of your own or choose another --namespace'
                )

    def silent(self, names: Iterable[str]) -> list[str]:
        """Those of some nodes that do not answer."""
        return [
            name for name in names if not self._call(self._ready[name], Trigger.Request(), LOOK)
        ]

    def start(self, name: str, stamp: int) -> None:
        """Give a node the stamp of t = 0 [ns].

        Raises:
            RunError: the node does not take it.
        """
        parameter = Parameter('start_stamp', Parameter.Type.INTEGER, stamp).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        answer = self._call(self._set[name], request, START_PATIENCE)
        result = answer.results[0] if answer and answer.results else None
        if result is None or not result.successful:
            reason = result.reason if result else SILENT
            raise RunError(f'{name} does not start: {reason}')

    def _call(self, client: Any, request: Any, seconds: float = PATIENCE) -> Any:
        """Answer of a service, None when there is none in time."""
        self._watch()
        if not client.wait_for_service(PATIENCE):
            return None
        future = client.call_async(request)
        deadline = time.monotonic() + seconds
        while not future.done() and time.monotonic() < deadline:
            rclpy.spin_until_future_complete(self._node, future, timeout_sec=PATIENCE)
            self._watch()
        return future.result() if future.done() else None

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:  # of all nodes of the domain
            if status.hardware_id != f'{self._namespace}/plant':
                continue
            alarm = status.level == DiagnosticStatus.ERROR and status.name.endswith(PLANT)
            self.driven_out |= alarm and status.message.startswith(DRIVEN_OUT)
            for item in status.values:
                if item.key == 'state':
                    self.state = whole_number(item.value) or self.state
