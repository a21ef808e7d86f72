"""The bag of a run without ROS."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from assembly import make_plant, open_loop, simulated
from bags import STORE
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from parallel_robot.bags.writing import simulation_bag
from parallel_robot.cli.commands import simulate as simulate_command
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.planar_3rrr import measure

N = 400
VALUES = config.resolve('paper_line', {'duration': N * 1e-3, 'true_robot.m2': 8.0})


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp('simulation') / 'bag'
    simulation_bag.write(directory, VALUES, [simulated(VALUES)])
    return directory


@pytest.fixture(scope='module')
def messages(bag):
    """(log time, message) by topic."""
    found = {}
    with AnyReader([bag]) as reader:
        for connection, log_time, data in reader.messages():
            message = STORE.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((log_time, message))
    return found


def column(stream, *names):
    rows = [message for _, message in stream]
    for name in names:
        rows = [getattr(row, name) for row in rows]
    return np.array(rows)


def test_every_topic_is_on_the_grid(messages):
    for topic, stream in messages.items():
        every = {N + 1: 1, N // 10 + 1: 10, 1: 1}[len(stream)]
        stamps = [10**9 + k * every * 10**6 for k in range(len(stream))]
        assert [log_time for log_time, _ in stream] == stamps
        if hasattr(stream[0][1], 'header'):
            headers = [message.header.stamp for _, message in stream]
            assert [stamp.sec * 10**9 + stamp.nanosec for stamp in headers] == stamps
        assert (len(stream) == 1) == (topic in ('/controller/active_law', '/controller/status'))
    assert len(messages) == 12


def test_metadata_say_where_zero_is_and_how_it_was_made(bag):
    information = yaml.safe_load((bag / 'metadata.yaml').read_text())
    facts = information['rosbag2_bagfile_information']['custom_data']
    with Reader(bag) as reader:
        assert reader.start_time == 10**9 and reader.duration == N * 10**6 + 1
    assert facts['start_stamp'] == str(10**9) and facts['period_ns'] == str(10**6)
    assert (facts['scenario'], facts['law']) == ('paper_line', 's_fotsmc')
    assert json.loads(facts['config']) == VALUES


def test_state_0_is_the_initial_pose_without_effort(messages):
    _, first = messages['/joint_states'][0]
    plant, state, *_ = make_plant(VALUES)
    expected = measure(plant.robot, state.coordinates, state.rate)
    assert np.array_equal(first.position, [*expected.position, *expected.passive_position])
    assert not first.velocity.any() and not first.effort.any()
    _, first = messages['/reference'][0]
    assert not first.points[0].velocities.any()


def test_efforts_are_the_commands_of_the_state_before(messages):
    efforts = column(messages['/joint_states'], 'effort')
    commands = column(messages['/effort_controller/commands'], 'data')
    assert np.array_equal(efforts[1:, :3], commands[:-1]) and not efforts[:, 3:].any()
    assert np.abs(commands).max() > 1.0


def test_efforts_reproduce_the_angles_from_state_0(messages):
    efforts = column(messages['/joint_states'], 'effort')[1:, :3]
    angles = column(messages['/joint_states'], 'position')
    robot = make_plant(VALUES)[0].robot
    states = open_loop(VALUES, efforts)
    joints = [measure(robot, state.coordinates, state.rate) for state in states]
    again = np.array([[*joint.position, *joint.passive_position] for joint in joints])
    assert np.abs(again - angles).max() < 1e-9


def test_errors_are_the_difference_of_the_recorded(messages):
    actual = column(messages['/joint_states'], 'position')[::10, :3]
    points = [message.points[0].positions for _, message in messages['/reference']]
    error = column(messages['/controller/error'], 'position')
    assert np.array_equal(error, np.array(points)[::10] - actual)


def test_poses_are_planar(messages):
    (status,) = (message for _, message in messages['/controller/status'])
    assert status.header.frame_id == 'base'
    for topic in ('/pose', '/pose_reference'):
        quaternions = [message.pose.orientation for _, message in messages[topic]]
        yaw = [2 * np.arctan2(q.z, q.w) for q in quaternions]
        assert np.abs(np.array(yaw) - np.pi / 2).max() < 0.1
        assert not any(q.x or q.y for q in quaternions)
        assert {message.header.frame_id for _, message in messages[topic]} == {'base'}


def test_a_run_that_a_page_has_shown_names_the_page_of_its_bag():
    assert ' live --bag ' not in simulate_command.result(Path('runs/a'), lambda: ['figures'])
    lines = simulate_command.result(Path('runs/a'), lambda: ['figures'], shown=True).splitlines()
    assert lines[-1].startswith('next ') and lines[-1].endswith(' live --bag runs/a')
