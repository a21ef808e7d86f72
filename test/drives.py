"""Drives with brakes behind ros2_control, as far as the suite meets them; the robot is simulated.

What is copied from ros2_controllers (forward_command_controller, effort_controllers,
joint_state_broadcaster):

- An empty command is dropped without a word, one that is not finite with a warning; the last
  one is handed on for ever. While the effort controller is inactive, nothing is handed on, and
  what came then is forgotten.
- A command of another length is an error, after which the controller manager deactivates it.
- When it is deactivated, the efforts become zero; here, the brakes close too, and open when it is
  activated. The states go on.
- The joints are in an order of their own, with others among them, and NaN stands for what there
  is no interface for, and for all until the hardware has written.
- Stamps tell when an update begins, which jitters; what it publishes leaves in order, later.
  A cycle that is missed tells nothing, while the last torque acts on.

A gripper may have a broadcaster of its own, on the same topic.
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
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from parallel_robot_control.configuration import resolve
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.realtime import DeadlineThread
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator

SYSTEM_DEFAULT = QoSProfile(depth=10)
ORDER = ('gripper', 2, 0, 'lamp', 1)  # names, and indices of the joints
GRIPPER = 0.02  # s, period of the states of a gripper with a broadcaster of its own
EMPTY = 20  # states before the hardware has written
NOISE = 5e-6, 2e-3  # rad, rad/s, rms
TURNS = 60  # samples for which a hand turns the joints
EVERY = 10  # samples from one message on `bench` to the next


class Wire(threading.Thread):
    """Publishes messages in order, each some time after its stamp."""

    def __init__(self, publisher, delays):
        super().__init__(daemon=True)
        self._publisher, (self._least, self._most) = publisher, delays
        self._random = np.random.default_rng(2)
        self._waiting = queue.SimpleQueue()

    def publish(self, stamp, message):
        if self._most:
            delay = self._random.uniform(self._least, self._most)
            self._waiting.put((stamp * 1e-9 + delay, message))
        else:
            self._publisher.publish(message)

    def run(self):
        while True:
            due, message = self._waiting.get()
            time.sleep(max(0.0, due - time.time()))
            self._publisher.publish(message)


class Drives(Node):
    """``joint_states``, ``effort_controller/commands``, a switch for the effort controller.

    Besides what ros2_control has: `bench`, what somebody sees who stands beside it, and `hand`,
    torques [N m] of one who releases the brakes for a moment and turns the joints.
    """

    def __init__(self, overrides=None, efforts=True, late=(0.0, 0.0), jitter=0.0, active=False):
        """Put the robot at its initial pose.

        Args:
            overrides: Parameters of the robot, and the period.
            efforts: Whether the drives tell them.
            late: Least and largest age of states when they are published [s].
            jitter: Largest delay of an update [s].
            active: Whether the effort controller begins active.
        """
        super().__init__('controller_manager')
        values = resolve('paper_circle', overrides or {})
        configuration = configure_plant(values)
        self._names = configuration.loop.joints
        self._robot, self._efforts = Simulator(configuration), efforts
        self._random = np.random.default_rng(1)
        self._turn = threading.Lock()
        n = len(self._names)
        self._active, self._command, self._hand = active, None, np.zeros(n)
        self._interface, self._torque, self._count = np.zeros(n), np.zeros(n), 0
        states = self.create_publisher(JointState, 'joint_states', SYSTEM_DEFAULT)
        self._states, self._jitter = Wire(states, late), jitter
        self._states.start()
        self._bench = self.create_publisher(Float64MultiArray, 'bench', QoSProfile(depth=1000))
        self._turns, self._peaks = 0, np.zeros(2)  # of the hand; of torque and command [N m]
        commands = topics.COMMANDS.name
        self.create_subscription(Float64MultiArray, commands, self._on_command, SYSTEM_DEFAULT)
        self.create_subscription(Float64MultiArray, 'hand', self._on_hand, SYSTEM_DEFAULT)
        self.create_service(SetBool, '~/switch', self._on_switch)
        self.thread = DeadlineThread(configuration.loop.period_ns, self._update, self._fail)

    def _on_command(self, message):
        with self._turn:
            command = np.array(message.data)
            if len(command) not in (0, len(self._names)):
                self._switch(False)
            elif len(command) and np.isfinite(command).all():
                self._command = command
                self._peaks[1] = max(self._peaks[1], np.abs(command).max())

    def _on_hand(self, message):
        with self._turn:
            self._hand, self._turns = np.array(message.data), TURNS

    def _on_switch(self, request, response):
        with self._turn:
            self._switch(request.data)
        response.success = True
        return response

    def _switch(self, active):
        self._active, self._command = active, None
        self._interface = np.zeros_like(self._interface)

    def _update(self, stamp):
        """One turn of the controller manager: read, update, write."""
        with self._turn:
            if time.time_ns() - stamp < self.thread._period:
                self._publish(stamp)
            self._show()
            if self._active and self._command is not None:
                self._interface = self._command
            driven = self._active and np.isfinite(self._interface).all()
            self._torque = self._interface if driven else np.zeros_like(self._torque)
            self._peaks[0] = max(self._peaks[0], np.abs(self._torque).max())
            self._turns = max(0, self._turns - 1)
            if self._active or self._turns:
                self._robot.advance(self._torque + (self._hand if self._turns else 0.0))
            else:  # braked
                _, rate, _, passed = self._robot._state
                rate[:] = 0.0
                passed += 1e-9 * self.thread._period

    def _publish(self, stamp):
        wake = self._random.uniform(0.0, self._jitter)
        seconds, nanoseconds = divmod(stamp + round(1e9 * wake), 10**9)
        joints, known = self._robot.measurement(), self._count >= EMPTY
        noise = self._random.normal(size=(2, len(self._names)))
        rows = [joints.position + joints.velocity * wake + NOISE[0] * noise[0]]
        rows.append(joints.velocity + NOISE[1] * noise[1])
        rows.append(self._torque if self._efforts else np.full_like(self._torque, np.nan))
        told = JointState()
        told.header.stamp.sec, told.header.stamp.nanosec = seconds, nanoseconds
        told.name = [each if isinstance(each, str) else self._names[each] for each in ORDER]
        told.position, told.velocity, told.effort = (
            [np.nan if isinstance(i, str) or not known else row[i] for i in ORDER] for row in rows
        )
        self._states.publish(stamp, told)

    def _show(self):
        joints = self._robot.measurement()
        if self._count % EVERY == 0:
            seen = [*joints.pose, *self._peaks, *joints.position, self._count]
            self._bench.publish(Float64MultiArray(data=list(map(float, seen))))
            self._peaks = np.zeros(2)
        self._count += 1

    def _fail(self, error):
        self.get_logger().fatal(str(error))


class Gripper(Node):
    """A broadcaster of its own."""

    def __init__(self):
        super().__init__('gripper_broadcaster')
        self._states = self.create_publisher(JointState, 'joint_states', SYSTEM_DEFAULT)
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
