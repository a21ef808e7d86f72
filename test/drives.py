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
"""

import json
import sys
import threading

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
from parallel_robot_model.processes.deadline import DeadlineThread
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.simulator import Simulator

SYSTEM_DEFAULT = QoSProfile(depth=10)
ORDER = ('gripper', 2, 0, 'lamp', 1)  # names, and indices of the joints
EMPTY = 20  # states before the hardware has written
NOISE = 5e-6, 2e-3  # rad, rad/s, rms
TURNS = 60  # samples for which a hand turns the joints
EVERY = 10  # samples from one message on `bench` to the next


class Drives(Node):
    """``joint_states``, ``effort_controller/commands``, a switch for the effort controller.

    Besides what ros2_control has: `bench`, what somebody sees who stands beside it, and `hand`,
    torques [N m] of one who releases the brakes for a moment and turns the joints.
    """

    def __init__(self, overrides, efforts):
        super().__init__('controller_manager')
        values = resolve('paper_circle', overrides)
        configuration = configure_plant(values)
        self._names = configuration.loop.joints
        self._robot, self._efforts = Simulator(configuration), efforts
        self._random = np.random.default_rng(1)
        self._turn = threading.Lock()
        n = len(self._names)
        self._active, self._command, self._hand = False, None, np.zeros(n)
        self._interface, self._torque, self._count = np.zeros(n), np.zeros(n), 0
        self._states = self.create_publisher(JointState, 'joint_states', SYSTEM_DEFAULT)
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
            self._publish(stamp)
            if self._active and self._command is not None:
                self._interface = self._command
            driven = self._active and np.isfinite(self._interface).all()
            self._torque = self._interface if driven else np.zeros_like(self._torque)
            self._peaks[0] = max(self._peaks[0], np.abs(self._torque).max())
            self._turns = max(0, self._turns - 1)
            if self._active or self._turns:
                self._robot.advance(self._torque + (self._hand if self._turns else 0.0))
            else:  # braked
                _, rate, _, time = self._robot._state
                rate[:] = 0.0
                time += 1e-9 * self.thread._period

    def _publish(self, stamp):
        seconds, nanoseconds = divmod(stamp, 10**9)
        joints, known = self._robot.measurement(), self._count >= EMPTY
        noise = self._random.normal(size=(2, len(self._names)))
        rows = [joints.position + NOISE[0] * noise[0], joints.velocity + NOISE[1] * noise[1]]
        rows.append(self._torque if self._efforts else np.full_like(self._torque, np.nan))
        told = JointState()
        told.header.stamp.sec, told.header.stamp.nanosec = seconds, nanoseconds
        told.name = [each if isinstance(each, str) else self._names[each] for each in ORDER]
        told.position, told.velocity, told.effort = (
            [np.nan if isinstance(i, str) or not known else row[i] for i in ORDER] for row in rows
        )
        self._states.publish(told)
        if self._count % EVERY == 0:
            seen = [*joints.pose, *self._peaks, *joints.position]
            self._bench.publish(Float64MultiArray(data=list(map(float, seen))))
            self._peaks = np.zeros(2)
        self._count += 1

    def _fail(self, error):
        self.get_logger().fatal(str(error))


def main():
    """Run them; the first word says what is special: overrides of the robot, efforts."""
    given = json.loads(sys.argv[1])
    rclpy.init()
    drives = Drives(given.get('overrides', {}), given.get('efforts', True))
    executor = SingleThreadedExecutor()
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
