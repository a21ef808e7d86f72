"""The nodes beside a joint_state_broadcaster and an effort group controller, see drives.py."""

import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from drives import BROADCASTER, COMPONENT, EFFORT, EVERY
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
XY, POSE, TORQUE, STALLS, STATES = slice(0, 2), slice(0, 3), 3, -3, -1  # in them
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
MOST = 10.0  # N m, of a way back with other pauses in it
RAMP = max(VALUES['safety.ramp_rate'])  # N m/s
GAP = 'fault: no joint state came for too long'
TOO_LATE = 'fault: joint states come too late'
AGE = VALUES['safety.state_age']  # s
LOST = 'fault: the motors do not apply the commanded torque'


class Bus:
    """Drives, and the nodes that move them."""

    def __init__(self, launch, peer, period):
        self._launch, self.peer, self.period = launch, peer, period
        self.seen = peer.listen(BENCH)
        self.statuses = peer.listen(topics.STATUS, RECENT)
        self.answered = peer.listen(topics.ANSWERED)
        self.figures = {}  # of the controller, as it told them last
        self.told = []  # what was wrong, and the figures, each second
        peer.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_figures, 10)

    def _on_figures(self, array):
        for status in array.status:
            if status.hardware_id == '/controller':
                self.figures = {each.key: each.value for each in status.values}
                self.told.append((status.message, self.figures))

    def start_drives(self, pose, joints=(), **given):
        overrides = {'period': self.period, 'plant.initial_pose': [*map(float, pose)]}
        overrides |= {'joints': [*joints]} if joints else {}
        words = json.dumps({'overrides': overrides, **given})
        self.drives = self._launch('drives', words, PYTHONPATH=PATH)

    def start_nodes(self, *more):
        for name in ('controller', 'trajectory'):
            words = [word for each in (*PATIENT, *more) for word in ('-p', each)]
            setattr(self, name, self._launch(MODULES[name], '--ros-args', *words))

    def switch(self, name, on):
        """Whether a controller or the component could be switched."""
        request, service = SetBool.Request(data=on), f'controller_manager/{name}'
        return self.peer.call(SetBool, service, request, self.drives).success

    def ask(self, name, server):
        """Whether a service without a request did what it is for."""
        return self.peer.call(Trigger, name, Trigger.Request(), server).success

    def until_it_is_back(self):
        """Clear the fault and wait until it tracks again; returns since which messages."""
        count, answers = len(self.seen), len(self.answered)
        self.peer.until(lambda: self.ask('controller/clear_fault', self.controller))
        self.peer.until(lambda: self.fault() == '')
        self.until_it_has_moved(count)
        self.peer.until(lambda: self.distance(-RETURNED) < NEAR)
        return answers

    def step(self, first=0, last=None, ramp=0.0):
        """Largest step of the torque from an answer to the next, among messages of them [N m].

        Less a ramp [N m/s] over the time between their states. On a busy machine those are some
        periods apart, and the way back goes on meanwhile: at 1.2 N m/ms after a pause of 0.34 s.
        Drives that are held up themselves see several answers at once.
        """
        parts = [np.array(one.data).reshape(-1, 6) for one in self.answered[first:last]]
        rows = np.concatenate([each[each[:, 0] > 0] for each in parts])  # that answer a state
        steps = np.abs(np.diff(rows[:, 3:].copy().view(np.float64), axis=0)).max(axis=1)
        return (steps - ramp * 1e-9 * np.diff(rows[:, 0])).max()

    def told_of(self, answered):
        """What was wrong when it told for the first time of so many states."""
        return next(text for text, each in self.told if int(each['answered']) >= answered)

    def torque(self, first=0):
        """Largest torque that has acted since a message of the bench [N m]."""
        return max(one.data[TORQUE] for one in self.seen[first:])

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
    robot, joints = bus(1.0 / rate), ['b', 'c', 'a']
    first = trajectory_of(VALUES).first_pose
    special = {'late': [0.001, 0.003], 'jitter': 1e-4, 'active': True, 'gripper': True}
    robot.start_drives(first, joints=joints, **special)
    robot.start_nodes('period:=auto', f'joints:={joints}')
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


@pytest.mark.parametrize('how', [signal.SIGINT, signal.SIGKILL])
def test_drives_that_are_restarted_are_found_again(how, bus):
    """The robot stays where it is meanwhile, and the controller in a fault until it is cleared."""
    robot = bus(0.004)
    robot.start_drives(trajectory_of(VALUES).first_pose, active=True)
    robot.start_nodes('period:=0.004', 'law:=s_fotsmc')
    robot.until_it_has_moved()
    stopped = len(robot.answered)
    assert robot.drives.end(how) in (0, -how)
    robot.peer.until(lambda: robot.fault() == GAP)
    count = len(robot.seen)
    robot.start_drives(robot.seen[-1].data[POSE], active=True)
    robot.peer.until(lambda: len(robot.seen) > count)
    assert robot.fault()
    back = robot.until_it_is_back()
    assert robot.step(back, ramp=RAMP) < robot.step(0, stopped)
    count = len(robot.seen)
    robot.until_it_has_moved(count)
    assert robot.distance(count) < NEAR and robot.fault() == ''
    if how == signal.SIGKILL:  # it counts for 20 s
        assert robot.figures['joint_states: publishers'] == '2'


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

    assert after() == 0.0 and after(one) == 0.2
    assert after([]) == after([np.nan, 0.0, 0.0]) == 0.2  # the last one stays
    assert after(other) == 0.1
    assert after([0.2, 0.0]) == after(one) == 0.0  # deactivated
    assert robot.switch(EFFORT, True)
    assert after() == 0.0 and after(one) == 0.2
    assert robot.switch(EFFORT, False)
    assert after() == after(one) == 0.0
    assert robot.switch(EFFORT, True)
    assert after() == 0.0  # what came in between is forgotten


