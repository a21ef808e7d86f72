"""Messages of strangers in a loop that runs: it goes on, or says why not and can be reset."""

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.background import STATE_INDEX
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

JOINTS = [f'joint{k}' for k in (1, 2, 3)]
MESSAGES = 30  # of each kind
NEAR = [1.0, 2.0, 3.0]  # rad
CASES = {  # stamp of the stranger's state after one of the plant's
    'as it is': lambda sec, nanosec: (sec, nanosec),
    'a little ahead': lambda sec, nanosec: (sec, nanosec + 50_000_000),
    'far ahead': lambda sec, nanosec: (2**31 - 1, 999_999_999),
    'negative': lambda sec, nanosec: (-5, nanosec),
    'earliest': lambda sec, nanosec: (-(2**31), 0),
    'too many nanoseconds': lambda sec, nanosec: (sec, 4_000_000_000),
    'zero': lambda sec, nanosec: (0, 0),
}


class Loop:
    """Three nodes in processes of their own, and what they say of themselves."""

    def __init__(self, launch, peer, words):
        self.peer = peer
        names = ('plant', 'trajectory', 'controller')
        parameters = [word for pair in words for word in ('-p', pair)]
        self.start = lambda name: launch(MODULES[name], '--ros-args', *parameters)
        self.nodes = {name: self.start(name) for name in names}
        self.index, self.stamp = -1, (0, 0)
        self.alarms = dict.fromkeys(names, 'not heard of')
        peer.node.create_subscription(DiagnosticArray, '/diagnostics', self.hear, 10)
        peer.node.create_subscription(JointState, topics.JOINT_STATES.name, self.see, 1)
        self.stranger = peer.publisher(topics.JOINT_STATES)

    def hear(self, message):
        for status in message.status:
            assert status.hardware_id[1:] in self.nodes
            failed = status.level == DiagnosticStatus.ERROR
            self.alarms[status.hardware_id[1:]] = status.message if failed else ''
            values = {item.key: item.value for item in status.values}
            self.index = int(values.get(STATE_INDEX, self.index))

    def see(self, message):
        if list(message.position) != NEAR:
            self.stamp = message.header.stamp.sec, message.header.stamp.nanosec

    def attack(self, *cases):
        for k in range(MESSAGES):
            for case in cases:
                sec, nanosec = CASES[case](*self.stamp)
                message = JointState(name=JOINTS, position=NEAR, velocity=[0.0] * 3)
                message.header.stamp = Time(sec=sec, nanosec=nanosec % 2**32)
                self.stranger.publish(message)
            if k % 10 == 0:
                self.peer.spin(0.001)

    def call(self, name):
        node = name.partition('/')[0]
        return self.peer.call(Trigger, name, Trigger.Request(), self.nodes[node])

    def alarm(self):
        return ''.join(self.alarms.values())

    def moves(self):
        """Wait until the plant has gone on, and nothing is wrong any more."""
        before = self.index
        self.peer.until(lambda: self.call('controller/clear_fault') and self.index != before)
        self.peer.until(lambda: self.call('controller/clear_fault') and not self.alarm())


@pytest.mark.endurance
@pytest.mark.parametrize('time_mode', ['lockstep', 'wall'])
def test_a_loop_goes_on_after_joint_states_of_strangers(time_mode, launch, peer):
    loop = Loop(launch, peer, [f'time_mode:={time_mode}', 'duration:=0'])
    loop.moves()
    for cases in [*([case] for case in CASES), [*CASES]]:
        loop.attack(*cases)
        assert loop.call('plant/reset').success
        loop.moves()
    for node in loop.nodes.values():
        assert node.end(2) == 0 and 'unforeseen' not in node.stderr


def test_commands_of_a_stranger_are_told_by_name_in_lockstep_too(launch, peer):
    loop = Loop(launch, peer, ['time_mode:=lockstep', 'duration:=0'])
    loop.moves()
    stranger = peer.publisher(topics.COMMANDS)
    line = '/effort_controller/commands has 2 publishers: /controller, /peer'

    def told(node):
        stranger.publish(Float64MultiArray(data=[0.5, 0.5, 0.5]))  # the first ones may be lost
        return line in loop.nodes[node].stderr

    for node in ('plant', 'controller'):
        loop.nodes[node].until(lambda node=node: told(node))
    peer.until(lambda: 'messages of two publishers, all' in loop.nodes['plant'].stderr)
    peer.until(lambda: 'another node publishes' in loop.alarms['controller'])
    answer = loop.call('controller/clear_fault')
    assert not answer.success and line in answer.message
    peer.node.destroy_publisher(stranger)
    loop.moves()


def test_a_lockstep_that_stands_still_says_why_and_goes_on(launch, peer):
    loop = Loop(launch, peer, ['time_mode:=lockstep', 'duration:=0'])
    loop.moves()
    assert loop.nodes['trajectory'].end(2) == 0
    peer.until(lambda: 'waits for its reference' in loop.alarms['controller'])
    peer.until(lambda: 'no command for' in loop.alarms['plant'])
    peer.until(lambda: 'no command for' in loop.nodes['plant'].stderr)
    loop.nodes['trajectory'] = loop.start('trajectory')
    loop.moves()
