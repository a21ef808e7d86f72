"""The base of all nodes: configuration as parameters, topics, readiness, diagnostics."""

from __future__ import annotations

import functools
import math
import time
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Set
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from std_srvs.srv import Trigger

from parallel_robot_model.common.errors import (
    InputError,
    ParallelRobotError,
    UnknownNameError,
    first_line,
    redirect_description_warnings,
)
from parallel_robot_model.common.units import HINGES, NANOSECONDS, JointUnits
from parallel_robot_model.configuration import config, config_files, fields, loop
from parallel_robot_model.configuration.fields import Groups, joint_field
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.nodes import parameters
from parallel_robot_model.nodes.background import (
    Background,
    CallbackTimes,
    Usage,
    diagnostics_message,
)
from parallel_robot_model.nodes.connections import AUTO, Connections, wait_for_period
from parallel_robot_model.nodes.joint_reader import SILENCE
from parallel_robot_model.nodes.parameters import START, BoundedParameterService, CommonStart
from parallel_robot_model.processes.node_processes import WATCH
from parallel_robot_model.processes.realtime import DeadlineThread

# s without messages of unknown publishers, after which they are reported anew
REPORT_INTERVAL = 10.0
NO_CLOCK = 'use_sim_time is true and nobody publishes /clock: set it to false, or start who does'
GRANTED = {  # in the diagnostics
    'realtime': 'real-time priority',
    'middleware': 'middleware',
    'period': 'period',
}
Resolve = Callable[[str, Mapping[str, Any]], dict[str, Any]]


