"""Messages of others that are not quite those of a robot: left out, or understood, and told."""

import numpy as np
import pytest
from bags import JOINTS, MS, START, STORE, streams, write_foreign
from mcap.writer import Writer

from parallel_robot.bags.run import recording
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import topics

COUNT = 300
MOTION = np.array([1.454, 2.418, 1.983]) + 1e-4 * np.arange(COUNT)[:, None]
STAMPS = START + np.arange(COUNT) * MS
types = STORE.types
STATE = topics.JOINT_STATES.type


def time(stamp):
    return types['builtin_interfaces/msg/Time'](*divmod(int(stamp), 10**9))


def state(log_time, position, velocity=(), effort=(), names=JOINTS, **given):
    """A message of joint states, with its log time."""
    header = types['std_msgs/msg/Header'](time(given.get('stamp', log_time)), '')
    numbers = (np.asarray(each, float) for each in (position, velocity, effort))
    made = types[STATE](header, [*names], *numbers)
    little = given.get('little_endian', True)
    return int(log_time), bytes(STORE.serialize_cdr(made, STATE, little_endian=little))


def whole(**given):
    """States of the motion, with rates and torques."""
    still = np.zeros(3)
    return [state(t, row, still, still, **given) for t, row in zip(STAMPS, MOTION, strict=True)]


@pytest.fixture
def record(tmp_path):
    """Write a bag with these states, and read it."""

    def made(states, **others):
        found = streams(MOTION, MOTION) | {topics.JOINT_STATES: sorted(states)}
        found |= {topics.REFERENCE: others['references']} if others else {}
        bag = tmp_path / str(len([*tmp_path.iterdir()]))
        write_foreign(bag, found)
        return recording.read(bag).log

    return made


ODD = {
    'uneven': (
        {'position': (1, 2, 3), 'velocity': (0, 0)},
        '3 positions, 2 velocities and 0 efforts for 3 joints',
    ),
    'nameless': ({'position': (1, 2, 3), 'names': ()}, 'it names no joints'),
    'empty': ({'position': (), 'names': ()}, 'it names no joints'),
}


