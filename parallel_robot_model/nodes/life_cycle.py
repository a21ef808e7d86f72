"""The life of a node's process: command line, start, executor, signals, end."""

from __future__ import annotations

import argparse
import faulthandler
import gc
import inspect
import logging
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from parallel_robot_model.common.errors import InputError, ParallelRobotError, first_line
from parallel_robot_model.common.options import Parser
from parallel_robot_model.configuration.config import PACKAGE
from parallel_robot_model.nodes import middleware
from parallel_robot_model.nodes.background import SWITCH
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_model.processes import realtime
from parallel_robot_model.processes.termination_signals import termination_signals

# The command line of a node: ROS arguments, arguments of its own, help.

AddArguments = Callable[[argparse.ArgumentParser], None]


def _read_arguments(
    node: Callable[..., Any], arguments: Sequence[str], add_arguments: AddArguments | None = None
) -> dict[str, Any]:
    """Read the command line of a node; ``--help`` is answered, and ends the process."""
    name = node.__name__.removesuffix('Node').lower()
    about = inspect.cleandoc(sys.modules[node.__module__].__doc__ or '')
    parser = Parser(
        prog=name,
        usage=None if add_arguments else '%(prog)s [-h] [--ros-args ...]',
        description=about,
        epilog=(
            'Parameters follow --ros-args; docs/parameters.md lists them with units and ranges,\n'
            f'"ros2 param describe /{name} KEY" describes them while the node runs. Example:\n\n'
            f'  ros2 run {PACKAGE} {name} {getattr(node, "example", "")}\n\n'
            f'Command line (run, analyze, ...): {PACKAGE}, else ros2 run {PACKAGE} {PACKAGE}'
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if add_arguments is not None:
        add_arguments(parser)
    try:
        own = remove_ros_args(list(arguments))
    except RuntimeError as error:  # base of all that rcl says of its arguments
        text = str(error).splitlines()[0]
        raise InputError(f'unknown ROS arguments {text}' if text[0] == '[' else text) from None
    return vars(parser.parse_args(own[1:]))


END_TIMEOUT = 8.0  # s, for the end of a node; then it is forced, with a traceback
STOP_LATENCY = 0.1  # s, longest time from a signal, or the parent's end, to that of the executor


def run_node(make: Callable[..., SuiteNode], add_arguments: AddArguments | None = None) -> int:
    """Run a node until it finishes, until a signal ends it, or if asked, until its parent ends.

    Args:
        make: Its class.
        add_arguments: Declares command-line arguments of the node; `make` gets them by name.

    Returns:
        0; 1 when the node failed; 2 when a parameter or an argument is wrong, which is reported
        in one line.
    """
    parent = os.getppid()
    stop: list[int] = []  # signals; setting an Event in a handler can deadlock with itself
    node: SuiteNode | None = None

    def on_signal(number: int, _: Any) -> None:
        stop.append(number)
        if node is None:  # perhaps for half a minute: the compiler cannot be interrupted cleanly
            os._exit(0)  # nothing has begun yet
        node.stop_timer()

    for number in termination_signals():
        signal.signal(number, on_signal)
    log_to_ros()
    sys.setswitchinterval(SWITCH)
    try:
        given = _read_arguments(make, sys.argv, add_arguments)
        transport_choice = middleware.requested_middleware(sys.argv)
        with (
            middleware.wrap_rcl_errors(),
            middleware.chosen_transport(transport_choice) as transport,
        ):
            _initialise()
            node = make(**given)
        middleware.check_middleware(node.loop.middleware, transport_choice)
    except ParallelRobotError as error:
        print(f'parallel_robot: {error}', file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    executor = EventsExecutor() if node.loop.executor == 'events' else SingleThreadedExecutor()
    try:
        executor.add_node(node)
        prepare_to_log()
        if text := realtime.discovery_warning():
            node.get_logger().warning(text)
        gc.collect()
        gc.freeze()  # little is allocated from here on: collections stay short
        wants_priority = node.loop.realtime == 'auto' and not node.loop.lockstep
        granted = realtime.acquire(node.priority if wants_priority else 0)
        node.show_granted(realtime=granted, middleware=transport)
        node.begin()
        while node.exit_code is None and not stop and rclpy.ok():
            _spin(executor, node)
            if node.loop.end_with_parent and os.getppid() != parent:
                node.get_logger().info('the process that started this node has ended')
                node.stop_timer()
                break
    except ParallelRobotError as error:
        node.fail(error)
    finally:
        _end(executor, node)
    return node.exit_code or 0


def _initialise() -> None:
    """Start rclpy without its signal handlers."""
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # base of every error that rcl raises about its arguments
        if type(error) is RCLError:  # about the environment
            raise
        raise InputError(str(error).splitlines()[0]) from None


def _spin(executor: Executor, node: SuiteNode) -> None:
    """Execute what arrives within STOP_LATENCY."""
    try:
        # A new future each time: SingleThreadedExecutor leaves a callback in it.
        executor.spin_until_future_complete(Future(), timeout_sec=STOP_LATENCY)
    except ParallelRobotError:
        raise
    except Exception as error:  # raised by rclpy itself, at something that came over the wire
        node.survive(error)


def _end(executor: Executor, node: SuiteNode) -> None:
    """Close a node and rclpy; after END_TIMEOUT the process ends in any case."""
    node.close()
    faulthandler.dump_traceback_later(END_TIMEOUT, exit=True)
    executor.remove_node(node)
    node.destroy_node()
    rclpy.try_shutdown()
    for number in termination_signals():
        # Python takes its handlers back as it exits: a second Ctrl-C would end that with an error.
        signal.signal(number, signal.SIG_IGN)
    faulthandler.cancel_dump_traceback_later()


def log_to_ros() -> None:
    """Let ROS log the records of the modules that know nothing of ROS."""
    logger = logging.getLogger('parallel_robot')
    logger.setLevel(logging.INFO)
    logger.addHandler(_ToRos())


class _ToRos(logging.Handler):
    """Hands log records of Python over to ROS."""

    def emit(self, record: logging.LogRecord) -> None:
        """Log a record with its own level; levels in between count as the next lower one."""
        severity = LoggingSeverity(min(max(record.levelno // 10, 1), 5) * 10)
        rclpy.logging.get_logger(record.name).log(record.getMessage(), severity)


def prepare_to_log() -> None:
    """Do now what the first log line would do: 20 ms, which a loop of 1 kHz cannot spare.

    rclpy asks `inspect` for the caller of each line, which at first goes through all modules.
    """
    inspect.stack()


# The life cycle of a node that the tools of ROS configure, activate and deactivate.


class Lifecycle(LifecycleNodeMixin):  # type: ignore[misc]
    """Offers the services of a managed node in the name of another node."""

    def __init__(
        self,
        node: Node,
        activate: Callable[[], str],
        deactivate: Callable[[], None],
        shut_down: Callable[[], None],
    ) -> None:
        """Begin unconfigured.

        Args:
            node: The node that is managed.
            activate: Called to make it active; says why that is refused, or nothing.
            deactivate: Called to make it inactive.
            shut_down: Called to end it, when it is inactive.
        """
        # What rclpy's mixin takes from the node that it is mixed with.
        self.handle, self._services = node.handle, node._services
        self.default_callback_group = node.default_callback_group
        self._node, self._activate, self._deactivate = node, activate, deactivate
        self._shut_down = shut_down
        self.active = False  # whether the node is active
        super().__init__()
        self._change = self._service_change_state.callback
        self._service_change_state.callback = self._on_change

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the node act, if it can."""
        try:
            reason = self._activate()
        except Exception as error:  # rclpy would hide it
            reason = first_line(error)
        if reason:
            self._node.get_logger().warning(f'not activated: {reason}')
            return TransitionCallbackReturn.FAILURE
        self.active = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the node act no more."""
        self.active = False
        self._deactivate()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node."""
        if self.active:
            self.on_deactivate(state)
        self._shut_down()
        return TransitionCallbackReturn.SUCCESS

    def _on_change(self, request: Any, response: Any) -> Any:
        """Refuse a transition that the state does not have; rclpy would end the node."""
        try:
            return self._change(request, response)
        except RCLError as error:
            self._node.get_logger().warning(first_line(error))
            response.success = False
            return response
