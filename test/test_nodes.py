"""The four nodes as real processes."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from assembly import simulated
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from ros_fixtures import SLOW_LOOP, Child
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from parallel_robot.bags.run import recording
from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.cache_directory import NOTICE
from parallel_robot_model.processes.node_processes import MODULES, command
from trajectory_gen.configuration import trajectory_of

pytest_plugins = ['ros_fixtures']

NAMES = list(MODULES)
PATIENT = [*SLOW_LOOP, 'plant.command_timeout:=60.0']


@pytest.fixture
def start(launch, domain):
    """Start a node by its name and parameters."""

    def start(name, *parameters, namespace='', words=(), fresh=False):
        given = [word for parameter in parameters for word in ('-p', parameter)]
        given += ['-r', f'__ns:=/{namespace}', *words]
        return launch(MODULES[name], '--ros-args', *given, fresh=fresh)

    return start


def trouble(process):
    """What a user would have to read as an error."""
    return [line for line in process.stderr.splitlines() if 'Traceback' in line or 'Error' in line]


def test_a_node_that_compiles_can_be_ended(launch, domain, tmp_path):
    process = launch(MODULES['controller'], fresh=True, XDG_CACHE_HOME=tmp_path)
    process.until(lambda: any(tmp_path.rglob('*.nbc')))
    assert process.end(signal.SIGINT, signal.SIGINT) == 0
    line, *more = process.stderr.splitlines()
    assert line.endswith(f'[parallel_robot]: {NOTICE}')
    assert all(line.endswith('kernels are compiled') for line in more)  # every ten seconds
    assert len([*tmp_path.rglob('*.nbc')]) < 10  # of many more


LAUNCHER = """
import json, subprocess, sys, time
pids = [subprocess.Popen(words).pid for words in json.loads(sys.argv[1])]
print(*pids, flush=True)
time.sleep(1e6)
"""


def records(message):
    """Whether a diagnostic says that the recorder has received states."""
    values = [value for status in message.status for value in status.values]
    return any(value.key == topics.JOINT_STATES.name and value.value != '0' for value in values)


@pytest.mark.endurance
def test_nodes_end_in_order_when_their_launcher_is_killed(compiled, peer, tmp_path):
    given = [*PATIENT, 'end_with_parent:=true', f'recorder.out:={tmp_path / "bag"}']
    options = [word for parameter in given for word in ('-p', parameter)]
    started = [command(MODULES[name], '--ros-args', *options) for name in NAMES]
    commands = peer.listen(topics.COMMANDS)
    told = []  # what the recorder says that it has received
    peer.node.create_subscription(DiagnosticArray, '/diagnostics', told.append, 100)
    with contextlib.ExitStack() as stack:
        words = [sys.executable, '-c', LAUNCHER, json.dumps(started)]
        launcher = stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE))
        stack.callback(launcher.kill)
        nodes = []
        for pid in map(int, launcher.stdout.readline().split()):
            nodes.append(Child(pid, os.pidfd_open(pid)))
            stack.callback(os.close, nodes[-1].descriptor)
            stack.callback(nodes[-1].kill)
        peer.until(lambda: any(np.any(command.data) for command in commands))
        peer.until(lambda: any(map(records, told)))
        launcher.kill()
        launcher.wait()
        peer.until(lambda: all(node.ended() for node in nodes))
        peer.until(lambda: not np.any(commands[-1].data))
    with Reader(tmp_path / 'bag') as bag:
        assert bag.message_count > 0


@pytest.mark.parametrize(
    'signals', [['SIGINT'], ['SIGTERM'], ['SIGHUP'], ['SIGINT', 'SIGINT']], ids=' '.join
)
def test_each_node_starts_alone_and_ends_in_order(signals, start, peer):
    fresh = len(signals) > 1  # the second meets the end of an interpreter
    nodes = {name: start(name, namespace=f'alone_{name}', fresh=fresh) for name in NAMES}
    peer.see(*(f'/alone_{name}/{name}' for name in NAMES))
    for process in nodes.values():
        assert process.running
        assert process.end(*(getattr(signal, name) for name in signals)) == 0
        assert not trouble(process)


def test_a_node_that_is_to_outlive_its_terminal_does(start, peer):
    """As `nohup` starts it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        process = start('trajectory', fresh=True)
    finally:
        signal.signal(signal.SIGHUP, before)
    peer.meet('trajectory', process)
    status = Path(f'/proc/{process.pid}/status').read_text()
    ignored = int(re.search(r'^SigIgn:\s*(\w+)', status, re.M)[1], 16)
    assert ignored >> signal.SIGHUP - 1 & 1
    process.signal(signal.SIGHUP)
    peer.meet('trajectory', process)
    assert process.end(signal.SIGTERM) == 0


