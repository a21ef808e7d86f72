"""What all nodes of the suite share: parameters, topics, readiness, diagnostics, life and end."""

from __future__ import annotations

import faulthandler
import functools
import gc
import inspect
import logging
import math
import os
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from std_srvs.srv import Trigger

from parallel_robot_base import config, loop, realtime
from parallel_robot_base.deadline import DeadlineThread
from parallel_robot_base.errors import InputError, ParallelRobotError, UnknownNameError, first_line
from parallel_robot_base.fields import Field, parameters
from parallel_robot_base.topics import DEPTH, QUEUE, Topic
from parallel_robot_ros import arguments, middleware
from parallel_robot_ros.message_types import message_class
from parallel_robot_ros.parameter_services import BoundedParameterService
from parallel_robot_ros.single_publisher import SinglePublisher

LAST_RESORT = 8.0  # s, for the end of a node; then it is forced, with a traceback
PATIENCE = 0.1  # s, longest time between a signal and the end of the executor
GRANTED = {'realtime': 'real-time priority', 'middleware': 'middleware'}  # in the diagnostics
START = 'start_stamp'  # the parameter that every node takes once
OF_ROS = ('use_sim_time', 'start_type_description_service')  # parameters of every node
NOT_OURS = ('qos_overrides.', 'granted.')  # groups of parameters that are no configuration


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
        node: Who listens.
        topic: Name and type.
        qos: Quality of service.
        take: Called with the message, the time of its reception [ns], and the number that its
            publisher gave it; 0: not known.
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