class SuiteNode(Node):  # type: ignore[misc]
    """A node whose parameters are keys of ``config/`` and which always ends in order.

    Attributes:
        values: The whole configuration, as resolved from scenario and overrides.
        loop: The parameters that all nodes share.
        lockstep: Whether the plant waits for each command.
        period_ns: Period [ns].
        last_index: Index of the last state of the motion; None when it has no end.
        counts: How often something unusual happened; shown in the diagnostics.
        background: Does what would hold up the loop.
        exit_code: None while the node runs, then the code it ends with.
        priority: Real-time priority that the node should have in wall time; 0: none.
        example: What may follow the name of the node on a command line, for its help.
        makes_states: Whether the node publishes joint states, and so cannot take their period.
    """

    priority = 0
    makes_states = False
    example = '--ros-args -p scenario:=paper_line'

    def __init__(self, name: str, resolve: Resolve = config.resolve) -> None:
        """Resolve the configuration and declare the node's parameters.

        Args:
            name: Name of the node.
            resolve: Merges a scenario with overrides. Packages above that of the nodes have their
                own, which knows custom robots and laws, too.

        Raises:
            InputError: a parameter is unknown or wrong.
        """
        self.background = Background(self, self.log_exception)
        self._times = CallbackTimes(self.background)
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
        self._thread: DeadlineThread | None = None
        self._usage = Usage()
        self._reported_warnings: Set[str] = set()
        self._unknown_publishers: dict[Topic, float] = {}  # s, time of the last message of one
        self._reported_publishers: dict[Topic, str] = {}  # the publishers that were reported
        given = parameters.overrides(self)
        self._scenario = config_files.absolute_scenario(str(given.pop('scenario', 'paper_circle')))
        redirect_description_warnings(self.get_logger().warning)
        self.values = resolve(self._scenario, given)
        auto = self.values['period'] == AUTO
        if auto:
            self.values['period'] = config.default('period')
        self.loop = loop.loop_of(self.values)
        if auto:
            self._take_period_of_states()
        self.lockstep = self.loop.lockstep
        self.period_ns, self.last_index = self.loop.period_ns, self.loop.last_index
        self._common_start = CommonStart(self.loop)
        self._connections = Connections(
            self, self.loop, self._on_unknown_publisher, self._on_foreign_joints
        )
        self.declare_groups(('', loop.LoopParameters))
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_timer(1.0, self._on_second)
        self.create_service(Trigger, '~/ready', self._answer_ready)
        self._parameter_service = BoundedParameterService(self, self.background)

    # Hooks that a node may override.

    def set_start(self, stamp: int) -> None:
        """React to the common start stamp [ns]; nodes without a start of their own ignore it."""

    def handle_dispute(self, topic: Topic) -> None:
        """React to a message of a topic that has publishers that take turns."""

    def diagnose(self) -> dict[str, Any]:
        """Entries of the diagnostics, of the last second."""
        return {}

    def warnings(self) -> dict[str, str]:
        """What is odd just now, a line for each kind; reported once while it lasts."""
        return {}

    def handled(self) -> int | None:
        """Samples handled since the start; None for a node without a rhythm."""
        return None

    def alarm(self) -> str:
        """What is wrong enough to be an error in the diagnostics; empty for nothing."""
        return ''

    def is_settable(self, key: str) -> bool:
        """Whether a parameter can change while the node runs."""
        return key == START

    def prepare_change(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Check changes of parameters, and prepare to make them.

        Args:
            changes: Key to value, of parameters of the suite.

        Returns:
            Key to value as they will be stored, and what to call once they are.

        Raises:
            InputError: a change is refused; none of them is made.
        """
        for key in changes:
            if not self.is_settable(key):
                if key not in self.values:
                    raise UnknownNameError('parameter', key, self.values)
                raise InputError(f'{key} is fixed at the start of the node')
        if set(changes) != {START}:
            raise InputError(f'{START} is set in a request of its own')
        stamp = changes[START]
        self._common_start.check(stamp)
        return changes, lambda: self._pass_on_start(stamp)

    def missing(self) -> str:
        """What the node still waits for; empty when it is ready."""
        return self._connections.missing()

    def ambiguous(self) -> list[str]:
        """Topics that have several publishers, with their number."""
        counts = self._connections.several_publishers()
        return [f'{topic} has {count} publishers' for topic, count in counts.items()]

    def shared_outputs(self) -> list[str]:
        """Essential outputs on which other nodes publish, too."""
        return self._connections.shared_outputs()

    def disputes(self) -> str:
        """Which topics have another publisher, and the nodes; empty for none."""
        return '; '.join(self._connections.disputes())

    def begin(self) -> None:
        """Start what keeps time; called when all that takes long is done."""
        if not self.lockstep:  # where nothing is late
            self.background.start()
        if self._thread is not None:
            self._thread.start()

    def close(self) -> None:
        """Release what the node holds, before its publishers are destroyed."""

    # What a node calls.

    def publisher(self, topic: Topic, essential: bool = True) -> Publisher:
        """Create a publisher; the node is ready when essential ones have their subscribers."""
        return self._connections.publisher(topic, essential)

    def withdraw(self, publisher: Publisher) -> None:
        """Destroy an essential publisher."""
        self._connections.withdraw(publisher)

    def subscribe(
        self, topic: Topic, callback: Callable[[bytes], None], complete: bool = True
    ) -> None:
        """Subscribe to the serialised messages of a topic.

        In wall time, the publisher that sends first is trusted, and messages of another one
        are dropped, see :class:`SinglePublisher`. In lockstep, where the loop would stop without
        a message, those are reported, too, but none is dropped once this node's essential outputs
        have their subscribers; before that, all are, and the plant sends its state again.

        Args:
            topic: Name and type.
            callback: Called with each message.
            complete: Whether every message is wanted, even late (always in lockstep). Else only
                the newest counts, and is not held up by older ones that wait, nor by a
                subscriber that was killed before it acknowledged.
        """
        self._connections.subscribe(topic, callback, complete)

    def lost(self, topic: Topic) -> int:
        """Number of messages of a topic that were sent and did not come, or too many at once."""
        return self._connections.lost(topic)

    def start_timer(self, tick: Callable[[int], None], lead: int = 0) -> None:
        """Call ``tick(stamp)`` for the stamp of each sample [ns], once the node has begun.

        Args:
            tick: What to do; an exception ends the node.
            lead: How long before its stamp a tick is due [ns].
        """
        timed = self._times.timed('tick', tick)
        self._thread = DeadlineThread(self.period_ns, timed, self.fail, lead)

    def stop_timer(self) -> None:
        """Tick no more, because the node will end; a signal handler may call this."""
        if self._thread is not None:
            self._thread.end()

    def declare_groups(
        self,
        *declared: tuple[str, Any],
        units: JointUnits = HINGES,
        motions: Collection[str] = (),
    ) -> None:
        """Declare the parameters of groups, by prefix and type, with unit, meaning and range.

        Args:
            declared: The groups.
            units: Units of the joints.
            motions: Those of the groups that are motions, see :func:`joint_field`.

        Raises:
            InputError: a value is wrong.
        """
        # A node that is started with its own parameters must find the file of its scenario.
        groups = Groups({**self.values, 'scenario': self._scenario})
        for prefix, kind in declared:
            values = groups.at(prefix, kind)
            for parameter, value in zip(fields.parameters(kind), values, strict=True):
                key = f'{prefix}.{parameter.key}' if prefix else parameter.key
                field = joint_field(key, parameter, units, motions)
                parameters.declare(self, key, field, value, not self.is_settable(key))

    def finish(self, code: int = 0) -> None:
        """End the node with an exit code; may be called from any thread."""
        if self.exit_code is None:
            self.exit_code = code

    def fail(self, error: Exception) -> None:
        """End the node for an error; may be called from any thread."""
        self.get_logger().fatal(str(error) or type(error).__name__)
        self.finish(1)

    def log_exception(self, error: Exception) -> None:
        """Count and log an unforeseen error; nothing that comes over the wire may end a node."""
        self.counts['unforeseen errors'] += 1
        frame = traceback.extract_tb(error.__traceback__)[-1]
        text = f'unforeseen {first_line(error)} at {frame.filename}:{frame.lineno}'
        self.get_logger().error(text, throttle_duration_sec=1.0)

    def warn(self, text: str) -> None:
        """Log a warning for whoever started the node; ``run`` shows it, too."""
        self.get_logger().get_child(WATCH).warning(text)

    def show_granted(self, **texts: str) -> None:
        """Show what the system granted, in the diagnostics and as parameters, for bags."""
        for key, text in texts.items():
            self._granted[GRANTED[key]] = text
            parameters.declare_text(self, f'granted.{key}', text, GRANTED[key])

    # Methods of rclpy's node, guarded.

    def create_subscription(
        self, kind: Any, topic: str, callback: Any, *words: Any, **options: Any
    ) -> Subscription:
        """Subscribe as any node does, guarded."""
        guarded = self._guarded(topic, callback)
        return super().create_subscription(kind, topic, guarded, *words, **options)

    def create_service(
        self, kind: Any, name: str, callback: Any, *words: Any, **options: Any
    ) -> Service:
        """Offer a service as any node does, guarded."""
        return super().create_service(kind, name, self._guarded(name, callback), *words, **options)

    def create_timer(self, period: float, callback: Any, *words: Any, **options: Any) -> Timer:
        """Make a timer as any node does, guarded; of real time, whatever ``use_sim_time`` says."""
        guarded = self._guarded(f'timer of {period:g} s', callback)
        options = {'clock': Clock(clock_type=ClockType.STEADY_TIME)} | options
        return super().create_timer(period, guarded, *words, **options)

    def _guarded(self, name: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """A timed callback that cannot end the node, except by an error that the suite raises."""

        @functools.wraps(callback)
        def guarded(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except ParallelRobotError as error:
                self.fail(error)
            except Exception as error:
                self.log_exception(error)
            return arguments[-1] if arguments else None  # the response, as it was

        return self._times.timed(name, guarded)

    def destroy_node(self) -> None:
        """Stop what keeps time, then destroy the node."""
        if self._thread is not None:
            self._thread.stop()
        self.background.close()
        super().destroy_node()

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters together: all are right, or none is set."""
        of_ros, changes = parameters.split(self, parameter_list)
        effect = None
        try:
            if changes:
                changes, effect = self.prepare_change(changes)
        except ParallelRobotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        wanted = of_ros + [Parameter(key, value=value) for key, value in changes.items()]
        if not wanted:
            return SetParametersResult(successful=True)
        result = super().set_parameters_atomically(wanted)
        if result.successful and effect is not None:
            self.background.in_loop(self._times.timed('change of parameters', effect))
        return result

    def _take_period_of_states(self) -> None:
        """Wait for the period with which joint states come, in place of one that is given."""
        if self.makes_states or self.loop.lockstep:
            reason = 'of this node' if self.makes_states else 'in lockstep'
            raise InputError(f'period must be a number {reason}, not {AUTO!r}', 'period')
        period = wait_for_period(self, self.loop.joints, self.loop.end_with_parent) / NANOSECONDS
        self.values['period'] = period
        self.loop = loop.loop_of(self.values)
        text = f'{period:g} s: joint states come at {1.0 / period:.4g} Hz'
        self.get_logger().info(f'period {text}')
        self.show_granted(period=text)

    def _pass_on_start(self, stamp: int) -> None:
        """Pass a new start stamp on, once."""
        if self._common_start.take(stamp):
            try:
                self.set_start(stamp)
            except ParallelRobotError as error:
                self.fail(error)

    def _on_foreign_joints(self, topic: Topic) -> None:
        name = f'{topic.name}: messages of other joints'
        if not self.counts[name]:
            self.get_logger().warning(f'{name} are left out')
        self.counts[name] += 1

    def _on_unknown_publisher(self, topic: Topic, several: bool) -> None:
        self.counts[f'{topic.name}: messages of two publishers'] += 1
        now = time.monotonic()
        if now - self._unknown_publishers.get(topic, -math.inf) > REPORT_INTERVAL:
            self._reported_publishers.pop(topic, None)
            self.background.do(self._report_unknown_publishers)
        self._unknown_publishers[topic] = now
        if several:
            self.handle_dispute(topic)

    def _report_unknown_publishers(self) -> None:
        """Report who else publishes on topics of this node; again when more becomes known."""
        reported, several = self._reported_publishers, self._connections.several_publishers()
        for topic, seen_at in [*self._unknown_publishers.items()]:
            if time.monotonic() - seen_at > REPORT_INTERVAL:
                continue
            publishers = self._connections.publishers_of_input(topic)
            if topic not in reported or (topic.name in several and reported[topic] != publishers):
                what = '' if topic.name in several else ', one ended or not known yet'
                used = 'all are used' if self.lockstep else 'those of one are left out'
                silence = self._connections.silence(topic)
                if silence > SILENCE and not self.lockstep:
                    what = (
                        f', one silent for {silence:.2g} s: if it was killed, it counts for 20 s'
                    )
                    used = 'the other is used'
                self.warn(f'messages of two publishers{what}, {used}: {publishers}')
                reported[topic] = publishers

    def _answer_ready(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = self.missing()
        response.success = not response.message
        return response

    def _all_warnings(self) -> dict[str, str]:
        clock, own = self.get_clock(), {}
        stands = clock.ros_time_is_active and not clock.now().nanoseconds
        if stands and not self.lockstep and not self.count_publishers('/clock'):
            own['clock'] = NO_CLOCK
        return own | self.warnings()

    def _on_second(self) -> None:
        self.background.do(self._publish_diagnostics)

    def _publish_diagnostics(self) -> None:
        usual = {**self.diagnose(), **self._usage.measure(self.handled()), **self._granted}
        usual |= self._times.take()
        present = {kind: text for kind, text in self._all_warnings().items() if text}
        for kind in present.keys() - self._reported_warnings:
            self.warn(present[kind])
        self._reported_warnings = present.keys()
        self._report_unknown_publishers()
        several = self._connections.several_publishers()
        unusual = {**self.counts, **{f'{name}: publishers': n for name, n in several.items()}}
        warnings = [*present.values(), *unusual]
        message = diagnostics_message(self, {**usual, **unusual}, warnings, self.alarm())
        self._diagnostics.publish(message)
