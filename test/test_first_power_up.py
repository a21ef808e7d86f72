"""docs/hardware.md, First power-up: its commands, as they stand there, on drives with brakes."""

import json
import os
import re
import shlex
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from drives import EFFORT, EVERY
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_fixtures import PERIOD, RECENT, STATE_TIMEOUT
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from parallel_robot_model.configuration import plain_data
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
MANAGER = ROOT / 'config' / 'hardware' / 'ros2_control.yaml'
MANAGED, PARAMETERS = 'controller_manager', 'ros__parameters'
PATH = f'{ROOT}{os.pathsep}{ROOT / "test"}'  # of the drives
BENCH = Topic('bench', 'std_msgs/msg/Float64MultiArray')
PATIENT = [  # on a machine that is shared; strict.yaml is for one that is not
    f'period:={PERIOD}',
    f'safety.state_timeout:={STATE_TIMEOUT}',
    'safety.reference_timeout:=60.0',
]
DRIVES = {  # the robot is heavier than the one that is assumed
    'period': PERIOD,
    'plant.initial_pose': [0.5, 0.39, 1.5],
    'true_robot.m1': 5.9,
    'true_robot.m2': 8.5,
}
SECOND = round(1.0 / (EVERY * PERIOD))  # messages of the bench
XY, TORQUE, COMMAND, JOINTS = slice(0, 2), 3, 4, slice(5, 8)  # in each of them
CALM = 3.0  # N m; friction takes 0.5, the way back of some millimetres 2
STILL = 1e-3  # m


def steps():
    """Commands of the page by the title of their step."""
    page = (ROOT / 'docs' / 'hardware.md').read_text()
    _, *parts = re.split(r'^### \d+\. (.*)$', page[page.index('## First power-up') :], flags=re.M)
    blocks = (re.findall(r'```bash\n(.*?)```', text, re.DOTALL) for text in parts[1::2])
    return {
        title: [line for block in found for line in block.splitlines()]
        for title, found in zip(parts[::2], blocks, strict=True)
    }


STEPS = steps()


