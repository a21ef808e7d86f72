"""Node that computes the effort command of every joint state from the newest reference.

The law and its gains are parameters that can change while the robot moves. Anything that goes
wrong leads to a latched fault and a safe action: see docs/safety.md.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from parallel_robot_control import configuration
from parallel_robot_control.answer_kernel import (
    ANSWERED,
    EARLY,
    NO_REFERENCE,
    OVERTAKEN,
    REFUSED,
    REFUSED_LONG,
    STALE,
    UNKNOWN,
)
from parallel_robot_control.configuration import (
    ControlConfiguration,
    configure,
    declared,
    resolve,
)
from parallel_robot_control.contract import Foreign, JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_control.joint_states import UNTOLD, MissingStates, RefusedStates
from parallel_robot_control.messages import limits_text
from parallel_robot_control.reference_buffer import REFERENCE_FIELDS
from parallel_robot_control.ros_controller_topics import LAST_WORD, ControllerTopics
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.connections import UNKNOWN_NODE
from parallel_robot_model.nodes.joint_reader import JointReader
from parallel_robot_model.nodes.life_cycle import Lifecycle, run_node
from parallel_robot_model.nodes.parameters import START
from parallel_robot_model.nodes.suite_node import SuiteNode
from parallel_robot_model.processes import realtime
from parallel_robot_model.processes.user_directory import StopRecord

REFUSALS = {
    faults.STATES_LATE: 'joint states that are too old',
    faults.STATES_AHEAD: 'joint states that are ahead of the clock',
}
GUESS = 'controller.guess'
LOOKS = 4  # checks of the joint states within the time after which they are stale
COMPETITOR_PERIOD = 0.1  # s, from one look whether others publish commands to the next


class ControllerNode(SuiteNode):
    """Answers each joint state with one command."""

    priority = realtime.LOOP
    example = '--ros-args -p law:=s_fotsmc -p s_fotsmc.G:=12'
    configuration: ControlConfiguration | None = None

    def __init__(self) -> None:
        """Prepare the laws, then listen."""
        super().__init__('controller', resolve)
        self.configuration = configured = configure(self.values)
        robot, laws = configured.robot.module, configured.laws
        self.declare_groups(
            ('robot', robot.Parameters),
            *declared(robot, laws),
            units=configured.robot.joint_units,
        )
        self._laws = ', '.join(laws)
        self._controller = Controller(configured)
        self.counts = self._controller.counts
        self._warn(self._controller.law.warnings)
        joints = self.loop.joints
        needed, optional = ['position'], {'velocity': 0.0, 'effort': np.nan}
        if configured.estimator.takes_velocities:
            needed.append('velocity')
            del optional['velocity']
        self._state_reader = JointReader(
            topics.JOINT_STATES, joints, needed, self.counts, optional
        )
        self._reference_reader = JointReader(
            topics.REFERENCE, joints, REFERENCE_FIELDS, self.counts
        )
        managed = configured.controller.lifecycle
        self._topics = ControllerTopics(self, self._controller, not managed)
        self._stopped_by_hand = False  # beside the stop of a managed node that is not active
        self._lifecycle: Lifecycle | None = None
        if managed:
            self._lifecycle = Lifecycle(self, self._activate, self._deactivate, self.finish)
        stop = self.create_service(Trigger, '~/emergency_stop', self._answer_emergency_stop)
        clear = self.create_service(Trigger, '~/clear_fault', self._answer_clear_fault)
        self.create_service(Trigger, '~/confirm_pose', self._answer_confirm_pose)
        self.subscribe(topics.REFERENCE, self._on_reference, complete=False)
        self.subscribe(topics.JOINT_STATES, self._on_state, complete=False)
        timeout = configured.safety.state_timeout
        self._competitors, self._competitors_reported = '', False  # who publishes commands, too
        self._refused = RefusedStates(
            configured.safety.state_age, lambda: self.get_clock().now().nanoseconds
        )
        self._missing = MissingStates(self._controller.limits.gap)
        if not self.lockstep:
            self.create_timer(timeout / LOOKS, self._watch)
        self.create_timer(COMPETITOR_PERIOD, self._watch_competitors)
        if not self.lockstep and not self.loop.start_stamp:  # `run` ends with its controller
            self._stop_record = StopRecord(self.get_fully_qualified_name())
            self.background.finish(stop, self._save_stop)
            self.background.finish(clear, self._forget_stop)
            self._restore_stop()
        if self._controller.fault and not self.lockstep:
            self._publish_status()

    def is_settable(self, key: str) -> bool:
        """Whether a parameter can change while the node runs: law, preset and gains."""
        laws = self.configuration.laws if self.configuration else {}
        return (
            super().is_settable(key)
            or key in ('law', 'preset', GUESS)
            or key.partition('.')[0] in laws
        )

    def prepare_change(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Let the controller prepare a change of law, preset and gains, or take a pose."""
        if set(changes) == {GUESS}:
            pose = self._controller.pose_near(changes[GUESS])
            return changes, lambda: self._place(pose, changes)
        if GUESS in changes and changes.pop(GUESS) != self.values[GUESS]:
            raise InputError(f'{GUESS} is set in a request of its own')
        if START in changes or not all(map(self.is_settable, changes)):
            return super().prepare_change(changes)
        before, change = self._controller.configuration, self._controller.prepare_change(changes)
        settings = dict(configuration.settings(change.configuration, before))

        def apply() -> None:
            self._controller.apply(change)
            self.values = {**self.values, **settings}
            self.background.do(lambda: self._warn(change.law.warnings))

        stored = {
            key: value
            for key, value in settings.items()
            if key in changes or value != self.values[key]
        }
        return stored, apply

    def _place(self, pose: Array, changes: dict[str, Any]) -> None:
        self._controller.set_pose(pose)
        self.values = {**self.values, **changes}
        self._publish_status()

    def set_start(self, stamp: int) -> None:
        """Answer no state before the common start [ns]."""
        self._controller.set_start(stamp)

    def diagnose(self) -> dict[str, str]:
        """What the controller is doing."""
        rhythm = self._controller.log.rhythm
        rhythm.look()
        self._controller.log.held.look()
        ages = self._controller.log.take_ages()
        taken = self.lost(topics.JOINT_STATES) + self._refused.count
        self._missing.look(rhythm.last, taken, float(ages.max(initial=0.0)))
        if self._missing.sent:
            self.get_logger().warning(self._missing.sent, throttle_duration_sec=UNTOLD)
        figures = {
            'law': self._controller.law.name,
            'laws': self._laws,
            'joints': ', '.join(self.loop.joints),
            **self._controller.joint_unit,
            'limits that acted': limits_text(self._controller.status.active_limits),
            'answered': str(self._controller.log.answered),
            'skipped': str(rhythm.skipped),
            'missing': self._missing.figures,
        }
        if ages.size and not self.lockstep:
            p50, p99, largest = 1e3 * np.percentile(ages, [50, 99, 100])
            figures['lag p50/p99/max [ms]'] = f'{p50:.3f}/{p99:.3f}/{largest:.3f}'
        return figures

    def warnings(self) -> dict[str, str]:
        """What is wrong with the joint states."""
        log = self._controller.log
        lines = {'rate': log.rhythm.warning, 'held': log.held.warning}
        if not self.lockstep:
            lines |= self._refused.warnings(
                self._controller.stamp, self._state_reader.problem, self.loop.joints
            )
            lines['missing'] = self._missing.never_sent
        return lines

    def handled(self) -> int:
        """Number of states answered."""
        return self._controller.log.answered

    def alarm(self) -> str:
        """The fault, or the reference that is missing (lockstep)."""
        fault = self._controller.status.fault
        if fault is None:
            return self._controller.waits()
        return f'fault: {self._controller.explain(fault).text}'

    def handle_dispute(self, topic: topics.Topic) -> None:
        """Change to the safe action: of two robots or two motions, one is not meant."""
        states = topic == topics.JOINT_STATES
        self._trip(faults.STATES_DISAGREE if states else faults.REFERENCES_DISAGREE)

    def close(self) -> None:
        """Leave the robot without torque: the last message is zero."""
        self._topics.publish_zero()
        self._topics.publish_log()
        time.sleep(LAST_WORD)  # best-effort subscribers acknowledge nothing

    def _on_reference(self, data: bytes) -> None:
        if not self._controller.read_reference(data):
            message = self._reference_reader.read(data)
            if message is not None:
                stamp, vectors = message
                self._send(self._controller.add_reference(stamp, JointReference(*vectors)))
        elif self.lockstep and self._controller.pending:
            self._send(self._controller.answer_pending())

    def _on_state(self, data: bytes) -> None:
        code = self._controller.answer(data, now=0 if self.lockstep else self._refused.now())
        if code == ANSWERED:  # the usual case
            self._topics.publish_command()
        elif code > 0:
            self._topics.publish_answer(code)
        elif code == OVERTAKEN:
            self._refused.count += 1
        elif code == REFUSED_LONG:
            self._publish_status()
        elif code != REFUSED and (code not in (EARLY, NO_REFERENCE) or self.lockstep):
            self._on_odd_state(code, data)

    def _on_odd_state(self, code: int, data: bytes) -> None:
        """Take a state that the compiled path refused: another layout, or a stamp out of order."""
        if code == STALE:  # the node itself was stalled
            self._watch()
        message = self._state_reader.read(data)
        if message is None:
            self._refused.note(faults.STATES_INVALID)
            self._zero_torque(not self.lockstep and self._controller.refuse(faults.STATES_INVALID))
            return
        if code == UNKNOWN and self._state_reader.layout is not None:
            self._controller.expect(self._state_reader.layout, self._state_reader.order)
        stamp, vectors = message
        wrong = faults.NONE if self.lockstep else self._refused.refusal(stamp)
        if wrong != faults.NONE:  # as if it had not arrived
            self.counts[REFUSALS[wrong]] += 1
            self._zero_torque(self._controller.refuse(wrong))
        else:
            self._send(self._controller.add_state(stamp, vectors))

    def _send(self, answered: bool) -> None:
        """Publish an answer, if there is one."""
        if answered:
            self._topics.publish_answer(self._controller.code)

    def _watch(self) -> None:
        """Send zero torque when the joint states become stale, or the run is over."""
        if self._controller.finish():
            self._topics.publish_zero()
            self.get_logger().info(f'the run of {self.loop.duration:g} s is over')
        self._zero_torque(self._controller.watch())

    def _watch_competitors(self) -> None:
        """Enter a fault when another node publishes commands, too."""
        shared = bool(self.shared_outputs())
        if shared and self._controller.fault == faults.NONE:
            self._trip(faults.COMMANDS_DISAGREE)
        if shared and not self._competitors_reported:
            self._competitors = self.disputes()
        named = UNKNOWN_NODE not in self._competitors or not shared  # else it will be soon
        if self._competitors and named and not self._competitors_reported:
            self._competitors_reported = True
            self.warn(self._competitors)
        if not shared:
            self._competitors, self._competitors_reported = '', False

    def _restore_stop(self) -> None:
        """Begin in the saved emergency stop of a controller of this name."""
        stopped_at = self._stop_record.stopped_at()
        if stopped_at is not None:
            self._stopped_by_hand = True
            self._controller.trip(faults.EMERGENCY_STOP)
            since = time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(stopped_at))
            self.get_logger().warning(f'emergency stop since {since}; ~/clear_fault ends it')

    def _save_stop(self, response: Trigger.Response) -> None:
        """Save an emergency stop, so that it outlives this controller."""
        reason = self._stop_record.save()
        if reason:
            response.message += f'; a controller that is started anew will not know it: {reason}'

    def _forget_stop(self, response: Trigger.Response) -> None:
        """Let a stop that was cleared not come back."""
        reason = self._stop_record.forget() if response.success else ''
        if reason:
            response.message = f'cleared; it comes back with the next start: {reason}'

    def _zero_torque(self, lost: bool) -> None:
        """Send zero torque if the joint states are lost."""
        if lost:
            self._topics.publish_zero()
            self._publish_status()

    def _trip(self, fault: int) -> None:
        """Enter a fault that no state shows, unless the controller already is in one."""
        if self._controller.fault == faults.NONE:
            self._controller.trip(fault)
            self._publish_status()

    def _publish_status(self, refused: str = '') -> None:
        """Publish a fault that was not caused by a state, or why it was not cleared."""
        stamp = self._controller.applied_stamp if self.lockstep else time.time_ns()
        self._topics.publish_status(stamp, refused)

    def _answer_emergency_stop(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        self._stopped_by_hand = True
        self._trip(faults.EMERGENCY_STOP)
        response.success = True
        response.message = f'{self.alarm()}; ~/clear_fault ends it'
        return response

    def _answer_clear_fault(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        if self._lifecycle is None or self._lifecycle.active:
            response.message = self._clear_fault()
            response.success = not response.message
        else:
            self._stopped_by_hand, response.success = False, True
            response.message = 'the controller is not active'
        return response

    def _clear_fault(self) -> str:
        """End the safe action; returns why not."""
        before = self._controller.fault
        dispute = self.disputes()
        waits = f'{dispute}; stop all but one' if dispute else self._renew_law()
        reason = waits or self._controller.clear_fault()
        if reason and before != faults.NONE:
            self.get_logger().warning(f'fault not cleared: {reason}')
        if self._controller.fault != before or (reason and before != faults.NONE):
            self._publish_status(reason)
        return reason

    def _renew_law(self) -> str:
        """Start the process of a law anew if it has ended; returns that it is not ready."""
        law = self._controller.law
        if law.foreign is None or law.foreign.ready:
            return ''
        self.background.do(partial(self._start_law, law.name, law.foreign, law.gains))
        return f'the process of the law {law.name} has ended and starts again: clear once more'

    def _start_law(self, name: str, law: Foreign, gains: Any) -> None:
        if law.ready:  # it was requested twice
            return
        self.get_logger().warning(f'{name}: {law.failure(gains)}; it starts again')
        try:
            law.start()
        except InputError as error:
            self.get_logger().error(f'{name} does not start again: {error}')

    def _activate(self) -> str:
        """Send commands, from the end of the safe action on; returns why not."""
        if self._stopped_by_hand:
            return 'emergency stop; ~/clear_fault ends it'
        name = self.resolve_topic_name(topics.COMMANDS.name)
        if self.count_publishers(name):
            return f'{name} has a publisher already; stop it'
        reason = '' if self._topics.send() else f'nobody subscribes to {name}'
        reason = reason or self._clear_fault()
        if reason:
            self._topics.stop_publishing()
        return reason

    def _deactivate(self) -> None:
        """Send zero torque, and then nothing."""
        self._trip(faults.EMERGENCY_STOP)
        self._topics.stop_publishing()

    def _answer_confirm_pose(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.message = self._controller.confirm_pose()
        response.success = not response.message
        if response.success:
            self._publish_status()
        return response

    def _warn(self, warnings: tuple[str, ...]) -> None:
        for warning in warnings:
            self.get_logger().warning(warning)


def main() -> int:
    """Run the node."""
    return run_node(ControllerNode)


if __name__ == '__main__':
    sys.exit(main())