def test_ctrl_c_again_and_again_ends_a_node_in_order(launch, peer):
    words = ('node', 'trajectory', '--ros-args', '-r', '__ns:=/hasty')
    process = launch('parallel_robot.cli.command_line', *words, fresh=True)
    peer.see('/hasty/trajectory')
    while process.running:
        process._popen.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process._popen.wait(0.001)
    assert process.wait() == 0


@pytest.mark.parametrize(
    ('name', 'parameter', 'message'),
    [
        ('trajectory', 'circle.radius:=wide', "circle.radius must be a number, not 'wide'"),
        ('trajectory', 'circle.center:=[3.0, 3.0]', 'motion refused at t = 0.000 s, leg'),
        ('plant', 'plant.integrater:=rk4', "did you mean 'plant.integrator'?"),
        ('controller', 's_fotsmc.G:=.nan', 's_fotsmc.G must be finite'),
        ('controller', 'law:=s_fotsmk', "unknown law 's_fotsmk'; did you mean 's_fotsmc'?"),
        ('recorder', 'recorder.out:=.', 'nothing is overwritten'),
    ],
)
def test_a_wrong_parameter_costs_one_line(name, parameter, message, start):
    process = start(name, parameter)
    assert process.wait() == 2
    assert process.stderr.count('\n') == 1 and message in process.stderr


@pytest.mark.parametrize('guess', ['[1, 0, 2]', '[0.52, 0.37, 1.57]'])
def test_whole_numbers_are_numbers(guess, start, peer):
    process = start('controller', 's_fotsmc.G:=12', f'controller.guess:={guess}')
    peer.until(lambda: peer.node.count_publishers(topics.COMMANDS.name) or not process.running)
    assert process.running and process.end(signal.SIGINT) == 0


@pytest.mark.parametrize('name', ['SIGINT', 'SIGHUP'])
def test_nodes_started_by_hand_close_the_loop(name, start, peer):
    heard, states = peer.listen(topics.ERROR), peer.listen(topics.JOINT_STATES)
    commands, nodes = peer.listen(topics.COMMANDS), {}
    for node in ('controller', 'plant', 'trajectory'):
        nodes[node] = start(node, *PATIENT)
        peer.meet(node, nodes[node])
    peer.until(lambda: heard)
    assert np.abs(heard[0].position).max() > 5e-3
    peer.until(lambda: np.abs(heard[-1].position).max() < 1e-3)
    assert any(states[-1].effort)
    assert nodes['controller'].end(getattr(signal, name)) == 0
    peer.until(lambda: list(commands[-1].data) == [0.0, 0.0, 0.0])
    peer.until(lambda: not any(states[-1].effort))
    assert not any(commands[-1].data)
    assert all(nodes[node].running for node in ('plant', 'trajectory'))


def test_topics_of_other_names_close_the_loop(start, peer, tmp_path):
    """As with hardware, whose topics have names of their own."""
    names = [
        '-r',
        'joint_states:=/motors/joints',
        '-r',
        'effort_controller/commands:=/motors/efforts',
    ]
    parameters = ['time_mode:=lockstep', 'duration:=0.2', 'recorder.out:=bag']
    recorder, newest = start('recorder', *parameters, words=names), diagnosed(peer)
    recorder.until((tmp_path / 'bag').exists)
    subscribers = {'controller': 2, 'plant': 4, 'trajectory': 2}
    for name, count in subscribers.items():
        start(name, *parameters, f'subscribers:={count}', words=names)
    recorder.until(lambda: 'ready: every topic has a publisher' in recorder.stderr)
    states = peer.listen(
        topics.JOINT_STATES._replace(name='/motors/joints')
    )  # now the plant begins
    peer.until(lambda: len(states) == 201)
    for topic, count in ((topics.JOINT_STATES, 201), (topics.COMMANDS, 201)):
        peer.until(lambda: newest.get('/recorder', {}).get(topic.name) == str(count))  # noqa: B023
    assert recorder.end(signal.SIGINT) == 0, recorder.stderr
    log = recording.read(tmp_path / 'bag').log
    assert len(log.stamps) == 201
    assert np.array_equal(log.command[:200], simulated(log.config).run.command[:200])


def diagnosed(peer):
    """Newest diagnostics of every node, as a dictionary that fills itself."""
    newest = {}

    def take(array):
        for status in array.status:
            newest[status.hardware_id] = {item.key: item.value for item in status.values}

    peer.node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    return newest


