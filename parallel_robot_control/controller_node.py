"""Node that computes the effort command of every joint state from the newest reference.

The law and its gains are parameters that can change while the robot moves. What goes wrong ends in
a latched fault and a safe action: see docs/safety.md.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from parallel_robot_base import cdr, realtime, topics
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control import faults
from parallel_robot_control.answering import (
    ANSWERED,
    EARLY,
    LOG,
    NO_REFERENCE,
    STALE,
    STATUS,
    TELEMETRY,
    UNKNOWN,
)
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import (
    REFERENCE_FIELDS,
    Controller,
    ControllerParameters,
    JointSample,
    Sample,
)
from parallel_robot_control.laws import LAWS, available
from parallel_robot_control.messages import (
    Status,
    limits_text,
    status_message,
    telemetry_fields,
    telemetry_layouts,
)
from parallel_robot_control.safety import SafetyParameters
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_ros.joint_reader import JointReader
from parallel_robot_ros.suite_node import SuiteNode, run_node

LAST_WORD = 0.5  # s, for which the node stays after its zero torque, so that it is read
LOADING = 0.03  # s, between two laws that are loaded beside the loop
LOOKS = 4  # at the age of the joint states within the time after which they are stale


class ControllerNode(SuiteNode):
    """Answers each state with one command; what the controller thinks goes out more slowly."""

    priority = realtime.LOOP
    example = '--ros-args -p law:=s_fotsmc -p s_fotsmc.G:=12'

    def __init__(self) -> None:
        """Prepare the laws, then listen."""
        groups = {
            'robot': RobotParameters,
            'controller': ControllerParameters,
            'safety': SafetyParameters,
        }
        super().__init__('controller', groups | {name: law.Gains for name, law in LAWS.items()})
        laws = available(self.values)
        self._laws = ', '.join(laws)
        for name, law in laws.items():
            if name not in LAWS:
                self.declare_group(name, law.Gains)
        self._controller = Controller(self.values, lazy=True)
        self._loader = threading.Thread(target=self._load_laws, name='laws', daemon=True)
        self._closing = threading.Event()
        self.counts = self._controller.counts
        self._warn(self._controller.law.warnings)
        joints = self.loop.joints
        self._state_reader = JointReader(
            topics.JOINT_STATES, joints, ('position', 'velocity'), self.counts, 'effort'
        )
        self._reference_reader = JointReader(
            topics.REFERENCE, joints, REFERENCE_FIELDS, self.counts
        )
        self._status: Status | None = None
        self._told = self._controller.law.name  # the law on the latched topic
        self._commands = self.publisher(topics.COMMANDS)
        self._telemetry = {
            topic: (self.publisher(topic, essential=False), layout.draft())
            for topic, layout in telemetry_layouts(joints).items()
        }
        self._log = self.publisher(topics.ANSWERED, essential=False)
        self._active_law = self.publisher(topics.ACTIVE_LAW, essential=False)
        self._active_law.publish(cdr.text_message(self._controller.law.name))
        self._statuses = self.publisher(topics.STATUS, essential=False)
        self.create_service(Trigger, '~/emergency_stop', self._answer_emergency_stop)
        self.create_service(Trigger, '~/clear_fault', self._answer_clear_fault)
        self.subscribe(topics.REFERENCE, self._on_reference, complete=False)
        self.subscribe(topics.JOINT_STATES, self._on_state, complete=False)
        self._clock_offset = time.time_ns() - time.monotonic_ns()
        timeout = self.values['safety.state_timeout']
        self._state_timeout = round(timeout * NANOSECONDS)
        if not self.lockstep:
            self.create_timer(timeout / LOOKS, self._watch)

    def begin(self) -> None:
        """Go on loading laws, beside the loop."""
        super().begin()
        self._loader.start()

    def is_settable(self, key: str) -> bool:
        """Law, preset and gains."""
        return (
            super().is_settable(key)
            or key in ('law', 'preset')
            or key.partition('.')[0] in available(self.values)
        )

    def judge(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Let the controller judge law, preset and gains."""
        fixed = {key: value for key, value in changes.items() if not self.is_settable(key)}
        if fixed or 'start_stamp' in changes:
            return super().judge(fixed or changes)
        change = self._controller.judge(changes)

        def apply() -> None:
            self._warn(change.law.warnings)
            self._controller.apply(change)
            self.values = change.values

        stored = {
            key: value
            for key, value in change.values.items()
            if key in changes or value != self.values[key]
        }
        return stored, apply

    def set_start(self, stamp: int) -> None:
        """Answer no state from before the common start [ns]."""
        self._controller.begin(stamp)

    def diagnose(self) -> dict[str, str]:
        """What the controller is doing."""
        figures = {
            'law': self._controller.law.name,
            'laws': self._laws,
            'limits that acted': limits_text(self._controller.status.acted),
            'answered': str(self._controller.answered),
            'skipped': str(self._controller.skipped),
        }
        ages = self._controller.take_ages()
        if ages.size and not self.lockstep:
            p50, p99, largest = 1e3 * np.percentile(ages, [50, 99, 100])
            figures['lag p50/p99/max [ms]'] = f'{p50:.3f}/{p99:.3f}/{largest:.3f}'
        return figures

    def handled(self) -> int:
        """States answered."""
        return self._controller.answered

    def alarm(self) -> str:
        """The fault."""
        fault = self._controller.fault
        return f'fault: {faults.FAULT_TEXT[fault]}' if fault else ''

    def leave_out(self, topic: topics.Topic) -> None:
        """Go over to the safe action: of two robots, or two motions, none is the right one."""
        if topic == topics.JOINT_STATES:
            self._lose_torque(self._controller.lose(faults.STATES_DISAGREE))
        else:
            self._controller.trip(faults.REFERENCES_DISAGREE)

    def close(self) -> None:
        """Leave the robot without torque: the last message is zero."""
        self._closing.set()
        self._send_zero()
        self._log.publish(self._controller.take_log())
        time.sleep(LAST_WORD)  # those who read best effort acknowledge nothing
        if self._loader.ident:
            self._loader.join()

    def _on_reference(self, data: bytes) -> None:
        if not self._controller.read_reference(data):
            message = self._reference_reader.read(data)
            if message is not None:
                stamp, vectors = message
                self._send(self._controller.add_reference(stamp, JointReference(*vectors)))
        elif self.lockstep and self._controller.pending:
            self._send(self._controller.answer_pending())

    def _on_state(self, data: bytes) -> None:
        code = self._controller.answer(data, now=self._now())
        if code == ANSWERED:  # nine times out of ten
            self._commands.publish(self._controller.command)
        elif code > 0:
            self._tell_more(code)
        elif code not in (EARLY, NO_REFERENCE) or self.lockstep:
            self._on_odd_state(code, data)

    def _on_odd_state(self, code: int, data: bytes) -> None:
        """Take a state that the compiled path did not: another layout, or a stamp out of order."""
        if code == STALE:  # the node itself has stood still
            self._watch()
        message = self._state_reader.read(data)
        if message is None:
            return
        if code == UNKNOWN and self._state_reader.layout is not None:
            self._controller.expect(self._state_reader.layout, self._state_reader.order)
        stamp, vectors = message
        if self._is_old(stamp):
            self.counts['joint states that are too old'] += 1  # as if they had not come
        else:
            self._send(self._controller.add_state(stamp, JointSample(*vectors)))

    def _load_laws(self) -> None:
        """Load what is not active yet, with pauses, so that a switch finds it."""
        while not self._closing.wait(LOADING) and self._controller.load():
            pass

    def _now(self) -> int:
        """Time by which a state may be too old [ns]; 0: none is.

        The earlier of two: stamps go on as before when the system clock is set.
        """
        if self.lockstep:
            return 0
        return min(time.time_ns(), self._clock_offset + time.monotonic_ns())

    def _is_old(self, stamp: int) -> bool:
        """Whether a state is of a time that has gone: one that waited in a queue, say."""
        latest = stamp + self._state_timeout
        if self._now() <= latest:  # the cheaper clock first
            return False
        return bool(self.get_clock().now().nanoseconds > latest)

    def _send(self, sample: Sample | None) -> None:
        """Publish an answer, if there is one."""
        if sample is not None:
            self._tell_more(self._controller.code)

    def _tell_more(self, code: int) -> None:
        """Publish the last answer and what there is to tell with it, by the bits of its code."""
        self._commands.publish(self._controller.command)
        stamp = self._controller.stamp
        if (code & STATUS or self._status is None) and self._controller.status != self._status:
            self._tell(stamp, self._controller.status)
        if code & TELEMETRY:
            for topic, fields in telemetry_fields(self._controller.telemetry).items():
                publisher, draft = self._telemetry[topic]
                publisher.publish(draft.encode(stamp, **fields))
        if code & LOG:
            self._log.publish(self._controller.take_log())

    def _tell(self, stamp: int, status: Status) -> None:
        """Publish and log a new status since a stamp [ns]."""
        before, self._status = self._status, status
        self._statuses.publish(status_message(stamp, status))
        if status.law != self._told:
            self._told = status.law
            self._active_law.publish(cdr.text_message(status.law))
            self.get_logger().info(f'law {status.law}')
        if status.fault != (before.fault if before else faults.NONE):
            if status.fault:
                text = faults.FAULT_TEXT[status.fault]
                self.get_logger().error(f'fault: {text}; ~/clear_fault ends the safe action')
            else:
                self.get_logger().info('fault cleared')
        elif status.acted and status.acted != (before.acted if before else 0):
            text = f'limits acted: {limits_text(status.acted)}'
            self.get_logger().warning(text, throttle_duration_sec=1.0)

    def _watch(self) -> None:
        """Take the torque away when the joint states are stale."""
        self._lose_torque(self._controller.watch())

    def _lose_torque(self, lost: bool) -> None:
        """Take the torque away if the joint states are lost."""
        if lost:
            self._send_zero()
            self._tell_now()

    def _send_zero(self) -> None:
        self._commands.publish(self._controller.zero_command())

    def _tell_now(self) -> None:
        """Publish a fault that no state brought about."""
        stamp = self._controller.stamp if self.lockstep else time.time_ns()
        self._tell(stamp, self._controller.status)

    def _answer_emergency_stop(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        self._controller.trip(faults.EMERGENCY_STOP)
        self._tell_now()
        response.success = True
        response.message = f'{self.alarm()}; ~/clear_fault ends it'
        return response

    def _answer_clear_fault(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        before = self._controller.fault
        response.message = self._controller.clear_fault()
        response.success = not response.message
        if self._controller.fault != before:
            self._tell_now()
        return response

    def _warn(self, warnings: tuple[str, ...]) -> None:
        for warning in warnings:
            self.get_logger().warning(warning)


def main() -> int:
    """Run the node."""
    return run_node(ControllerNode)


if __name__ == '__main__':
    sys.exit(main())
