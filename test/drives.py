"""Drives with brakes behind ros2_control, as far as the suite meets them; the robot is simulated.

What the real ones did (controller_manager 4.46.0, joint_state_broadcaster and
JointGroupEffortController 4.42.1, see docs/ros2_control.md):

- An empty command is dropped without a word, one that is not finite with a warning; the last
  one is handed on for ever. While the effort controller is inactive, nothing is handed on, and
  what came then is forgotten. The interface is NaN before the first activation and zero after a
  deactivation.
- A command of another length is an error, after which the controller manager deactivates it.
- States are reliable and transient local, one is kept; commands best effort and volatile.
- Joints come in the order of the alphabet, a gripper among them, those without an interface not at
  all; NaN stands for an interface that is not there, and for all until the hardware has written.
- Stamps tell when an update begins, which jitters. A cycle that is missed is left out, while the
  last torque acts on. The thread that publishes is another one: states that come while it
  is busy are dropped.
- A component that errs becomes unconfigured and its controllers inactive: no states, and no
  `write` any more, so that the drives themselves must zero. It comes back only by services, the
  component first.
- A controller with a lower rate runs in the cycles that come nearest to it.
- Limits of the URDF are applied where they are enforced, and the manager alone says so.

When the effort controller is deactivated the brakes close here, too, and open when it is
activated. A gripper may have a broadcaster of its own, on the same topic.
"""

import json
import queue
import sys
import threading
import time

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from parallel_robot_control.configuration import resolve
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.realtime import DeadlineThread
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator

STATES = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
COMMANDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
SYSTEM_DEFAULT = QoSProfile(depth=10)
BROADCASTER, EFFORT, COMPONENT = 'joint_state_broadcaster', 'effort_controller', 'robot'
INTERFACES = ('position', 'velocity', 'effort')
GRIPPER = 0.02  # s, period of the states of a gripper with a broadcaster of its own
EMPTY = 20  # states before the hardware has written
NOISE = 5e-6, 2e-3  # rad, rad/s, rms
CALM = 1.2  # s, from a stall to the next
TURNS = 60  # samples for which a hand turns the joints
EVERY = 10  # samples from one message on `bench` to the next


class PublishingThread(threading.Thread):
    """Publishes messages in order, some time after their stamps; now and then it stalls."""

    def __init__(self, publisher, late, dropped, stalls, bursts):
        super().__init__(daemon=True)
        self._publisher, (self._least, self._most) = publisher, late
        self._share, self._stalls, self._bursts = dropped, stalls, bursts
        self._random, self._waiting = np.random.default_rng(2), queue.SimpleQueue()
        self._begins, self._until = 0.0, 0.0  # s, of the stall that comes next, or is there
        self.stalls = self.dropped = 0

    def publish(self, stamp, message):
        """Take a message at a stamp [ns]."""
        now = stamp * 1e-9
        if self._stalls and not self._begins:
            self._begins = now + CALM
        if self._begins and now >= self._begins:
            self._until = now + self._stalls[self.stalls % len(self._stalls)]
            self._begins = self._until + CALM
            self.stalls += 1
        elif (now < self._until and not self._bursts) or self._random.uniform() < self._share:
            self.dropped += 1
            return
        due = max(now + self._random.uniform(self._least, self._most), self._until)
        if due > now:
            self._waiting.put((due, message))
        else:
            self._publisher.publish(message)

    def run(self):
        while True:
            due, message = self._waiting.get()
            early = due - time.time()
            if early > 0.0:
                time.sleep(early)
            self._publisher.publish(message)