class Bench:
    """A robot with drives, and what one does at it."""

    def __init__(self, launch, peer, folder, **given):
        self._launch, self.peer, self._folder = launch, peer, folder
        self.nodes, self._given = {}, given
        shutil.copy(ROOT / 'config' / 'hardware' / 'strict.yaml', folder)
        self.seen = peer.listen(BENCH)
        self.references = peer.listen(topics.POSE_REFERENCE)
        self.statuses = peer.listen(topics.STATUS, RECENT)

    def take(self, title, law=None):
        """Do all commands of a step; returns what they answered."""
        return [self.run(line, law) for line in STEPS[title]]

    def run(self, line, law=None):
        """Do what a command of the page asks for."""
        words = shlex.split(line)
        match words:
            case [
                'chrt',
                '-f',
                '25',
                'ros2',
                'run',
                'controller_manager',
                'ros2_control_node',
                *_,
            ]:
                assert Path(words[-1]).name == MANAGER.name
                given = json.dumps({'overrides': DRIVES, **self._given})
                self.nodes['drives'] = self._launch('drives', given, PYTHONPATH=PATH)
                self.until(lambda: len(self.seen) > SECOND)
                return None
            case ['ros2', 'run', 'controller_manager', 'spawner', name, *options]:
                assert name in plain_data.load(MANAGER.read_text())[MANAGED][PARAMETERS]
                assert options == {EFFORT: ['--inactive']}.get(name, [])
                return None
            case ['ros2', 'run', 'parallel_robot', node, *rest]:
                known = [word for parameter in PATIENT for word in ('-p', parameter)]
                if law and node == 'controller':
                    known += ['-p', f'law:={law}']
                self.nodes[node] = self._launch(MODULES[node], *rest, *known)
                self.peer.see(f'/{node}')
                return self.nodes[node]
            case ['ros2', 'control', 'switch_controllers', how, *names]:
                on = {'--activate': True, '--deactivate': False}[how]
                return all(self.switch(name, on) for name in names)
            case ['ros2', 'control', 'set_hardware_component_state', name, 'active']:
                return self.switch(name, True)
            case ['ros2', 'service', 'call', name, 'std_srvs/srv/Trigger']:
                node = name.split('/')[1]
                return self.call(Trigger, name, Trigger.Request(), node)
            case ['ros2', 'param', 'set', node, key, value]:
                parameters = [Parameter(key, value=plain_data.load(value)).to_parameter_msg()]
                request = SetParameters.Request(parameters=parameters)
                name = node.strip('/')
                (result,) = self.call(
                    SetParameters, f'{node}/set_parameters', request, name
                ).results
                assert result.successful, result.reason
                return result
            case ['.venv/bin/parallel_robot', *rest]:
                process = self._launch('parallel_robot.cli.command_line', *rest)
                assert process.wait() == 0, process.stderr
                return process.stdout
        raise AssertionError(f'what does {line} ask for?')

    def switch(self, name, on):
        """Whether a controller or the component could be switched."""
        request = SetBool.Request(data=on)
        return self.call(SetBool, f'{MANAGED}/{name}', request, 'drives').success

    def call(self, kind, name, request, node):
        return self.peer.call(kind, name, request, self.nodes[node])

    def until(self, condition):
        self.peer.until(condition)

    def wait(self, seconds):
        """Let the robot live for some time, as its states tell it."""
        count = len(self.seen) + round(seconds * SECOND)
        self.until(lambda: len(self.seen) > count)

    def fault(self):
        """Text of the fault; empty without one, None while it is not known."""
        if not self.statuses:
            return None
        (status,) = self.statuses[-1].status
        return status.message if status.level == DiagnosticStatus.ERROR else ''

    def until_fault(self, text):
        self.until(lambda: text in (self.fault() or ''))

    def until_it_acts(self):
        """Clear the fault, when its cause is gone, and wait until the law asks for torque."""
        clear = 'ros2 service call /controller/clear_fault std_srvs/srv/Trigger'
        count = len(self.seen)
        self.until(lambda: self.run(clear).success)
        self.until(lambda: any(one.data[COMMAND] for one in self.seen[count:]))

    def distance(self, first):
        """How far the true end effector was from where it is in a message [m]."""
        points = np.array([one.data[XY] for one in self.seen[first:]])
        return float(np.linalg.norm(points - points[0], axis=1).max())

    def torque(self, first=0):
        """Largest torque that the drives have applied since a message [N m]."""
        return max(one.data[TORQUE] for one in self.seen[first:])

    def angles(self):
        """Of the joints [rad]."""
        return np.array(self.seen[-1].data[JOINTS])


@pytest.fixture
def bench(launch, peer, tmp_path):
    return lambda **given: Bench(launch, peer, tmp_path, **given)


