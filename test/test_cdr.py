"""Messages as fixed layouts, against two other implementations of CDR: rosbags' and rclpy's."""

import dataclasses
import importlib
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore

from parallel_robot_model.messages import cdr, layouts

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINTS = ('joint1', 'j', 'drittes_Gelenk')
NONE = np.zeros(0)


def make(type_name, /, **fields):
    return STORE.types[type_name](**fields)


def header(stamp, frame=''):
    time = make('builtin_interfaces/msg/Time', sec=stamp[0], nanosec=stamp[1])
    return make('std_msgs/msg/Header', stamp=time, frame_id=frame)


def joint_state(stamp, draw, joints=JOINTS, fields=('position', 'velocity', 'effort'), frame=''):
    drawn = {name: draw(len(joints)) for name in fields}
    message = make(
        'sensor_msgs/msg/JointState',
        header=header(stamp, frame),
        name=list(joints),
        **{'position': NONE, 'velocity': NONE, 'effort': NONE, **drawn},
    )
    return layouts.joint_state(joints, fields, frame), drawn, message


def joint_trajectory(stamp, draw, joints=JOINTS):
    drawn = {name: draw(len(joints)) for name in ('position', 'velocity', 'acceleration')}
    point = make(
        'trajectory_msgs/msg/JointTrajectoryPoint',
        positions=drawn['position'],
        velocities=drawn['velocity'],
        accelerations=drawn['acceleration'],
        effort=NONE,
        time_from_start=make('builtin_interfaces/msg/Duration', sec=0, nanosec=0),
    )
    message = make(
        'trajectory_msgs/msg/JointTrajectory',
        header=header(stamp),
        joint_names=list(joints),
        points=[point],
    )
    return layouts.joint_trajectory(joints), drawn, message


def float64_multi_array(_, draw, count=3):
    data = draw(count)
    layout = make('std_msgs/msg/MultiArrayLayout', dim=[], data_offset=0)
    message = make('std_msgs/msg/Float64MultiArray', layout=layout, data=data)
    return layouts.float64_multi_array(count), {'data': data} if count else {}, message


def pose_stamped(stamp, draw):
    numbers = draw(7)
    pose = make(
        'geometry_msgs/msg/Pose',
        position=make('geometry_msgs/msg/Point', **dict(zip('xyz', numbers[:3], strict=True))),
        orientation=make(
            'geometry_msgs/msg/Quaternion', **dict(zip('xyzw', numbers[3:], strict=True))
        ),
    )
    message = make('geometry_msgs/msg/PoseStamped', header=header(stamp, 'base'), pose=pose)
    names = ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')
    return layouts.pose_stamped('base'), dict(zip(names, numbers, strict=True)), message


def clock(stamp, _):
    return layouts.clock(), {}, make('rosgraph_msgs/msg/Clock', clock=header(stamp).stamp)


CASES = {
    'joint_state': joint_state,
    'one joint': lambda stamp, draw: joint_state(stamp, draw, ('a',)),
    'five joints': lambda stamp, draw: joint_state(stamp, draw, tuple('abcde')),
    'no effort': lambda stamp, draw: joint_state(stamp, draw, fields=('position', 'velocity')),
    'a frame': lambda stamp, draw: joint_state(stamp, draw, frame='base'),
    'joint_trajectory': joint_trajectory,
    'trajectory of two': lambda stamp, draw: joint_trajectory(stamp, draw, ('a', 'bc')),
    'float64_multi_array': float64_multi_array,
    'empty array': lambda stamp, draw: float64_multi_array(stamp, draw, 0),
    'pose_stamped': pose_stamped,
    'clock': clock,
}
STAMP = (1_700_000_000, 123_456_789)
EVERY = pytest.mark.parametrize('case', CASES.values(), ids=CASES)


def example(case, stamp=STAMP, seed=0):
    """Layout, our bytes and rosbags' message with random numbers."""
    layout, numbers, message = case(stamp, np.random.default_rng(seed).standard_normal)
    nanoseconds = stamp[0] * 10**9 + stamp[1] if layout.stamped else None
    return layout, layout.encode(nanoseconds, **numbers), message


def theirs(message):
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def ros_class(name):
    package, _, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), kind)


def same(ours, other):
    """Whether two messages of whatever library hold the same content."""
    if dataclasses.is_dataclass(ours):
        names = [field.name for field in dataclasses.fields(ours) if field.name[:2] != '__']
        return all(same(getattr(ours, name), getattr(other, name)) for name in names)
    if isinstance(ours, list):
        return len(ours) == len(other) and all(map(same, ours, other))
    return np.array_equal(ours, other)


@EVERY
@given(st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1)), st.integers(0, 99))
def test_bytes_are_those_of_rosbags(case, stamp, seed):
    _, data, message = example(case, stamp, seed)
    assert data == theirs(message)


@EVERY
def test_both_other_libraries_read_the_bytes(case):
    layout, data, message = example(case)
    assert same(message, STORE.deserialize_cdr(data, layout.type_name))
    assert same(message, deserialize_message(data, ros_class(layout.type_name)))


@EVERY
def test_messages_serialised_by_rclpy_are_read(case):
    layout, data, _ = example(case)
    received = serialize_message(deserialize_message(data, ros_class(layout.type_name)))
    # Unlike a typed publisher it leaves spare bytes at the end where a sequence is empty.
    records = layout.decode(received[: len(data)])
    assert records is not None
    for name in layout.dtype.names or ():
        assert np.array_equal(records[name], layout.decode(data)[name])