@pytest.mark.parametrize('odd', ODD)
def test_messages_that_are_none_are_left_out_beside_others(record, odd):
    given, reason = ODD[odd]
    log = record(whole() + [state(t + MS // 2, **given) for t in STAMPS[::20]])
    assert np.array_equal(log.position, MOTION) and not log.velocity.any()
    [told] = [text for text in log.warnings if 'not understood' in text]
    assert '15 messages on joint_states' in told and reason in told and 'left out' in told


@pytest.mark.parametrize('odd', ODD)
def test_alone_they_cost_one_line(record, odd):
    given, reason = ODD[odd]
    with pytest.raises(BagError, match=f'joint_states is not understood: .*{reason}'):
        record([state(t, **given) for t in STAMPS])


def test_rates_without_positions_are_left_out(record):
    log = record(whole() + [state(t + MS // 2, (), (1, 1, 1)) for t in STAMPS[::20]])
    assert np.array_equal(log.position, MOTION)
    assert any('15 of 315 messages on joint_states have no position' in w for w in log.warnings)


def test_a_joint_that_is_named_twice_is_told(record):
    names = (*JOINTS, 'joint3')
    with pytest.raises(BagError, match='joint_states names joint3 twice: joint1, joint2, joint3'):
        record([state(t, (1, 2, 3, 4), names=names) for t in STAMPS])


def test_joints_that_are_told_in_two_messages_are_no_state(record):
    parts = (JOINTS[:2], JOINTS[2:])
    states = [state(t, (1,) * len(part), names=part) for t in STAMPS for part in parts]
    with pytest.raises(BagError, match=r'a message on joint_states has no joint., only joint'):
        record(states)


def test_states_without_stamps_count_when_they_were_recorded(record):
    log = record(whole(stamp=0))
    assert (log.stamps == STAMPS).all() and np.array_equal(log.position, MOTION)
    assert any('300 messages on joint_states have no stamp' in text for text in log.warnings)


def test_big_endian_messages_are_read(record):
    log = record(whole(little_endian=False))
    assert (log.stamps == STAMPS).all() and np.array_equal(log.position, MOTION)


def test_other_encapsulations_are_named(record):
    with pytest.raises(BagError, match='its encapsulation is 0007, not that of CDR'):
        record([(t, b'\0\7' + data[2:]) for t, data in whole()])


def test_a_trajectory_without_points_stops_the_one_before(record):
    name = topics.REFERENCE.type
    point = types['trajectory_msgs/msg/JointTrajectoryPoint']
    span, none = types['builtin_interfaces/msg/Duration'], np.zeros(0)

    def trajectory(stamp, points):
        made = types[name](types['std_msgs/msg/Header'](time(stamp), ''), [*JOINTS], points)
        return int(stamp), bytes(STORE.serialize_cdr(made, name))

    ends = [(MOTION[0], span(0, 0)), (MOTION[0] + 1.0, span(10, 0))]
    points = [point(row, none, none, none, after) for row, after in ends]
    stop = START + 100 * MS
    log = record(whole(), references=[trajectory(START, points), trajectory(stop, [])])
    moving = log.reference_velocity.any(axis=1)
    assert moving[:100].all()
    assert log.reference_position[99] == pytest.approx(MOTION[0] + 0.0099)
    with pytest.raises(BagError, match='reference is not understood: no trajectory has points'):
        record(whole(), references=[trajectory(START, [])])


def test_few_states_of_another_publisher_are_left_out(record):
    zeros = [state(t + MS // 2, *np.zeros((3, 3))) for t in STAMPS[10::20]]
    first = [state(START - MS, *np.zeros((3, 3)))]
    log = record(whole() + zeros + first)
    assert np.array_equal(log.position, MOTION)
    told = ' '.join(log.warnings)
    assert '16 of 316 states leap by more than 0.1 rad and back: of another publisher?' in told


def test_states_of_two_recorders_count_once(record):
    """A bag that was merged of two: each state twice. Other numbers at a stamp are no copies."""
    log, once = record([*whole(), *whole()]), record(whole())
    [told] = [line for line in log.warnings if 'recorded twice' in line]
    assert f'{COUNT} messages on joint_states were recorded twice' in told
    for field in ('stamps', 'position', 'effort', 'reference_position'):
        np.testing.assert_array_equal(getattr(log, field), getattr(once, field))
    assert log.messages['joint_states'].count == COUNT
    other = state(STAMPS[7] + 9, MOTION[7], np.zeros(3), np.ones(3), stamp=STAMPS[7])
    third = record([*whole(), other])
    assert not any('recorded twice' in line for line in third.warnings)
    assert any('repeat a stamp' in line for line in third.warnings)


def write_commands(path, channels):
    """A bag whose commands have these channels, each with its messages or without."""
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        for topic, messages in streams(MOTION, MOTION).items():
            names = channels if topic == topics.COMMANDS else {f'/{topic.name}': True}
            definition, _ = STORE.generate_msgdef(topic.type, ros_version=2)
            schema = writer.register_schema(topic.type, 'ros2msg', definition.encode())
            for name, full in names.items():
                channel = writer.register_channel(name, 'cdr', schema)
                for stamp, data in messages if full else ():
                    writer.add_message(channel, stamp, data, stamp)
        writer.finish()


@pytest.mark.parametrize('read', [recording.read, lambda bag: next(recording.chunks(bag, 30.0))])
def test_a_topic_with_and_without_a_slash_is_one_and_no_advice_names_it_where_it_is_empty(
    read, tmp_path
):
    own = topics.COMMANDS.name
    for first, second in ((f'/{own}', own), (own, f'/{own}')):
        write_commands(tmp_path / 'bag.mcap', {first: False, second: True})
        assert read(tmp_path / 'bag.mcap').log.messages[own].count == COUNT
    write_commands(tmp_path / 'bag.mcap', {f'/{own}': False, f'/arm/{own}': True})
    with pytest.raises(BagError, match=f'--topic commands=/arm/{own} takes it'):
        read(tmp_path / 'bag.mcap')
    write_commands(tmp_path / 'bag.mcap', {f'/{own}': False})
    with pytest.raises(BagError, match=r'MultiArray\), without a message$'):
        read(tmp_path / 'bag.mcap')
