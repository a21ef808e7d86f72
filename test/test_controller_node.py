"""The controller's node and the time: states that wait, and a node that stands still."""

from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.clock import ClockType
from rclpy.parameter import Parameter
from rclpy.time import Time
from std_srvs.srv import Trigger

from parallel_robot_base import config, layouts, topics
from parallel_robot_control import controller, controller_state
from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_control.faults import EMERGENCY_STOP, NONE, STATES_LATE, STATES_STALE
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.simulator import Simulator
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.messages import reference_messages

pytest_plugins = ['ros_fixtures']
pytestmark = pytest.mark.parametrize('node', ['wall'], indirect=True)

SECOND, MS = 10**9, 10**6  # ns
AGE = round(config.resolve('paper_circle')['safety.state_age'] * 1e9)  # ns
TIMEOUT = round(config.resolve('paper_circle')['safety.state_timeout'] * 1e9)  # ns


class Loop:
    """A node and the states of a plant at rest, at times that the test sets."""

    def __init__(self, node, monkeypatch):
        self.controller, self._commands = node(ControllerNode, topics.COMMANDS)
        values = config.resolve('paper_circle')
        self._plant = Simulator(configure_plant(values))
        self._motion = trajectory_of(values).sample(np.zeros(1))
        self.stands = 0.0  # s, for which the node has stood still
        clock = SimpleNamespace(monotonic_ns=lambda: SECOND + round(1e9 * self.stands))
        for module in (controller, controller_state):
            monkeypatch.setattr(module, 'time', clock)

    def give(self, stamp, age=0):
        """Torques of the commands that answer a state of a stamp [ns] and an age [ns]."""
        now = Time(nanoseconds=stamp + age, clock_type=ClockType.ROS_TIME)
        self.controller.get_clock().set_ros_time_override(now)
        joints = self.controller.loop.joints
        self.controller._on_reference(
            reference_messages(joints, np.array([stamp]), self._motion)[0].tobytes()
        )
        count = len(self._commands)
        self.controller._on_state(self._plant.message(stamp))
        layout = layouts.float64_multi_array(len(joints))
        return [layout.decode(data)['data'][0] for data in self._commands[count:]]

    @property
    def fault(self):
        return self.controller._controller.fault


@pytest.fixture
def loop(node, monkeypatch):
    return Loop(node, monkeypatch)


def test_states_that_are_too_old_are_as_none_and_a_fault_of_their_own(loop):
    assert len(loop.give(SECOND, AGE)) == 1
    assert loop.give(SECOND + MS, AGE + MS) == [] and loop.fault == NONE
    assert loop.controller.counts['joint states that are too old'] == 1
    loop.stands = TIMEOUT * 1e-9 + 1e-3  # s
    loop.controller._watch()
    assert loop.fault == STATES_LATE


def test_a_node_that_stood_still_does_not_go_on_as_if_nothing_were(loop):
    (torque,) = loop.give(SECOND)
    assert torque.any()
    loop.stands = 1.0  # s
    for k in range(1, 5):  # what waited in its queue
        commands = loop.give(SECOND + k * MS, SECOND - k * MS)
        assert [command.any() for command in commands] == [False] * (k == 1)
        assert loop.fault == STATES_STALE
    (torque,) = loop.give(2 * SECOND)
    assert not torque.any()  # the safe action of a robot at rest
    assert loop.controller._controller.clear_fault() == ''


def test_a_pose_is_told_by_a_parameter_in_a_fault_alone(loop):
    """And asked for by a service."""
    loop.give(SECOND)
    pose = config.resolve('paper_circle')['plant.initial_pose']
    near = [Parameter('controller.guess', value=[0.52, 0.36, 1.5])]
    result = loop.controller.set_parameters_atomically(near)
    assert not result.successful and 'in a fault alone' in result.reason
    answer = loop.controller._answer_confirm_pose(Trigger.Request(), Trigger.Response())
    assert not answer.success and answer.message == 'the pose is known'
    loop.controller._controller.trip(EMERGENCY_STOP)
    result = loop.controller.set_parameters_atomically(near)
    assert result.successful
    believed = loop.controller._controller.state.pose
    assert np.abs(np.array(believed) - pose).max() < 1e-9
    assert loop.controller.get_parameter('controller.guess').value == [0.52, 0.36, 1.5]
    both = [*near, Parameter('law', value='pid')]
    assert loop.controller.set_parameters_atomically(both).successful
    both[0] = Parameter('controller.guess', value=[0.5, 0.36, 1.5])
    result = loop.controller.set_parameters_atomically(both)
    assert not result.successful and 'request of its own' in result.reason