@EVERY
def test_numbers_come_back(case):
    layout, numbers, _ = case(STAMP, np.random.default_rng(1).standard_normal)
    data = layout.encode(1_700_000_000_123_456_789 if layout.stamped else None, **numbers)
    records = layout.decode(data)
    assert len(records) == 1
    for name, value in numbers.items():
        assert np.array_equal(records[name][0], value)
    if layout.stamped:
        assert cdr.stamps_of(records)[0] == 1_700_000_000_123_456_789


@EVERY
def test_a_corrupted_byte_is_noticed_unless_it_is_padding_or_a_number(case):
    layout, data, _ = example(case)
    fixed = shape_of(STORE.deserialize_cdr(data, layout.type_name))
    for k in range(len(data)):
        corrupted = bytearray(data)
        corrupted[k] ^= 0x41
        try:
            read = STORE.deserialize_cdr(bytes(corrupted), layout.type_name)
            keeps = k >= len(cdr.ENCAPSULATION) and shape_of(read) == fixed
        except Exception:  # rosbags stumbles over wrong lengths in many ways
            keeps = False
        assert (layout.decode(bytes(corrupted)) is not None) == keeps, f'byte {k}'


def shape_of(message):
    """All that a layout holds constant: texts, lengths, and the numbers it has no name for."""
    if dataclasses.is_dataclass(message):
        content = {}
        for field in dataclasses.fields(message):
            value = getattr(message, field.name)
            varies = isinstance(value, float) or message.__msgtype__.endswith('/Time')
            content[field.name] = type(value) if varies else shape_of(value)
        return content
    if isinstance(message, np.ndarray):
        return message.shape
    return [shape_of(item) for item in message] if isinstance(message, list) else message


@EVERY
def test_other_lengths_are_not_this_layout(case):
    layout, data, _ = example(case)
    for length in (*range(1, len(data)), len(data) + 8, 2 * len(data)):
        assert layout.decode((2 * data)[:length]) is None


@EVERY
def test_spare_bytes_at_the_end_do_not_matter(case):
    layout, data, _ = example(case)
    assert layout.decode(data + bytes(4)).tobytes() == layout.decode(data).tobytes()


def test_nothing_is_no_message():
    assert layouts.joint_state(JOINTS).decode(b'') is None


def test_other_joint_names_are_not_this_layout():
    data = example(joint_state)[1]
    for joints in [('joint1', 'k', 'drittes_Gelenk'), ('j', 'joint1', 'drittes_Gelenk')]:
        assert layouts.joint_state(joints).decode(data) is None


@pytest.mark.parametrize('text', ['', 'a', 'Größe: 1', 'kind: law\nname: s_fotsmc\n' * 100])
def test_texts_are_those_of_rosbags(text):
    data = layouts.text_message(text)
    assert data.rstrip(b'\0') == theirs(make('std_msgs/msg/String', data=text)).rstrip(b'\0')
    assert len(data) % 4 == 0  # as on the wire
    assert deserialize_message(data, ros_class('std_msgs/msg/String')).data == text


def test_special_numbers_survive():
    numbers = [np.nan, np.inf, -np.inf, -0.0, 5e-324, 1.7976931348623157e308]
    layout = layouts.float64_multi_array(6)
    records = layout.decode(layout.encode(data=numbers))
    assert records['data'][0].tobytes() == struct.pack('<6d', *numbers)


def test_a_whole_run_equals_its_messages_one_by_one():
    layout = layouts.joint_state(JOINTS)
    position, effort = np.random.default_rng(2).standard_normal((2, 50, 3))
    stamps = 1_999_999_990 + 7 * np.arange(50)
    records = layout.records(50, stamps, position=position, effort=effort)
    for k in range(50):
        one = layout.encode(int(stamps[k]), position=position[k], effort=effort[k])
        assert records[k].tobytes() == one
        assert layouts.header_stamp(one) == stamps[k]
    together = layout.decode(records.tobytes(), 50)
    assert np.array_equal(cdr.stamps_of(together), stamps)
    assert np.array_equal(together['effort'], effort) and not together['velocity'].any()


def test_a_message_does_not_remember_the_one_before():
    layout = layouts.joint_state(JOINTS)
    fresh = layout.encode(5, position=[1, 2, 3])
    layout.encode(6, position=[4, 5, 6], velocity=[1, 1, 1], effort=[2, 2, 2])
    assert layout.encode(5, position=[1, 2, 3]) == fresh


def test_a_reader_reads_what_rosbags_writes():
    _, ours, message = example(CASES['a frame'])
    reader = layouts.Reader(ours)
    assert (reader.header(), reader.texts()) == ('base', JOINTS)
    for field in ('position', 'velocity', 'effort'):
        assert np.array_equal(reader.numbers(), getattr(message, field))
    dimensions = [make('std_msgs/msg/MultiArrayDimension', label='xy', size=2, stride=7)] * 2
    layout = make('std_msgs/msg/MultiArrayLayout', dim=dimensions, data_offset=3)
    numbers = np.arange(4.0)
    shaped = make('std_msgs/msg/Float64MultiArray', layout=layout, data=numbers)
    assert np.array_equal(layouts.read_numbers(theirs(shaped)), numbers)


def test_a_reader_ends_with_the_message():
    _, whole, _ = example(CASES['joint_state'])
    for length in range(len(whole)):
        with pytest.raises(ValueError, match=r'ends|CDR'):  # noqa: PT012
            reader = layouts.Reader(whole[:length])
            reader.header(), reader.texts()
            reader.numbers(), reader.numbers(), reader.numbers()
    for lie in (b'\xff\xff\xff\xff', b'\xff\xff\xff\x7f', b'\0\0\0\x20'):
        assert not layouts.read_numbers(b'\0\1\0\0' + 8 * b'\0' + lie).size
        assert not layouts.read_numbers(b'\0\1\0\0' + lie).size
    assert not layouts.read_numbers(b'\0\0' + example(CASES['float64_multi_array'])[1][2:]).size
