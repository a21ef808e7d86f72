"""Services of the plant: pause, step, resume, and back to the beginning."""

import numpy as np
import pytest
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.nodes.background import OUTSIDE, STATE_INDEX
from parallel_robot_sim.plant_core import state_layout
from parallel_robot_sim.plant_node import PlantNode

pytest_plugins = ['ros_fixtures']

MS = 10**6  # ns
SECOND = 10**9  # ns
COMMAND = layouts.float64_multi_array(3).encode(data=[1.0, -2.0, 0.5])


def call(plant, name):
    return getattr(plant, f'_answer_{name}')(Trigger.Request(), Trigger.Response())


class Rig:
    """A plant in this process, and the states that it has published."""

    def __init__(self, node):
        self.plant, self.states = node(PlantNode, topics.JOINT_STATES)
        self.plant.missing = lambda: ''  # nobody else is here

    def begin(self):
        """Publish the first state (lockstep)."""
        while not self.states:
            self.plant._poll()

    def command(self, times=1, data=COMMAND):
        for _ in range(times):
            self.plant.take_command(data)


@pytest.fixture
def rig(node):
    return Rig(node)


lockstep = pytest.mark.parametrize('node', ['lockstep'], indirect=True)
wall = pytest.mark.parametrize('node', ['wall'], indirect=True)


@lockstep
def test_a_pause_and_steps_change_no_state(rig):
    rig.begin()
    rig.command(20)
    undisturbed = rig.states[:]
    assert len(undisturbed) == 21
    assert call(rig.plant, 'reset').success
    rig.command()  # it was on its way, and has no effect
    del rig.states[:]
    rig.plant._published_at = 0  # a while ago
    rig.begin()
    assert rig.states == undisturbed[:1]
    rig.command(4)
    answer = call(rig.plant, 'pause')
    assert answer.success and answer.message == 'paused at state 4'
    rig.command()  # it was on its way, and is kept
    assert rig.states == undisturbed[:5]
    result = rig.plant.set_parameters_atomically([Parameter('plant.steps', value=3)])
    assert result.successful
    assert call(rig.plant, 'step').message == '2 steps to go at state 5'
    rig.command(9)  # for two of them
    assert rig.states == undisturbed[:8]
    assert call(rig.plant, 'resume').message.startswith('running at state')
    rig.command(20)
    assert rig.states[:21] == undisturbed


@lockstep
@pytest.mark.parametrize('steps', [0, -1, 2.5, 'many', True])
def test_a_number_of_steps_that_is_none_is_refused(steps, rig):
    result = rig.plant.set_parameters_atomically([Parameter('plant.steps', value=steps)])
    assert not result.successful
    assert rig.plant.get_parameter('plant.steps').value == rig.plant.values['plant.steps'] == 1


@wall
def test_a_reset_puts_back_a_robot_that_was_driven_out(rig):
    """It stays silent and says so, until somebody resets it; then the next command moves it."""
    plant, stamp = rig.plant, SECOND
    plant.tick(stamp)
    start = layouts.header_stamp(rig.states[0]), rig.states[0][12:]
    torque = layouts.float64_multi_array(3).encode(data=[200.0, 200.0, 200.0])
    while not plant.alarm():
        rig.command(data=torque)
        stamp += MS
        plant.tick(stamp)
        assert stamp < 20 * SECOND
    assert 'driven out of its workspace' in plant.alarm() and '~/reset' in plant.alarm()
    assert plant.diagnose()[OUTSIDE] and plant.diagnose()[STATE_INDEX] == len(rig.states) - 1
    told = len(rig.states)
    plant.tick(stamp + MS)
    assert len(rig.states) == told
    layout = state_layout(plant.loop.joints, 3)
    assert all(np.isfinite(layout.decode(data)['position']).all() for data in rig.states)
    assert call(plant, 'reset').success
    plant.tick(stamp + 2 * MS)
    assert not plant.alarm() and rig.states[told][12:] == start[1]
    assert not plant.diagnose()[OUTSIDE] and STATE_INDEX not in plant.diagnose()
    rig.command(data=torque)
    plant.tick(stamp + 3 * MS)
    plant.tick(stamp + 4 * MS)
    assert rig.states[-1][12:] != start[1]
