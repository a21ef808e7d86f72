"""The nodes beside a joint_state_broadcaster and an effort group controller, see drives.py."""

import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from drives import EVERY
from ros_fixtures import RECENT
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.processes.node_processes import MODULES
from trajectory_gen.configuration import trajectory_of

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
PATH = f'{ROOT}{os.pathsep}{ROOT / "test"}'
BENCH = Topic('bench', 'std_msgs/msg/Float64MultiArray')
XY, POSE, TORQUE, STATES = slice(0, 2), slice(0, 3), 3, -1  # in its messages
VALUES = config.resolve('paper_circle')
CENTER, RADIUS = VALUES['circle.center'], VALUES['circle.radius']
PATIENT = [  # on a machine that is shared
    'safety.reference_timeout:=60.0',
    'safety.state_age:=5.0',
    'law:=computed_torque',
]
WAY = 0.03  # m, along which it is looked at how it tracks
NEAR = 2e-4  # m, from the path
RETURNED = 20  # messages of the bench, over which it is near again


class Bus:
    """Drives, and the nodes that move them."""

    def __init__(self, launch, peer, period):
        self._launch, self.peer, self.period = launch, peer, period
        self.seen = peer.listen(BENCH)
        self.statuses = peer.listen(topics.STATUS, RECENT)
        self.figures = {}  # of the controller, as it told them last
        peer.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_figures, 10)

    def _on_figures(self, array):
        for status in array.status:
            if status.hardware_id == '/controller':
                self.figures = {each.key: each.value for each in status.values}

    def start_drives(self, pose, **given):
        overrides = {'period': self.period, 'plant.initial_pose': [*map(float, pose)]}
        words = json.dumps({'overrides': overrides, **given})
        self.drives = self._launch('drives', words, PYTHONPATH=PATH)

    def start_nodes(self, *more):
        for name in ('controller', 'trajectory'):
            words = [word for each in (*PATIENT, *more) for word in ('-p', each)]
            setattr(self, name, self._launch(MODULES[name], '--ros-args', *words))

    def fault(self):
        if not self.statuses:
            return None
        (status,) = self.statuses[-1].status
        return status.message if status.level == DiagnosticStatus.ERROR else ''

    def points(self, first=0):
        """Where the end effector was [m], since a message of the bench."""
        return np.array([one.data[XY] for one in self.seen[first:]])

    def until_it_has_moved(self, first=0):
        """Wait until it has gone some way since a message of the bench."""

        def moved():
            points = self.points(first)
            return len(points) > 1 and np.linalg.norm(np.diff(points, axis=0), axis=1).sum() > WAY

        self.peer.until(moved)

    def distance(self, first=0):
        """Usual distance of the end effector from the circle [m]."""
        return np.median(np.abs(np.linalg.norm(self.points(first) - CENTER, axis=1) - RADIUS))


@pytest.fixture
def bus(launch, peer):
    return lambda period: Bus(launch, peer, period)


@pytest.mark.parametrize('rate', [1000, 500, 250, 125])
def test_it_tracks_at_every_rate(rate, bus):
    """States 1 to 3 ms late, with jitter, in an order of their own, beside those of a gripper."""
    robot = bus(1.0 / rate)
    first = trajectory_of(VALUES).first_pose
    robot.start_drives(first, late=[0.001, 0.003], jitter=1e-4, active=True, gripper=True)
    robot.start_nodes('period:=auto')
    robot.until_it_has_moved()
    robot.peer.until(lambda: int(robot.figures.get('answered', 0)) > 100)
    assert robot.distance() < NEAR and robot.fault() == ''
    for node in (robot.controller, robot.trajectory):
        (told,) = re.findall(r'period \S+ s: joint states come at (\S+) Hz', node.stderr)
        assert float(told) == pytest.approx(rate, rel=1e-3)
    assert int(robot.figures['joint_states: messages of other joints']) > 10
    assert 'joint_states: messages of other joints are left out' in robot.controller.stderr
    assert 'messages of two publishers' not in robot.controller.stderr
    answered, skipped = (int(robot.figures[name]) for name in ('answered', 'skipped'))
    count = len(robot.seen)
    robot.peer.until(lambda: len(robot.seen) > count)
    assert 0 <= skipped <= robot.seen[-1].data[STATES] + EVERY - answered  # of what the drives did
    assert 'the period says' not in robot.controller.stderr


def test_drives_that_are_restarted_are_found_again(bus):
    """The robot stays where it is meanwhile, and the controller in a fault until it is cleared."""
    robot = bus(0.004)
    robot.start_drives(trajectory_of(VALUES).first_pose, active=True)
    robot.start_nodes('period:=0.004')
    robot.until_it_has_moved()
    assert robot.drives.end(signal.SIGINT) == 0
    robot.peer.until(lambda: robot.fault() == 'fault: no joint state came for too long')
    count = len(robot.seen)
    robot.start_drives(robot.seen[-1].data[POSE], active=True)
    robot.peer.until(lambda: len(robot.seen) > count)
    assert robot.fault()

    def clear():
        name, request = 'controller/clear_fault', Trigger.Request()
        return robot.peer.call(Trigger, name, request, robot.controller).success

    robot.peer.until(clear)
    robot.peer.until(lambda: robot.fault() == '')
    robot.until_it_has_moved(count)
    robot.peer.until(lambda: robot.distance(-RETURNED) < NEAR)
    count = len(robot.seen)
    robot.until_it_has_moved(count)
    assert robot.distance(count) < NEAR and robot.fault() == ''


def test_commands_are_taken_as_an_effort_group_controller_takes_them(bus):
    """Empty, not finite, of another length; while it is inactive, and after that."""
    robot = bus(0.002)
    robot.start_drives(VALUES['plant.initial_pose'], active=True)
    publisher = robot.peer.publisher(topics.COMMANDS)
    one, other = [0.2, 0.0, 0.0], [0.1, 0.0, 0.0]

    def after(data=None):
        """Torque that acts when a command, if any, has been taken."""
        if data is not None:
            publisher.publish(Float64MultiArray(data=data))
        count = len(robot.seen) + 3
        robot.peer.until(lambda: len(robot.seen) > count)
        return robot.seen[-1].data[TORQUE]

    def switch(active):
        request, name = SetBool.Request(data=active), 'controller_manager/switch'
        assert robot.peer.call(SetBool, name, request, robot.drives).success

    assert after() == 0.0 and after(one) == 0.2
    assert after([]) == after([np.nan, 0.0, 0.0]) == 0.2  # the last one stays
    assert after(other) == 0.1
    assert after([0.2, 0.0]) == after(one) == 0.0  # deactivated
    switch(True)
    assert after() == 0.0 and after(one) == 0.2
    switch(False)
    assert after() == after(one) == 0.0
    switch(True)
    assert after() == 0.0  # what came in between is forgotten
