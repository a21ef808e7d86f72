"""References of MoveIt and of a joint trajectory controller: whole motions, or no rates."""

import numpy as np
import pytest
from bags import MS, START, STORE, streams, write_foreign
from mcap.writer import Writer as McapWriter
from rosbags.typesys import get_types_from_msg

from parallel_robot.bags.bag_reader import BagView
from parallel_robot.bags.messages.planned_motion import STATE
from parallel_robot.bags.run import recording
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import topics

JOINTS = ['joint1', 'joint2', 'joint3']
REST = np.array([1.454, 2.418, 1.983])
types = STORE.types
DEFINITION = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint {field}
trajectory_msgs/JointTrajectoryPoint feedback
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
"""


def point(seconds, position, velocity=()):
    """A point of a trajectory."""
    whole, rest = divmod(round(seconds * 1e9), 10**9)
    time = types['builtin_interfaces/msg/Duration'](whole, rest)
    empty = np.array([])
    kind = types['trajectory_msgs/msg/JointTrajectoryPoint']
    return kind(np.asarray(position, float), np.asarray(velocity, float), empty, empty, time)


def header(stamp):
    whole, rest = divmod(stamp, 10**9)
    return types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](whole, rest), '')


def trajectory(stamp, points):
    name = topics.REFERENCE.type
    return bytes(STORE.serialize_cdr(types[name](header(stamp), JOINTS, points), name))


def read(tmp_path, references, count=1000):
    position = np.tile(REST, (count, 1))
    found = streams(position, position)
    found[topics.REFERENCE] = references
    write_foreign(tmp_path / 'bag', found)
    return recording.read(tmp_path / 'bag').log


@pytest.mark.parametrize('stamp', [START, 0])
def test_a_motion_of_positions_is_joined_by_lines(tmp_path, stamp):
    points = [point(0, REST), point(0.5, REST + 0.5), point(1.0, REST)]
    log = read(tmp_path, [(START, trajectory(stamp, points))])
    wanted = REST + np.minimum(log.time, 1.0 - log.time)[:, np.newaxis]
    assert np.abs(log.reference_position - wanted).max() < 1e-9
    assert log.reference_velocity[100] == pytest.approx(np.ones(3))
    assert log.referenced.all()


def test_a_motion_with_rates_is_a_cubic_spline(tmp_path):
    times = np.linspace(0.0, 1.0, 6)
    points = [point(t, REST + t**3, np.full(3, 3 * t**2)) for t in times]
    log = read(tmp_path, [(START, trajectory(START, points))])
    cube = (log.time**3)[:, np.newaxis]
    assert np.abs(log.reference_position - REST - cube).max() < 1e-9
    assert np.abs(log.reference_acceleration[:, 0] - 6 * log.time).max() < 1e-6


def test_a_new_motion_ends_the_one_before(tmp_path):
    first = trajectory(START, [point(0, REST), point(1.0, REST + 1.0)])
    second = trajectory(START + 300 * MS, [point(0, REST + 5.0), point(0.2, REST + 5.0)])
    log = read(tmp_path, [(START, first), (START + 300 * MS, second)], 1200)
    assert log.reference_position[299] == pytest.approx(REST + 0.299)
    assert log.reference_position[300] == pytest.approx(REST + 5.0)
    timeout = log.config['safety.reference_timeout']
    assert log.referenced[500] and log.referenced.sum() == 501 + round(1e3 * timeout)


def test_references_without_rates_hold_and_are_told(tmp_path):
    found = [
        (START + k * MS, trajectory(START + k * MS, [point(0, REST + 1e-3 * k)]))
        for k in range(1000)
    ]
    log = read(tmp_path, found)
    assert log.reference_position[500] == pytest.approx(REST + 0.5)
    assert not log.reference_velocity.any()
    assert any('reference have no velocities' in warning for warning in log.warnings)


@pytest.mark.parametrize('points', [[], [point(0, ())], [point(1, REST), point(0, REST)]])
def test_what_is_no_motion_costs_one_line(tmp_path, points):
    with pytest.raises(BagError, match=r'reference is not understood: .* trajectory'):
        read(tmp_path, [(START, trajectory(START, points))])


@pytest.mark.parametrize('field', ['reference', 'desired'])
def test_the_state_of_a_trajectory_controller_is_a_reference(tmp_path, field):
    count = 200
    position = REST + 1e-3 * np.arange(count)[:, np.newaxis]
    found = streams(position, position)
    definition = DEFINITION.format(field=field)
    own = type(STORE)()
    for each in ('Time', 'Duration'):
        text = 'int32 sec\nuint32 nanosec'
        own.register(get_types_from_msg(text, f'builtin_interfaces/msg/{each}'))
    own.register(get_types_from_msg(definition, STATE))
    kind, name = own.types[STATE], '/joint_trajectory_controller/controller_state'
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start('ros2')
        for topic in (topics.JOINT_STATES, topics.COMMANDS):
            text, _ = STORE.generate_msgdef(topic.type, ros_version=2)
            schema = writer.register_schema(topic.type, 'ros2msg', text.encode())
            channel = writer.register_channel(f'/{topic.name}', 'cdr', schema)
            for stamp, data in found[topic]:
                writer.add_message(channel, stamp, data, stamp)
        schema = writer.register_schema(STATE, 'ros2msg', definition.encode())
        channel = writer.register_channel(name, 'cdr', schema)
        for k in range(count):
            wanted = point(0, position[k] + 0.01, np.ones(3))
            message = kind(header(START + k * MS), JOINTS, wanted, point(0, position[k]))
            data = bytes(own.serialize_cdr(message, STATE))
            writer.add_message(channel, START + k * MS, data, START + k * MS)
        writer.finish()
    with pytest.raises(BagError, match=f'--topic reference={name} takes it'):
        recording.read(path)
    log = recording.read(path, view=BagView({'reference': name})).log
    assert np.abs(log.reference_position - log.position - 0.01).max() < 1e-12
    assert (log.reference_velocity == 1.0).all()
