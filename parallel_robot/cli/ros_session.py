"""The supervisor's own node: asks whether the nodes of a run are ready, and starts them."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node

from parallel_robot_model.common.errors import InputError, RunError, printable
from parallel_robot_model.configuration.plain_data import whole_number
from parallel_robot_model.messages.topics import OUTPUTS
from parallel_robot_model.nodes.background import OUTSIDE, STATE_INDEX
from parallel_robot_model.nodes.middleware import tool_node
from parallel_robot_model.nodes.ros_client import (
    OF_PARAMETERS,
    Services,
    messages_of,
    reported,
    values_of,
)
from parallel_robot_model.processes import realtime
from parallel_robot_model.processes.node_processes import Work

ANSWER_TIMEOUT = 0.2  # s, for a question that can be asked again
START_TIMEOUT = 60.0  # s, for the answer to a start
CHECK_INTERVAL = 2.0  # s, between two checks how busy the nodes are
BUSY = 0.05  # share of a core; waiting for messages takes less
SILENT = 'it does not answer'


class Session:
    """Talks to the nodes of a run; use as a context manager."""

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
        # index of the last state that the plant reported, -1 before the first report
        self.state = -1
        # whether the plant reported that the robot was driven out of its workspace
        self.driven_out = False
        # what each node last reported as wrong; empty for nothing
        self.alarms = dict.fromkeys(self._names, '')

    def __enter__(self) -> Session:
        node = tool_node('parallel_robot_run', self._transport, namespace=self._namespace)
        self._node = self._exit.enter_context(node)
        self._services = Services(self._node)
        asked = 'ready', 'set_parameters'
        self._services.ready(*(f'{name}/{each}' for name in self._names for each in asked))
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self.take_diagnostics, 10)
        return self

    def __exit__(self, *_: object) -> None:
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
                answer = self._call(f'{name}/ready')
                if answer is not None and answer.success:
                    del waiting[name]
                elif answer is not None:
                    waiting[name] = answer.message
                else:
                    seen[name] = self._services.ready(f'{name}/ready')
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
        return [name for name in names if not self._call(f'{name}/ready', CHECK_INTERVAL)]

    def start(self, name: str, stamp: int) -> None:
        """Give a node the stamp of t = 0 [ns].

        Raises:
            RunError: the node does not take it.
        """
        given = messages_of({'start_stamp': stamp})
        answer = self._call(f'{name}/set_parameters', START_TIMEOUT, parameters=given)
        result = answer.results[0] if answer and answer.results else None
        if result is None or not result.successful:
            reason = result.reason if result else SILENT
            raise RunError(f'{name} does not start: {reason}')

    def trigger(self, service: str) -> str:
        """Call a service without arguments, as ``'controller/clear_fault'``; returns its answer.

        Raises:
            RunError: it does not answer.
        """
        answer = self._call(service, START_TIMEOUT)
        if answer is None:
            raise RunError(f'{service}: {SILENT}')
        return str(answer.message)

    def _call(self, service: str, seconds: float = ANSWER_TIMEOUT, **fields: Any) -> Any:
        """Answer of a service, None when there is none in time."""
        return self._services.call(service, ANSWER_TIMEOUT, seconds, self._watch, **fields)

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
                values = reported(status)
                index = whole_number(values.get(STATE_INDEX, ''))
                self.state = self.state if index is None else index
                self.driven_out |= values.get(OUTSIDE) == str(True)


# Another node, asked for its parameters and services by name; for users without ROS tools.

HEARD = 5.0  # s, in which a node must be heard
POLL = 0.05  # s, between two looks
ANSWERED = 10.0  # s, in which it must answer
NOT_SET = ParameterType.PARAMETER_NOT_SET
TRIGGER = 'std_srvs/srv/Trigger'
DOUBLES = (ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_DOUBLE_ARRAY)


class Remote:
    """Asks one node; made by :func:`remote`."""

    def __init__(self, own: Node, name: str) -> None:
        """Prepare; `own` asks the node of that full name."""
        self._own, self.name = own, name
        self._clients = Services(own)

    def names(self) -> list[str]:
        """Names of its parameters, in order."""
        return sorted(self._ask('list_parameters').result.names)

    def values(self, names: Iterable[str]) -> dict[str, Any]:
        """Some of its parameters by name.

        Raises:
            InputError: it has none of a name.
        """
        asked = list(names)
        answer = self._ask('get_parameters', names=asked)
        if len(answer.values) != len(asked) or any(one.type == NOT_SET for one in answer.values):
            missing = sorted(set(asked) - set(self.names()))
            raise InputError(f'{self.name} has no parameter {", ".join(missing)}')
        return values_of(asked, answer)

    def set(self, values: Mapping[str, Any]) -> None:
        """Set several of its parameters, all or none; whole numbers become what it has.

        Raises:
            InputError: the node refuses them.
        """
        types = self._ask('get_parameter_types', names=list(values)).types
        if len(types) != len(values):  # it does not know all names, and says so when they are set
            types = [NOT_SET] * len(values)
        typed = [
            _message(name, _as_doubles(value) if kind in DOUBLES else value)
            for (name, value), kind in zip(values.items(), types, strict=True)
        ]
        result = self._ask('set_parameters_atomically', parameters=typed).result
        if not result.successful:
            raise InputError(f'{self.name} refuses: {result.reason}')

    def call(self, service: str) -> tuple[bool, str]:
        """Ask one of its services without arguments: whether it did so, and what it says.

        Raises:
            InputError: it has no such service, or one of another type.
        """
        deadline = time.monotonic() + HEARD
        while service not in (own := self._services()) and time.monotonic() < deadline:
            rclpy.spin_once(self._own, timeout_sec=POLL)  # it may be heard after its node
        if service not in own:
            known = ', '.join(name for name, kind in sorted(own.items()) if kind == TRIGGER)
            raise InputError(f'{self.name} has no service {service}; without arguments: {known}')
        if own[service] != TRIGGER:
            raise InputError(f'{self.name}/{service} is of {own[service]}, not {TRIGGER}')
        answer = self._ask(service)
        return bool(answer.success), str(answer.message)

    def _services(self) -> dict[str, str]:
        """Types of the services whose names begin with that of the node, by the rest."""
        head = f'{self.name}/'
        every = self._own.get_service_names_and_types()
        return {name[len(head) :]: kind for name, (kind, *_) in every if name.startswith(head)}

    def _ask(self, service: str, **fields: Any) -> Any:
        name, asks = f'{self.name}/{service}', service in OF_PARAMETERS
        if not self._clients[name].wait_for_service(HEARD):
            said = (
                f'{self.name} does not answer for its parameters'
                if asks
                else f'{name} is not heard'
            )
            raise RunError(said)
        answer = self._clients.call(name, HEARD, ANSWERED, **fields)
        if answer is None:
            raise RunError(f'{self.name} does not answer within {ANSWERED:g} s')
        return answer


@contextmanager
def remote(name: str) -> Iterator[Remote]:
    """Find a node.

    Args:
        name: Its name, with its namespace if it has one.

    Raises:
        RunError: it is not heard; those that are, are named.
    """
    full = f'/{name.strip("/")}'
    realtime.prepare_discovery()
    with tool_node('parallel_robot_param', enable_rosout=False) as own:
        deadline = time.monotonic() + HEARD
        while full not in (heard := _heard(own)):
            if time.monotonic() > deadline:
                others = ', '.join(heard) or 'none'
                raise RunError(f'no node {full} is heard; those that are: {others}')
            rclpy.spin_once(own, timeout_sec=POLL)
        yield Remote(own, full)


def _heard(own: Node) -> list[str]:
    places = own.get_node_names_and_namespaces()
    names = {f'{space.rstrip("/")}/{name}' for name, space in places}
    return sorted(names - {own.get_fully_qualified_name()})


def _message(name: str, value: Any) -> Any:
    """A parameter of ROS."""
    items = value if isinstance(value, list) else [value]
    try:
        if any(isinstance(item, int) and item.bit_length() > 63 for item in items):
            raise TypeError
        return messages_of({name: value})[0]
    except TypeError:
        shown = printable(repr(value))
        raise InputError(
            f'{name} cannot be {shown}: a parameter of ROS is a number of 64 bits, a text, true '
            'or false, or a list of one of these'
        ) from None


def _as_doubles(value: Any) -> Any:
    """Whole numbers as floating-point ones, alone or in a list."""
    if isinstance(value, list):
        return [_as_doubles(item) for item in value]
    return float(value) if type(value) is int else value