@pytest.mark.endurance
def test_the_page_is_calm_word_by_word(bench):
    robot = bench()
    titles = iter(STEPS)

    assert next(titles) == 'The controller, stopped'
    *_, shown = robot.take('The controller, stopped')
    robot.until_fault('emergency stop')
    assert 'emergency stop' in shown and 'joints (rad, rad/s)' in shown

    assert next(titles) == 'Signs and order'
    hand = robot.peer.publisher(Topic('hand', 'std_msgs/msg/Float64MultiArray'))
    for joint in range(3):
        before = robot.angles()
        hand.publish(Float64MultiArray(data=[6.0 * (k == joint) for k in range(3)]))
        robot.until(lambda: robot.angles()[joint] > before[joint] + 0.02)  # noqa: B023
        robot.wait(2.0)  # the brakes are on again
        shown = robot.run('.venv/bin/parallel_robot top')
        told = [float(re.search(rf'joint{k} +(-?[\d.]+)', shown).group(1)) for k in (1, 2, 3)]
        np.testing.assert_allclose(told, robot.angles(), atol=1e-3)
    assert not any(one.data[COMMAND] for one in robot.seen)

    assert next(titles) == 'The pose'
    assert not robot.references
    (trajectory,) = robot.take('The pose')
    robot.until(lambda: robot.references)
    trajectory.until(lambda: 'holds the pose in which the robot is' in trajectory.stderr)

    assert next(titles) == 'Noise'
    recorder, identify = STEPS['Noise']
    process = robot.run(recorder)
    subscribers = robot.peer.node.get_subscriptions_info_by_topic
    robot.until(lambda: 'recorder' in {one.node_name for one in subscribers('/reference')})
    robot.wait(3.0)
    assert process.end(signal.SIGINT) == 0
    assert 'sensor noise in' in robot.run(identify)

    assert next(titles) == 'Drives on'
    begun = len(robot.seen)
    robot.take('Drives on')
    robot.wait(2.0)
    assert robot.distance(begun) < 1e-6 and robot.torque() == 0.0

    assert next(titles) == 'The first torque'
    (answer,) = robot.take('The first torque')
    assert answer.success
    robot.until(lambda: robot.fault() == '' and robot.seen[-1].data[COMMAND])
    robot.wait(3.0)
    assert robot.distance(begun) < STILL and robot.torque() < CALM

    assert next(titles) == 'Emergency stop, before you need it'
    stop, clear, off, on, again = STEPS['Emergency stop, before you need it']
    assert robot.run(stop).success
    robot.until_fault('emergency stop')
    robot.wait(1.0)
    assert robot.run(clear).success
    robot.until(lambda: robot.fault() == '')
    robot.wait(1.0)
    robot.run(off)
    robot.wait(2.0)
    robot.run(on)
    robot.wait(1.0)
    assert robot.run(again).success
    robot.until(lambda: robot.fault() == '')
    robot.wait(2.0)
    assert robot.distance(begun) < STILL and robot.torque() < CALM
    assert robot.nodes['controller'].end(signal.SIGKILL) == -signal.SIGKILL
    robot.run(off)  # else the last torque stays
    nodes = robot.peer.node.get_node_names
    robot.until(lambda: 'controller' not in nodes())  # calls would go to it
    robot.statuses.clear()
    _, _, _, controller, _ = STEPS['The controller, stopped']
    robot.run(controller)  # somebody starts it again
    robot.until_fault('emergency stop')
    robot.run(on)
    robot.wait(1.0)
    robot.run(again)
    robot.until(lambda: robot.fault() == '')
    robot.wait(2.0)
    assert robot.distance(begun) < STILL and robot.torque() < CALM

    assert next(titles) == 'Drives in error, before you need it'
    component, controllers, clear = STEPS['Drives in error, before you need it']
    erred = len(robot.seen)
    assert robot.call(Trigger, f'{MANAGED}/err', Trigger.Request(), 'drives').success
    robot.until_fault('no joint state came for too long')
    assert not robot.run(controllers)  # the component comes first
    for line in (component, controllers):
        assert robot.run(line)
        robot.wait(1.0)
    assert robot.torque(erred + SECOND // 2) == 0.0
    robot.until(lambda: robot.run(clear).success)
    robot.until(lambda: robot.fault() == '' and robot.seen[-1].data[COMMAND])
    robot.wait(2.0)
    assert robot.distance(begun) < STILL and robot.torque(erred) < CALM

    assert next(titles) == 'Identify'
    heard = len(robot.references)
    robot.take('Identify')
    robot.wait(6.0)  # more than half the way to the excitation
    way = [(one.pose.position.x, one.pose.position.y) for one in robot.references[heard - 1 :]]
    assert np.linalg.norm(np.subtract(way[-1], way[0])) > 0.02
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 0.1 * 10 * PERIOD  # m: it is led
    assert robot.fault() == ''

    assert [*titles] == ['Slowly, then fast']


@pytest.mark.endurance
@pytest.mark.parametrize('law', ['s_fotsmc', 'pid', 'observer_s_fotsmc'])
def test_drives_that_come_late_or_go_and_come_again_throw_nobody(bench, law):
    """Also out of the order of the page, and with laws that integrate."""
    robot = bench()
    for title in ('The controller, stopped', 'The pose'):
        for line in STEPS[title]:
            if ' top' not in line:
                robot.run(line, law)
    robot.until(lambda: robot.references)
    robot.until_fault('emergency stop')
    robot.until_it_acts()
    robot.wait(10.0)  # brakes on
    begun = len(robot.seen)
    robot.take('Drives on')
    robot.until_it_acts()
    robot.wait(4.0)
    assert robot.distance(begun) < STILL and robot.torque(begun) < CALM
    _, _, off, on, _ = STEPS['Emergency stop, before you need it']
    for _ in range(2):
        robot.run(off)
        robot.wait(4.0)
        robot.run(on)
        robot.until_it_acts()
        robot.wait(3.0)
    assert robot.distance(begun) < STILL and robot.torque(begun) < CALM