class SuiteNode(Node):  # type: ignore[misc]
    """A node whose parameters are keys of ``config/`` and whose end is orderly.

    Attributes:
        values: The whole configuration, as resolved from scenario and overrides.
        loop: The parameters that all nodes share.
        lockstep: Whether the plant waits for each command.
        period_ns: Period [ns].
        samples: Index of the last state of the motion; None when it has no end.
        counts: How often something unusual happened; shown in the diagnostics.
        exit_code: None while the node runs, then the code it ends with.
        priority: Real-time priority that the node should have in wall time; 0: none.
        example: What may follow its name on a command line, for its help.
    """

    priority = 0
    example = '--ros-args -p scenario:=paper_line'

    def __init__(self, name: str, groups: Mapping[str, Any]) -> None:
        """Resolve the configuration and declare the node's parameters.

        Args:
            name: Name of the node.
            groups: Prefix to NamedTuple of the parameters that the node uses.

        Raises:
            InputError: a parameter is unknown or wrong.
        """
        try:
            super().__init__(
                name,
                automatically_declare_parameters_from_overrides=True,
                start_parameter_services=False,
            )
        except ValueError as error:  # an empty list has no type in ROS
            raise InputError(f'a parameter has no usable value: {error}') from None
        self.exit_code: int | None = None
        self.counts: Counter[str] = Counter()
        self._granted: dict[str, str] = {}
        self._outputs: list[Publisher] = []
        self._inputs: dict[Topic, Subscription] = {}
        self._thread: DeadlineThread | None = None
        self._heard = False  # whether the essential outputs have had their subscribers
        self._started_at: int | None = None
        self._used = _Use(time.monotonic(), time.process_time(), 0)
        given = {
            key: _plain(parameter.value)
            for key, parameter in self.get_parameters_by_prefix('').items()
            if _is_ours(key)
        }
        scenario = given.pop('scenario', 'paper_circle')
        self.values = config.resolve(str(scenario), given)
        self.loop = loop.validate(config.group(self.values, loop.LoopParameters, ''))
        self.lockstep = self.loop.lockstep
        self.period_ns, self.samples = self.loop.period_ns, self.loop.samples
        for prefix, group in {'': loop.LoopParameters, **groups}.items():
            self.declare_group(prefix, group)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(1.0, self._publish_diagnostics)
        self.create_service(Trigger, '~/ready', self._answer_ready)
        self._parameter_service = BoundedParameterService(self)

    def create_subscription(
        self, kind: Any, topic: str, callback: Any, *words: Any, **options: Any
    ) -> Subscription:
        """Subscribe as any node does, guarded."""
        return super().create_subscription(kind, topic, self._guarded(callback), *words, **options)

    def create_service(
        self, kind: Any, name: str, callback: Any, *words: Any, **options: Any
    ) -> Service:
        """Offer a service as any node does, guarded."""
        return super().create_service(kind, name, self._guarded(callback), *words, **options)

    def create_timer(self, period: float, callback: Any, *words: Any, **options: Any) -> Timer:
        """Make a timer as any node does, guarded."""
        return super().create_timer(period, self._guarded(callback), *words, **options)

    def _guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """A callback that cannot end the node, but for the errors that the suite means."""

        @functools.wraps(callback)
        def guarded(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except ParallelRobotError as error:
                self.fail(error)
            except Exception as error:
                self.survive(error)
            return arguments[-1] if arguments else None  # the response, as it was

        return guarded

    def publisher(self, topic: Topic, essential: bool = True) -> Publisher:
        """Create a publisher; the node is ready when essential ones have their subscribers."""
        publisher = self.create_publisher(message_class(topic.type), topic.name, qos_of(topic))
        if essential:
            self._outputs.append(publisher)
        return publisher

    def subscribe(
        self, topic: Topic, callback: Callable[[bytes], None], complete: bool = True
    ) -> None:
        """Subscribe to the serialised messages of a topic; those of a mixture are left out.

        In lockstep none is left out, for nobody would go on; there, stamps tell a mixture. But
        nothing is taken before somebody hears the answer: the plant asks again.

        Args:
            topic: Name and type.
            callback: Called with each message.
            complete: Whether every message is wanted, even late (always in lockstep). Else only
                the newest counts: it is not held up by older ones that wait, nor by a node that
                was killed and has not acknowledged.
        """
        if self.lockstep:

            def take(data: bytes) -> None:
                self._heard = self._heard or not self._unheard()
                if self._heard:
                    callback(data)

            self._inputs[topic] = self.create_subscription(
                message_class(topic.type), topic.name, take, QoSProfile(depth=QUEUE), raw=True
            )
            return
        mixed = SinglePublisher().mixed

        def take_of_one(data: bytes, _: int, number: int) -> None:
            if mixed(number):
                self.counts[f'{topic.name}: messages of two publishers'] += 1
                self.leave_out(topic)
            else:
                callback(data)

        qos = QoSProfile(depth=QUEUE)
        if not complete:
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._inputs[topic] = listen(self, topic, qos, take_of_one)

    def leave_out(self, topic: Topic) -> None:
        """React to a message that is left out because a topic has several publishers."""

    def missing(self) -> str:
        """What the node still waits for; empty when it is ready."""
        for topic, subscription in self._inputs.items():
            if not subscription.get_publisher_count():
                return f'no publisher of {topic.name}'
        return self._unheard()

    def _unheard(self) -> str:
        for publisher in self._outputs:
            count = publisher.get_subscription_count()
            if count < self.loop.subscribers:
                return f'{publisher.topic_name} has {count} of {self.loop.subscribers} subscribers'
        return ''

    def set_start(self, stamp: int) -> None:
        """React to the common start stamp [ns]; nodes without a start of their own ignore it."""

    def diagnose(self) -> dict[str, Any]:
        """Key figures of the last second for the diagnostics."""
        return {}

    def handled(self) -> int | None:
        """Samples that the node has handled; None where it has no rhythm."""
        return None

    def alarm(self) -> str:
        """What is wrong enough to be an error in the diagnostics; mostly nothing."""
        return ''

    def keep_time(self, tick: Callable[[int], None], ahead: int = 0) -> None:
        """Call ``tick(stamp)`` for the stamp of each sample [ns], once the node has begun.

        Args:
            tick: What to do; an exception ends the node.
            ahead: How long before its stamp a tick is due [ns].
        """
        self._thread = DeadlineThread(self.period_ns, tick, self.fail, ahead)

    def begin(self) -> None:
        """Start what keeps time; nothing slow is to come any more."""
        if self._thread is not None:
            self._thread.start()

    def close(self) -> None:
        """Release what the node holds, before its publishers go."""

    def destroy_node(self) -> None:
        """Stop what keeps time, then destroy the node."""
        if self._thread is not None:
            self._thread.stop()
        super().destroy_node()

    def show_granted(self, **texts: str) -> None:
        """Show what the system granted, in the diagnostics and as parameters, for bags."""
        for key, text in texts.items():
            self._granted[GRANTED[key]] = text
            name = f'granted.{key}'
            if self.has_parameter(name):  # from the parameters of another run
                self.undeclare_parameter(name)
            descriptor = ParameterDescriptor(description=GRANTED[key], read_only=True)
            self.declare_parameter(name, text, descriptor, ignore_override=True)

    def finish(self, code: int = 0) -> None:
        """End the node with an exit code; may be called from any thread."""
        if self.exit_code is None:
            self.exit_code = code

    def fail(self, error: Exception) -> None:
        """End the node for an error; may be called from any thread."""
        self.get_logger().fatal(str(error) or type(error).__name__)
        self.finish(1)

    def survive(self, error: Exception) -> None:
        """Count and tell an error that nobody foresaw; nothing on the wire may end a node."""
        self.counts['unforeseen errors'] += 1
        frame = traceback.extract_tb(error.__traceback__)[-1]
        text = f'unforeseen {first_line(error)} at {frame.filename}:{frame.lineno}'
        self.get_logger().error(text, throttle_duration_sec=1.0)

    def declare_group(self, prefix: str, group: Any) -> None:
        """Declare the parameters of a group with unit, meaning and range.

        Raises:
            InputError: a value is wrong.
        """
        values = config.group(self.values, group, prefix)
        for parameter, value in zip(parameters(group), values, strict=True):
            key = f'{prefix}.{parameter.key}' if prefix else parameter.key
            if self.has_parameter(key):
                self.undeclare_parameter(key)  # it may be an integer where a float is meant
            plain = list(value) if isinstance(value, tuple) else value
            descriptor = describe(parameter.field, plain)
            descriptor.read_only = not self.is_settable(key)
            self.declare_parameter(key, plain, descriptor, ignore_override=True)

    def is_settable(self, key: str) -> bool:
        """Whether a parameter can change while the node runs."""
        return key == START

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters together: all are good, or none is set."""
        parameter_list = [p for p in parameter_list if not self._is_as_fixed(p)]
        others = [p for p in parameter_list if not _is_ours(p.name) and self.has_parameter(p.name)]
        changes = {p.name: _plain(p.value) for p in parameter_list if p not in others}
        try:
            changes, effect = self.judge(changes) if changes else ({}, lambda: None)
        except ParallelRobotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        changed = [Parameter(key, value=value) for key, value in changes.items()]
        if not others and not changed:
            return SetParametersResult(successful=True)
        result = super().set_parameters_atomically(others + changed)
        if result.successful:
            effect()
        return result

    def _is_as_fixed(self, parameter: Parameter) -> bool:
        """Whether a parameter that cannot change any more is to have the value that it has."""
        name = parameter.name
        if not self.has_parameter(name):
            return False
        if name != START and not self.describe_parameter(name).read_only:
            return False
        return bool(_plain(self.get_parameter(name).value) == _plain(parameter.value))

    def judge(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Look whether changes of parameters are good.

        Args:
            changes: Key to value, of parameters of the suite.

        Returns:
            Key to value as they will be stored, and what to call once they are.

        Raises:
            InputError: a change is refused; none of them is made.
        """
        for key in changes:
            if key not in self.values:
                raise UnknownNameError('parameter', key, self.values)
            if key != START:
                raise InputError(f'{key} is fixed at the start of the node')
        stamp = changes[START]
        if stamp != self._started_at:  # else the request was sent twice
            self._check_start(stamp)
        return changes, lambda: self._pass_on_start(stamp)

    def _check_start(self, stamp: Any) -> None:
        if self.loop.start_stamp != loop.WAIT or self._started_at is not None:
            raise InputError('the node does not wait for a start')
        if not isinstance(stamp, int) or stamp <= 0 or stamp % self.period_ns:
            raise InputError(
                f'start_stamp must be a whole multiple of the period in ns, not {stamp!r}'
            )
        if not self.lockstep and stamp <= time.time_ns():
            raise InputError(f'start_stamp {stamp} lies in the past')

    def _pass_on_start(self, stamp: int) -> None:
        """Pass a new start stamp on, once."""
        if stamp == self._started_at:
            return
        self._started_at = stamp
        try:
            self.set_start(stamp)
        except ParallelRobotError as error:
            self.fail(error)

    def _answer_ready(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = self.missing()
        response.success = not response.message
        return response

    def _publish_diagnostics(self) -> None:
        figures = {**self.diagnose(), **self._use(), **self._granted, **self.counts}
        for topic, subscription in self._inputs.items():
            count = subscription.get_publisher_count()
            if count > 1:
                figures[f'{topic.name}: publishers'] = count
        alarm = self.alarm()
        warnings = [key for key in figures if key in self.counts or key.endswith(': publishers')]
        level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if alarm else level,
            name=f'{self.get_name()}: loop',
            message=alarm or ', '.join(warnings) or 'ok',
            hardware_id=self.get_fully_qualified_name(),
            values=[KeyValue(key=key, value=str(value)) for key, value in figures.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _use(self) -> dict[str, str]:
        """Rate of the node and its share of a processor since the last call."""
        handled, before = self.handled(), self._used
        self._used = _Use(time.monotonic(), time.process_time(), handled or 0)
        seconds, busy, count = (new - old for new, old in zip(self._used, before, strict=True))
        rate = {} if handled is None else {'rate [Hz]': f'{count / seconds:.1f}'}
        return rate | {'processor [%]': f'{100.0 * busy / seconds:.1f}'}


class _Use(NamedTuple):
    """What a node has used and done until a time [s]: processor time [s], samples."""

    time: float
    processor: float
    samples: int


def describe(field: Field, value: Any) -> ParameterDescriptor:
    """Description of a parameter whose value may be `value`."""
    text = field.description + (f' [{field.unit}]' if field.unit else '')
    descriptor = ParameterDescriptor(
        description=text, dynamic_typing=isinstance(value, list) and not value
    )
    if isinstance(value, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(field.low), to_value=float(field.high))
        ]
    elif isinstance(value, int) and not isinstance(value, bool) and field.low > -math.inf:
        high = min(field.high, 2**63 - 1)
        descriptor.integer_range = [
            IntegerRange(from_value=int(field.low), to_value=int(high), step=1)
        ]
    return descriptor


def run_node(
    make: Callable[..., SuiteNode], add_arguments: arguments.AddArguments | None = None
) -> int:
    """Run a node to its end: Ctrl-C, SIGTERM, or its own.

    Args:
        make: Its class.
        add_arguments: Declares words of its own on the command line; `make` gets them by name.

    Returns:
        0; 1 when the node failed; 2 when a parameter or a word is wrong, after one line that says
        so.
    """
    stop: list[int] = []  # not an Event: setting it in a handler that interrupts itself deadlocks
    making = True

    def heed(number: int, _: Any) -> None:
        stop.append(number)
        if making:  # perhaps for half a minute: a compiler cannot be interrupted in order
            os._exit(0)  # nothing is begun yet

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, heed)
    logger = logging.getLogger('parallel_robot')  # of what knows nothing of ROS
    logger.setLevel(logging.INFO)
    logger.addHandler(_ToRos())
    try:
        words = arguments.read(make, sys.argv, add_arguments)
        transport_choice = middleware.asked(sys.argv)
        with middleware.transport(transport_choice) as transport:
            _initialise()
            node = make(**words)
        making = False
        middleware.check(node.loop.middleware, transport_choice)
    except ParallelRobotError as error:
        print(f'parallel_robot: {error}', file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    executor = EventsExecutor() if node.loop.executor == 'events' else SingleThreadedExecutor()
    try:
        executor.add_node(node)
        prepare_to_log()
        gc.collect()
        gc.freeze()  # what lives from here on is small: collections stay short
        asks = node.loop.realtime == 'auto' and not node.loop.lockstep
        granted = realtime.acquire(node.priority if asks else 0)
        node.show_granted(realtime=granted, middleware=transport)
        node.begin()
        while node.exit_code is None and not stop and rclpy.ok():
            try:
                # A new one each time: SingleThreadedExecutor leaves a callback in it.
                executor.spin_until_future_complete(Future(), timeout_sec=PATIENCE)
            except ParallelRobotError:
                raise
            except Exception as error:  # of rclpy's own, at something that came over the wire
                node.survive(error)
    except ParallelRobotError as error:
        node.fail(error)
    finally:
        node.close()
        faulthandler.dump_traceback_later(LAST_RESORT, exit=True)
        executor.remove_node(node)
        node.destroy_node()
        rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
    return node.exit_code or 0


class _ToRos(logging.Handler):
    """Hands log records of Python over to ROS."""

    def emit(self, record: logging.LogRecord) -> None:
        """Log as ROS does."""
        rclpy.logging.get_logger(record.name).info(record.getMessage())


def prepare_to_log() -> None:
    """Do what the first line of a log would do, for which a loop of 1 kHz has no time: 20 ms.

    rclpy asks `inspect` for the caller of each line, which at first goes through all modules.
    """
    inspect.stack()


def _initialise() -> None:
    """Start rclpy without its signal handlers.

    Raises:
        InputError: the ROS arguments of the command line are wrong.
    """
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # base of all that rcl says of its arguments
        raise InputError(str(error).splitlines()[0]) from None


def _is_ours(name: str) -> bool:
    """Whether a parameter is of the configuration, as far as its name says."""
    return name not in OF_ROS and not name.startswith(NOT_OURS)


def _plain(value: Any) -> Any:
    """Value of a parameter; its arrays as lists."""
    return list(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value
