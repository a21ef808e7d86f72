"""A trajectory node in the process of a test, sample by sample, and what it publishes."""

import numpy as np
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from parallel_robot_model.configuration.loop import STEP_START
from parallel_robot_model.messages import topics
from trajectory_gen.trajectory_node import TrajectoryNode

PERIOD = 1_000_000  # ns


class Run:
    """A trajectory node in this process."""

    def __init__(self, node):
        self.node, self._sent = node(TrajectoryNode, topics.REFERENCE)
        self.node.set_start(STEP_START)
        self._k = 0

    def go(self, samples):
        for _ in range(samples):
            stamp = STEP_START + self._k * PERIOD
            if self.node.lockstep:
                state = JointState()
                state.header.stamp.sec, state.header.stamp.nanosec = divmod(stamp, 10**9)
                self.node._on_state(serialize_message(state))
            else:
                self.node._tick(stamp)
            self._k += 1

    def ask(self, asked):
        """Send a message with a motion."""
        self.node._on_motion(asked if isinstance(asked, bytes) else serialize_message(asked))

    def set(self, **changes):
        """Reason why changes are refused, empty if they are not; '__' for the dot of a key."""
        wanted = [Parameter(k.replace('__', '.'), value=v) for k, v in changes.items()]
        result = self.node.set_parameters_atomically(wanted)
        assert result.successful == (not result.reason) and '\n' not in result.reason
        return result.reason

    @property
    def told(self):
        """Words of the newest motion, and the sample at which it begins."""
        text = self.node.get_parameter('granted.motion').value
        stamp = int(text.split(' from stamp ')[1].split()[0])
        return text, (stamp - STEP_START) // PERIOD

    def heard(self):
        """Stamps [samples], position, velocity, acceleration of all that was published."""
        all_ = [deserialize_message(data, JointTrajectory) for data in self._sent]
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in all_]
        k = (np.array(stamps) - STEP_START) // PERIOD
        names = ('positions', 'velocities', 'accelerations')
        return k, *(np.array([getattr(m.points[0], name) for m in all_]) for name in names)


def smooth(k, position, velocity, acceleration):
    """Whether velocity and acceleration are the derivatives, without a jump in any of them."""
    assert (np.diff(k) == 1).all()
    dt = 1e-9 * PERIOD
    for value, rate in ((position, velocity), (velocity, acceleration)):
        mean = 0.5 * (rate[1:] + rate[:-1])
        np.testing.assert_allclose(np.diff(value, axis=0) / dt, mean, atol=5e-4)
    assert np.abs(np.diff(acceleration, axis=0)).max() < 1.0  # rad/s^2, in a sample