class Drives(Node):
    """``joint_states``, ``effort_controller/commands``; services with names of what they switch.

    Besides what ros2_control has: `bench`, what somebody sees who stands beside it; `hand`,
    torques [N m] of one who releases the brakes for a moment and turns the joints; and `err`,
    a component that fails.
    """

    def __init__(
        self,
        overrides=None,
        interfaces=INTERFACES,
        late=(0.0, 0.0),
        dropped=0.0,
        stalls=(),
        bursts=False,
        jitter=0.0,
        active=False,
        rates=None,
        asynchronous=False,
        limits=None,
        enforced=True,
        zeroes=True,
    ):
        """Put the robot at its initial pose.

        Args:
            overrides: Parameters of the robot, and the period.
            interfaces: What the drives tell of the joints.
            late: Least and largest age of states when they are published [s].
            dropped: Share of the states that are not published, at random.
            stalls: How long the publishing thread stalls [s], in turn, each CALM after the last.
            bursts: Whether states that come meanwhile are sent then, all at once; else dropped.
            jitter: Largest delay of an update [s].
            active: Whether the effort controller begins active.
            rates: Rates of controllers that have one of their own [Hz].
            asynchronous: Whether the controllers have threads of their own: commands act a cycle
                later.
            limits: `effort` [N m] and `velocity` [rad/s] of the joints in the URDF.
            enforced: Whether the manager enforces them.
            zeroes: Whether drives that err zero and brake by themselves; else the last torque
                acts on.
        """
        super().__init__('controller_manager')
        values = resolve('paper_circle', overrides or {})
        configuration = configure_plant(values)
        self._names = configuration.loop.joints
        self._robot, self._interfaces = Simulator(configuration), interfaces
        self._random = np.random.default_rng(1)
        self._turn = threading.Lock()
        n, period = len(self._names), configuration.loop.period_ns
        self._on = {BROADCASTER: True, EFFORT: active, COMPONENT: True}
        self._every = {name: nearest(1e9 / period, rate) for name, rate in (rates or {}).items()}
        self._asynchronous, self._zeroes = asynchronous, zeroes
        self._limits = (limits or {}) if enforced else {}
        self._command, self._hand = None, np.zeros(n)
        self._interface, self._torque, self._count = np.full(n, np.nan), np.zeros(n), 0
        states = self.create_publisher(JointState, 'joint_states', STATES)
        self._states, self._jitter = (
            PublishingThread(states, late, dropped, stalls, bursts),
            jitter,
        )
        self._states.start()
        self._bench = self.create_publisher(Float64MultiArray, 'bench', QoSProfile(depth=1000))
        self._turns = 0  # of the hand
        self._peaks = np.zeros(2)  # of torque, command [N m]
        commands = topics.COMMANDS.name
        self.create_subscription(Float64MultiArray, commands, self._on_command, COMMANDS)
        self.create_subscription(Float64MultiArray, 'hand', self._on_hand, SYSTEM_DEFAULT)
        for name in self._on:
            self.create_service(SetBool, f'~/{name}', self._switcher(name))
        self.create_service(Trigger, '~/err', self._on_err)
        self.thread = DeadlineThread(period, self._update, self._fail)

    def _on_command(self, message):
        with self._turn:
            command = np.array(message.data)
            if len(command) not in (0, len(self._names)):
                self._switch(EFFORT, False)
            elif len(command) and np.isfinite(command).all():
                self._command = command
                self._peaks[1] = max(self._peaks[1], np.abs(command).max())

    def _on_hand(self, message):
        with self._turn:
            self._hand, self._turns = np.array(message.data), TURNS

    def _switcher(self, name):
        def switch(request, response):
            with self._turn:
                response.success = name == COMPONENT or self._on[COMPONENT]
                if response.success:
                    self._switch(name, request.data)
                else:
                    response.message = 'Failed switching controllers'
            return response

        return switch

    def _switch(self, name, on):
        self._on[name] = on
        if name == COMPONENT and not on:
            self._switch(BROADCASTER, False)
            self._switch(EFFORT, False)
        if name == EFFORT:
            self._command = None
            if not on:
                self._interface = np.zeros_like(self._interface)

    def _on_err(self, _, response):
        with self._turn:
            self._switch(COMPONENT, False)
            if self._zeroes:
                self._torque = np.zeros_like(self._torque)
        response.success = True
        return response

    def _update(self, stamp):
        """One turn of the controller manager: read, update, write."""
        with self._turn:
            if self._on[COMPONENT] and time.time_ns() - stamp < self.thread._period:
                self._cycle(stamp)
            self._show()
            self._peaks[0] = max(self._peaks[0], np.abs(self._torque).max())
            self._turns = max(0, self._turns - 1)
            errs = not (self._on[COMPONENT] or self._zeroes)
            if self._on[EFFORT] or errs or self._turns:
                self._robot.advance(self._torque + (self._hand if self._turns else 0.0))
            else:  # braked
                state = self._robot._state
                state.rate = 0.0 * state.rate
                state.time += 1e-9 * self.thread._period

    def _cycle(self, stamp):
        if self._is_due(BROADCASTER):
            self._publish(stamp)
        before = self._interface
        if self._is_due(EFFORT) and self._command is not None:
            self._interface = self._command
        acts = before if self._asynchronous else self._interface
        known = np.isfinite(acts).all()
        self._torque = self._limited(acts) if known else np.zeros_like(self._torque)

    def _is_due(self, name):
        return self._on[name] and self._count % self._every.get(name, 1) == 0

    def _limited(self, wanted):
        """Torques within the limits of the URDF [N m]."""
        most = np.full_like(wanted, self._limits.get('effort', np.inf))
        speed, fast = self._robot.measurement().velocity, self._limits.get('velocity', np.inf)
        limited = np.clip(
            wanted, np.where(speed < -fast, 0.0, -most), np.where(speed > fast, 0.0, most)
        )
        if (limited != wanted).any():
            text = 'Command of at least one joint is out of limits (throttled log)'
            self.get_logger().warning(text, throttle_duration_sec=1.0)
        return limited

    def _publish(self, stamp):
        wake = self._random.uniform(0.0, self._jitter)
        joints, noise = self._robot.measurement(), self._random.normal(size=(2, len(self._names)))
        position = joints.position + joints.velocity * wake + NOISE[0] * noise[0]
        rows = position, joints.velocity + NOISE[1] * noise[1], self._torque
        order = sorted(range(len(self._names)), key=self._names.__getitem__)
        told = JointState(name=['gripper', *(self._names[i] for i in order)])
        told.header.frame_id = 'base_link'
        told.header.stamp.sec, told.header.stamp.nanosec = divmod(stamp + round(1e9 * wake), 10**9)
        for name, row in zip(INTERFACES, rows, strict=True):
            known = name in self._interfaces and self._count >= EMPTY
            gripper = 0.01 if name == 'position' else np.nan
            setattr(told, name, [gripper, *(float(row[i]) if known else np.nan for i in order)])
        self._states.publish(stamp, told)

    def _show(self):
        joints = self._robot.measurement()
        if self._count % EVERY == 0:
            seen = [*joints.pose, *self._peaks, *joints.position]
            seen += self._states.stalls, self._states.dropped, self._count
            self._bench.publish(Float64MultiArray(data=list(map(float, seen))))
            self._peaks = np.zeros(2)
        self._count += 1

    def _fail(self, error):
        self.get_logger().fatal(str(error))


def nearest(manager, rate):
    """Cycles of the manager from one update of a controller to the next; rates in Hz."""
    cycles = 1
    while cycles * rate / manager < 1.0 - 0.5 * rate / manager:
        cycles += 1
    return cycles


class Gripper(Node):
    """A broadcaster of its own."""

    def __init__(self):
        super().__init__('gripper_broadcaster')
        self._states = self.create_publisher(JointState, 'joint_states', STATES)
        self.create_timer(GRIPPER, self._publish)

    def _publish(self):
        told = JointState(name=['gripper_left', 'gripper_right'], position=[0.01, 0.01])
        told.header.stamp = self.get_clock().now().to_msg()
        self._states.publish(told)


def main():
    """Run them; the first word says what is special, see Drives; gripper: whether there is one."""
    given = json.loads(sys.argv[1])
    rclpy.init()
    executor = SingleThreadedExecutor()
    if given.pop('gripper', False):
        executor.add_node(Gripper())
    drives = Drives(**given)
    executor.add_node(drives)
    drives.thread.start()
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        drives.thread.stop()
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