@pytest.mark.parametrize(
    ('special', 'nodes', 'told'),
    [
        ({'rates': {BROADCASTER: 150}}, (), 'come at 166.7 Hz, the period says 500 Hz: give the'),
        (
            {'rates': {EFFORT: 125}, 'asynchronous': True},
            (),
            'change with 1 of 4 states, commands',
        ),
        ({'interfaces': ['position']}, ('estimator.kind:=filter',), ''),
        ({'limits': {'effort': 0.2}, 'enforced': False}, (), ''),
    ],
    ids=['broadcaster_slower', 'effort_controller_slower', 'positions', 'limits_not_enforced'],
)
def test_it_tracks_with_what_ros2_control_may_be_told(special, nodes, told, bus):
    robot = bus(0.002)
    robot.start_drives(trajectory_of(VALUES).first_pose, active=True, **special)
    robot.start_nodes('period:=0.002', *nodes)
    robot.until_it_has_moved()
    count = len(robot.told)
    robot.peer.until(lambda: len(robot.told) > count)
    assert robot.distance() < NEAR and robot.fault() == ''
    robot.peer.until(lambda: told in robot.controller.stderr)
    assert ('the period says' in robot.controller.stderr) == ('the period says' in told)


@pytest.mark.parametrize(
    ('dropped', 'lasts', 'bursts'), [(0.05, [0.02, 0.1, 0.2], False), (0.24, [0.02, 0.34], True)]
)
def test_states_that_are_dropped_or_late_are_told_and_throw_nobody(dropped, lasts, bursts, bus):
    """With the time-outs of the defaults."""
    robot = bus(0.002)
    late = {'dropped': dropped, 'stalls': lasts, 'bursts': bursts}
    robot.start_drives(trajectory_of(VALUES).first_pose, active=True, **late)
    robot.start_nodes('period:=0.002', 'law:=s_fotsmc', f'safety.state_age:={AGE}')
    robot.until_it_has_moved()
    robot.peer.until(lambda: robot.answered)  # some of them make a message
    stalls, count = robot.seen[-1].data[STALLS], len(robot.told)
    first, begun = len(robot.seen), len(robot.answered)
    robot.peer.until(lambda: robot.seen[-1].data[STALLS] > stalls + len(lasts))
    robot.peer.until(lambda: len(robot.told) > count + 3)
    assert robot.fault() in ('', TOO_LATE)  # that if a burst takes 0.1 s
    assert robot.step(begun, ramp=RAMP) < robot.step(0, begun)
    assert robot.torque(first) < MOST
    assert 'joint states: ' in robot.told_of(400)  # of the first second
    gaps = [float(re.search(r'gap (\S+) ms', each['missing'])[1]) for _, each in robot.told]
    assert max(gaps) >= 1e3 * (max(lasts) - AGE)  # the last ones of a burst are young enough


@pytest.mark.parametrize('zeroes', [True, False])
def test_a_component_that_errs_needs_three_commands_to_come_back(zeroes, bus):
    """Nothing is written any more: drives that do not zero go on with the last torque."""
    robot = bus(0.002)
    robot.start_drives(trajectory_of(VALUES).first_pose, active=True, zeroes=zeroes)
    robot.start_nodes('period:=0.002', 'law:=s_fotsmc')
    robot.until_it_has_moved()
    stopped = len(robot.answered)
    assert robot.ask('controller_manager/err', robot.drives)
    count = len(robot.seen)
    robot.peer.until(lambda: robot.fault() == GAP)
    robot.peer.until(lambda: len(robot.seen) > count + 2)
    went = np.linalg.norm(np.subtract(*robot.points(count + 1)[[0, -1]]))
    assert (robot.torque(count + 1) == 0.0, went == 0.0) == (zeroes, zeroes)
    for name in (EFFORT, BROADCASTER):
        assert not robot.switch(name, True)
    assert not robot.ask('controller/clear_fault', robot.controller)
    for name in (COMPONENT, BROADCASTER):
        assert robot.switch(name, True)
    count = len(robot.seen)
    robot.peer.until(lambda: len(robot.seen) > count + 2)
    assert robot.torque(count + 1) == 0.0 and robot.fault() == GAP
    assert robot.switch(EFFORT, True)
    back = robot.until_it_is_back()
    assert robot.step(back, ramp=RAMP) < robot.step(0, stopped)


@pytest.mark.parametrize(
    ('limits', 'told'),
    [
        ({'effort': 0.5}, r': efforts of joint\d stay at -?0\.5 N m where -?[\d.]+ is commanded'),
        ({'velocity': 0.05}, ''),
    ],
)
def test_limits_of_the_urdf_that_are_enforced_are_a_fault_that_is_explained(limits, told, bus):
    robot = bus(0.002)
    robot.start_drives(trajectory_of(VALUES).first_pose, active=True, limits=limits)
    robot.start_nodes('period:=0.002')
    robot.peer.until(lambda: robot.fault() == LOST)
    assert 'is out of limits' in robot.drives.stderr
    robot.peer.until(lambda: any(text.startswith(LOST) for text, _ in robot.told))
    assert re.search(f'{LOST}{told}', robot.controller.stderr)
