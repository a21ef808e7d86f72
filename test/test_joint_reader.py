"""Joint vectors by name, out of messages of any publisher."""

from collections import Counter

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from parallel_robot_model.messages import topics
from parallel_robot_model.messages.layouts import joint_state
from parallel_robot_model.nodes.joint_reader import JointReader

JOINTS = ('joint1', 'joint2', 'joint3')
POSITION = {'joint1': 0.1, 'joint2': 0.2, 'joint3': 0.3, 'gripper': 9.0}
VELOCITY = {'joint1': 1.0, 'joint2': 2.0, 'joint3': 3.0, 'gripper': 9.0}
STAMP = 1_700_000_000_123_456_789  # ns


def state(names=JOINTS, stamp=STAMP, frame='', **fields):
    message = JointState(name=list(names))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.header.frame_id = frame
    message.position = [POSITION.get(name, 7.0) for name in names]
    message.velocity = [VELOCITY.get(name, 7.0) for name in names]
    for field, numbers in fields.items():
        setattr(message, field, numbers)
    return serialize_message(message)


@pytest.fixture
def counts():
    return Counter()


@pytest.fixture
def reader(counts):
    return JointReader(topics.JOINT_STATES, JOINTS, ('position', 'velocity'), counts)


def is_read(reader, data, stamp=STAMP):
    answer = reader.read(data)
    if answer is None:
        return False
    read_stamp, (position, velocity) = answer
    assert read_stamp == stamp
    assert position.tolist() == [0.1, 0.2, 0.3] and velocity.tolist() == [1.0, 2.0, 3.0]
    return True


@pytest.mark.parametrize(
    'names',
    [
        JOINTS,
        JOINTS[::-1],
        ('joint2', 'joint3', 'joint1'),
        ('gripper', 'joint3', 'joint1', 'joint2'),
        ('joint1', 'a', 'joint2', 'b', 'joint3', 'c'),
    ],
)
@pytest.mark.parametrize('frame', ['', 'base_link'])
def test_joints_are_found_by_name(names, frame, reader, counts):
    assert is_read(reader, state(names, frame=frame))
    assert is_read(reader, state(names, STAMP + 1, frame), STAMP + 1)
    assert not counts


def test_efforts_may_be_there_or_not(reader):
    assert is_read(reader, state(effort=[5.0, 5.0, 5.0]))
    assert is_read(reader, state(effort=[]))
    assert is_read(reader, state(('gripper', *JOINTS), effort=[1.0, 2.0, 3.0, 4.0]))


def test_the_publisher_may_change_from_message_to_message(reader):
    for names in (JOINTS, JOINTS[::-1], ('gripper', *JOINTS), JOINTS) * 2:
        assert is_read(reader, state(names))


BROKEN = {
    'renamed': (state(('joint1', 'joint2', 'joint4')), 'joint3 is missing'),
    'one too few': (state(('joint1', 'joint2')), 'joint3 is missing'),
    'none': (state(()), 'joint1 is missing'),
    'twice': (state((*JOINTS, 'joint2')), 'joint2 is named twice'),
    'no position': (state(position=[]), 'position is missing or short'),
    'short velocity': (state(velocity=[1.0, 2.0]), 'velocity is missing or short'),
    'long position': (state(position=[0.1, 0.2, 0.3, 0.4]), 'position is missing or short'),
    'NaN': (state(position=[0.1, np.nan, 0.3]), 'position is not finite'),
    'infinite': (state(velocity=[0.1, 0.2, -np.inf]), 'velocity is not finite'),
    'empty': (b'', 'not a message of its type'),
    'header alone': (b'\x00\x01\x00\x00', 'not a message of its type'),
    'cut off': (state()[:-9], 'not a message of its type'),
    'garbage': (b'\x00\x01\x00\x00' + b'\xff' * 150, 'not a message of its type'),
}


@pytest.mark.parametrize('name', BROKEN)
def test_what_cannot_be_used_is_counted_with_its_reason(name, reader, counts):
    data, reason = BROKEN[name]
    for _ in range(2):
        assert not is_read(reader, data)
    assert counts == {f'joint_states: {reason}': 2}
    assert is_read(reader, state())  # and what comes after it is read
    assert not is_read(reader, data)
    assert counts == {f'joint_states: {reason}': 3}


def test_other_joints_that_are_not_finite_do_no_harm(reader):
    names = ('gripper', *JOINTS)
    assert is_read(reader, state(names, position=[np.nan, 0.1, 0.2, 0.3]))


def test_velocities_may_be_missing_where_they_are_not_used(counts):
    """As joint_state_broadcaster has it without velocity interfaces: NaN for each joint."""
    reader = JointReader(
        topics.JOINT_STATES, JOINTS, ('position',), counts, {'velocity': 0.0, 'effort': 0.0}
    )
    names, nan = ('gripper', *JOINTS[::-1]), [np.nan] * 4
    position = np.array([9.0, 0.3, 0.2, 0.1])
    empty = joint_state(names, ('position', 'effort')).encode(STAMP, position=position, effort=nan)
    for data in (state(names, position=[*position], velocity=nan, effort=nan), empty):
        _, (angles, rate, effort) = reader.read(data)
        assert [*angles] == [0.1, 0.2, 0.3]
        assert not rate.any() and not effort.any()
    assert not counts


def test_references_are_read_alike(counts):
    fields = ('position', 'velocity', 'acceleration')
    reader = JointReader(topics.REFERENCE, JOINTS, fields, counts)
    names = ['joint3', 'joint1', 'joint2']
    message = JointTrajectory(joint_names=names)
    message.header.stamp.sec = 5
    point = JointTrajectoryPoint(
        positions=[0.3, 0.1, 0.2], velocities=[3.0, 1.0, 2.0], accelerations=[30.0, 10.0, 20.0]
    )
    message.points = [point]
    stamp, vectors = reader.read(serialize_message(message))
    assert stamp == 5 * 10**9
    assert np.array_equal(vectors, [[0.1, 0.2, 0.3], [1.0, 2.0, 3.0], [10.0, 20.0, 30.0]])
    for points in ([], [point, point], [JointTrajectoryPoint(positions=[0.1, 0.2, 0.3])]):
        message.points = points
        assert reader.read(serialize_message(message)) is None
    assert counts.total() == 3


@pytest.mark.parametrize('fields', [{}, {'effort': [0.5, np.nan, 0.5]}])
@pytest.mark.parametrize('unknown', [0.0, np.nan])
def test_what_a_message_may_lack_is_told_as_wished(fields, unknown, counts):
    reader = JointReader(topics.JOINT_STATES, JOINTS, ('position',), counts, {'effort': unknown})
    _, (position, effort) = reader.read(state(**fields))
    expected = [0.5, unknown, 0.5] if fields else [unknown] * 3
    assert position.tolist() == [0.1, 0.2, 0.3] and not counts
    assert np.array_equal(effort, expected, equal_nan=True)
