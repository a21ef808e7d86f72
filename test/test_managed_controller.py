"""A controller with a life cycle: it sends nothing but while it is active."""

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from std_srvs.srv import Trigger

from parallel_robot_model.messages import topics

pytest_plugins = ['ros_fixtures']

MANAGED = ('--ros-args', '-p', 'controller.lifecycle:=true')
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, SHUTDOWN = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_INACTIVE_SHUTDOWN


class Loop:
    """A plant, a trajectory and a managed controller."""

    def __init__(self, launch, peer):
        self.peer = peer
        self.controller = launch('parallel_robot_control.controller_node', *MANAGED)
        self.plant = launch('parallel_robot_sim.plant_node')
        self.trajectory = launch('trajectory_gen.trajectory_node')
        self.commands = peer.listen(topics.COMMANDS)
        self.states = peer.listen(topics.JOINT_STATES)

    def change(self, transition):
        """Whether the controller takes a transition."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.peer.call(
            ChangeState, 'controller/change_state', request, self.controller
        ).success

    def state(self):
        request = GetState.Request()
        answer = self.peer.call(GetState, 'controller/get_state', request, self.controller)
        return answer.current_state.label

    def call(self, service):
        answer = self.peer.call(
            Trigger, f'controller/{service}', Trigger.Request(), self.controller
        )
        return answer.success, answer.message


@pytest.fixture
def loop(launch, peer):
    return Loop(launch, peer)


def test_commands_flow_while_the_controller_is_active(loop):
    assert loop.state() == 'unconfigured' and not loop.change(ACTIVATE)
    assert loop.change(CONFIGURE) and loop.state() == 'inactive'
    loop.peer.until(lambda: len(loop.states) > 100)
    assert not loop.commands and not loop.peer.node.count_publishers(topics.COMMANDS.name)
    assert loop.call('clear_fault') == (True, 'the controller is not active')
    loop.peer.until(lambda: loop.change(ACTIVATE))  # once references flow
    assert loop.state() == 'active'
    loop.peer.until(lambda: len(loop.commands) > 500)
    assert any(loop.commands[-1].data)
    assert loop.change(DEACTIVATE) and loop.state() == 'inactive'
    loop.peer.until(lambda: not loop.peer.node.count_publishers(topics.COMMANDS.name))
    loop.peer.until(lambda: not any(loop.commands[-1].data))  # of many that wait to be heard
    sent, heard = len(loop.commands), len(loop.states)
    loop.peer.until(lambda: len(loop.states) > heard + 100)
    assert len(loop.commands) == sent
    loop.peer.until(lambda: loop.change(ACTIVATE))
    loop.peer.until(lambda: len(loop.commands) > sent + 100)
    assert 'fault: the robot' not in loop.controller.stderr


def test_an_emergency_stop_and_another_controller_keep_it_from_becoming_active(loop, launch):
    assert loop.change(CONFIGURE)
    loop.peer.until(lambda: len(loop.states) > 100)
    assert loop.call('emergency_stop')[0] and not loop.change(ACTIVATE)
    assert 'not activated: emergency stop; ~/clear_fault ends it' in loop.controller.stderr
    assert loop.call('clear_fault')[0]
    other = loop.peer.publisher(topics.COMMANDS)
    assert not loop.change(ACTIVATE) and loop.state() == 'inactive'
    assert 'effort_controller/commands has a publisher already' in loop.controller.stderr
    loop.peer.node.destroy_publisher(other)
    loop.peer.until(lambda: loop.change(ACTIVATE))
    loop.peer.until(lambda: loop.commands)


def test_it_ends_when_it_is_shut_down(loop):
    assert loop.change(CONFIGURE) and loop.change(SHUTDOWN)
    assert loop.controller.wait() == 0
