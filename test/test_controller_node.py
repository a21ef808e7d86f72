"""The controller's node and the time: states that wait, and a node that stands still."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.clock import ClockType
from rclpy.parameter import Parameter
from rclpy.time import Time
from std_srvs.srv import Trigger

from parallel_robot_control import controller, joint_states
from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_control.safety.faults import (
    EMERGENCY_STOP,
    FAULTS,
    NONE,
    STATES_LATE,
    STATES_STALE,
)
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts, topics
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator
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
        self.message = Simulator(configure_plant(values)).message
        self._motion = trajectory_of(values).sample(np.zeros(1))
        self.stands = 0.0  # s, for which the node has stood still
        clock = SimpleNamespace(monotonic_ns=lambda: SECOND + round(1e9 * self.stands))
        monkeypatch.setattr(controller, 'time', clock)

    def give(self, stamp, age=0):
        """Torques of the commands that answer a state of a stamp [ns] and an age [ns]."""
        now = Time(nanoseconds=stamp + age, clock_type=ClockType.ROS_TIME)
        self.controller.get_clock().set_ros_time_override(now)
        joints = self.controller.loop.joints
        self.controller._on_reference(
            reference_messages(joints, np.array([stamp]), self._motion)[0].tobytes()
        )
        count = len(self._commands)
        self.controller._on_state(self.message(stamp))
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


def test_a_refusal_to_clear_is_published_with_its_reason(loop, monkeypatch):
    loop.give(SECOND)
    assert loop.give(SECOND + MS, AGE + MS) == []
    loop.stands = TIMEOUT * 1e-9 + 1e-3  # s
    loop.controller._watch()
    told = []
    monkeypatch.setattr(loop.controller._topics, 'publish_status', lambda *said: told.append(said))
    answer = loop.controller._answer_clear_fault(Trigger.Request(), Trigger.Response())
    assert not answer.success and answer.message == FAULTS[STATES_LATE].text
    assert [reason for _, reason in told] == [answer.message]


def of_joints(fields, **values):
    """A state of the robot with these fields alone, as a function of its stamp [ns]."""
    layout = layouts.joint_state(('joint1', 'joint2', 'joint3'), fields)
    position = trajectory_of(config.resolve('paper_circle')).sample(np.zeros(1)).position[0]
    return lambda stamp: layout.encode(stamp, position=position, **values)


NAN = {'velocity': [np.nan] * 3, 'effort': [np.nan] * 3}
OTHERWISE = 'estimator.kind filter or levant'
ODD = {  # states, their stamps [ns] and ages [ns], and what must be said of them
    'ahead': (None, 200 * MS, -200 * MS, 's ahead: cannot be latency; synchronise'),
    'a little ahead': (None, 20 * MS, -20 * MS, 'cannot be latency; synchronise'),
    'late': (
        None,
        -700 * MS,
        700 * MS,
        's old when they come and refused (safety.state_age 0.04 s)',
    ),
    'none': (of_joints(('position',)), 0, 0, 'velocity is missing or short; ' + OTHERWISE),
    'NaN': (of_joints(('position', *NAN), **NAN), 0, 0, 'not finite; ' + OTHERWISE),
}


@pytest.mark.parametrize('case', ODD)
def test_odd_states_are_told_at_once_and_once(case, loop, monkeypatch):
    message, ahead, age, text = ODD[case]
    monkeypatch.setattr(loop, 'message', message or loop.message)
    lines = lines_of(loop, monkeypatch)
    for _ in range(2):
        loop.give(time.time_ns() + ahead, age)
        loop.controller._publish_diagnostics()
    told = [line for line in lines if text in line]
    assert len(told) == 1 and 'joint states are ' in told[0]
    monkeypatch.setattr(joint_states, 'LATELY', 0.0)
    if case != 'a little ahead':  # which is answered
        assert not any(loop.controller.warnings().values())


def test_another_rate_of_the_states_is_told_and_nothing_is_skipped(loop, monkeypatch):
    lines = lines_of(loop, monkeypatch)
    for k in range(100):
        loop.give(SECOND + 2 * k * MS)
    figures = loop.controller.diagnose()
    loop.controller._publish_diagnostics()
    assert figures['skipped'] == '0'
    (line,) = (line for line in lines if 'come at' in line)
    assert line.startswith('joint states come at 500 Hz, the period says 1000 Hz: give the')


@pytest.mark.parametrize(('lost', 'cause'), [(0, 'never sent'), (100, 'sent in vain')])
def test_states_that_are_missing_are_told_once_with_their_cause(lost, cause, loop, monkeypatch):
    lines = lines_of(loop, monkeypatch)
    monkeypatch.setattr(loop.controller, 'lost', lambda topic: lost)
    for k in range(400):
        if k % 4:
            loop.give(SECOND + k * MS)
    figures = loop.controller.diagnose()
    assert figures['missing'] == '25 %, longest gap 2 ms'
    for _ in range(2):
        loop.controller._publish_diagnostics()
    (line,) = (line for line in lines if 'joint states: ' in line)
    assert line.startswith(f'joint states: 25 % {cause}, gap up to 2 ms: ')


def test_a_simulated_time_that_stands_is_told(loop, monkeypatch):
    lines = lines_of(loop, monkeypatch)
    loop.controller._publish_diagnostics()
    (line,) = lines
    assert line.startswith('use_sim_time is true and nobody publishes /clock')
    loop.give(SECOND)
    loop.controller._publish_diagnostics()
    assert sum('/clock' in line for line in lines) == 1
    kinds = {timer.clock.clock_type for timer in loop.controller.timers}
    assert kinds == {ClockType.STEADY_TIME}  # else nothing would watch the states


def lines_of(loop, monkeypatch):
    """List that grows by the warnings of the node."""
    lines = []

    def ignore(*_, **__):
        pass

    logger = SimpleNamespace(error=ignore, info=ignore)
    logger.warning = lambda text, **_: lines.append(text)
    logger.get_child = lambda _: logger
    monkeypatch.setattr(loop.controller, 'get_logger', lambda: logger)
    return lines


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