def test_the_plant_ignores_what_is_not_a_command(start, peer):
    plant = start('plant', *PATIENT)
    newest, states = diagnosed(peer), peer.listen(topics.JOINT_STATES)
    publisher = peer.publisher(topics.COMMANDS)
    peer.until(lambda: peer.call(Trigger, 'plant/ready', Trigger.Request(), plant).success)
    bad = [[np.nan, 0.0, 0.0], [1.0, np.inf, 1.0], [5.0, 5.0], []]
    messages = [Float64MultiArray(data=data) for data in bad] + [b'\x00\x01\x00\x00\xff\xff']
    reason = 'commands that are not three finite torques'
    for count, message in enumerate(messages, start=1):  # only the newest counts: one by one
        publisher.publish(message)
        peer.until(lambda count=count: newest.get('/plant', {}).get(reason) == str(count))
    peer.until(lambda: states)
    assert newest['/plant']['state'] == 'held' and not any(states[-1].effort)
    publisher.publish(Float64MultiArray(data=[5.0, 5.0, 5.0]))
    peer.until(lambda: list(states[-1].effort[:3]) == [5.0, 5.0, 5.0])


def test_joints_are_found_by_name(start, peer):
    values = config.resolve('paper_circle', {'time_mode': 'lockstep'})
    motion = trajectory_of(values).sample(0.0)
    desired = [motion.position[0], motion.velocity[0], motion.acceleration[0]]
    theta, theta_dot = desired[0] + [1e-3, -2e-3, 3e-3], np.array([0.01, 0.02, 0.03])
    core = Controller(configure(values))
    core.add_reference(10**9, JointReference(*desired))
    assert core.add_state(10**9, (theta, theta_dot, np.zeros(3)))
    expected = core.torque

    process = start('controller', 'time_mode:=lockstep')
    commands = peer.listen(topics.COMMANDS)
    reference, state = peer.publisher(topics.REFERENCE), peer.publisher(topics.JOINT_STATES)
    peer.meet('controller', process)
    message = JointState(name=['gripper', 'joint3', 'joint1', 'joint2'])
    message.header.stamp.sec = 1
    message.position = [9.0, *theta[[2, 0, 1]]]
    message.velocity = [9.0, *theta_dot[[2, 0, 1]]]
    state.publish(message)
    point = JointTrajectoryPoint()
    point.positions, point.velocities, point.accelerations = (
        list(row[[1, 0, 2]]) for row in desired
    )
    message = JointTrajectory(joint_names=['joint2', 'joint1', 'joint3'], points=[point])
    message.header.stamp.sec = 1
    reference.publish(message)
    peer.until(lambda: commands)
    assert np.array_equal(commands[0].data, expected)


def test_in_lockstep_nothing_is_said_before_all_subscribers_are_there(start, peer):
    process = start('trajectory', 'time_mode:=lockstep', 'duration:=0.05', 'subscribers:=2')
    state, message = peer.publisher(topics.JOINT_STATES), JointState()
    message.header.stamp.sec = 1
    first = peer.listen(topics.REFERENCE)
    peer.until(
        lambda: (
            '1 of 2' in peer.call(Trigger, 'trajectory/ready', Trigger.Request(), process).message
        )
    )
    state.publish(message)
    assert state.wait_for_all_acked(Duration(seconds=10))
    peer.call(Trigger, 'trajectory/ready', Trigger.Request(), process)  # after the state
    assert not first
    peer.listen(topics.REFERENCE)
    peer.until(lambda: len(first) >= 51 or state.publish(message))


def test_the_trajectory_answers_a_call_of_start_in_lockstep(start, peer):
    process = start('trajectory', 'time_mode:=lockstep')
    assert peer.call(Trigger, 'trajectory/start', Trigger.Request(), process) is not None
    assert process.end(signal.SIGINT) == 0


def begin(name, process, peer):
    """Give a node the common start."""
    stamp = Parameter('start_stamp', Parameter.Type.INTEGER, 10**9).to_parameter_msg()
    request = SetParameters.Request(parameters=[stamp])
    return peer.call(SetParameters, f'{name}/set_parameters', request, process)


@pytest.mark.parametrize('name', ['trajectory', 'recorder'])
def test_a_start_that_is_sent_twice_does_no_harm(name, start, peer):
    process = start(name, 'time_mode:=lockstep', 'start_stamp:=-1')
    assert begin(name, process, peer).results[0].successful
    assert begin(name, process, peer) is not None
    assert process.end(signal.SIGINT) == 0


def test_a_start_that_is_sent_twice_does_not_turn_back_the_plant(start, peer):
    process = start('plant', 'time_mode:=lockstep', 'start_stamp:=-1')
    states, commands = peer.listen(topics.JOINT_STATES), peer.publisher(topics.COMMANDS)
    peer.meet('plant', process)
    for k in range(1, 4):
        begin('plant', process, peer)
        peer.until(lambda: states)  # no command counts before the first
        commands.publish(Float64MultiArray(data=[1.0, 1.0, 1.0]))
        milliseconds = k * 10**6
        peer.until(lambda: states and states[-1].header.stamp.nanosec >= milliseconds)  # noqa: B023
