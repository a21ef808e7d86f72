"""Bags as arrays: what is aligned with what, and what is missing."""

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from assembly import simulated as simulate
from bags import JOINTS, MS, START, WRITERS, content, motion_of, streams, write_foreign
from mcap.writer import Writer

from parallel_robot.analysis import metrics, recorded_motions
from parallel_robot.bags.run import recording, run_log, run_messages
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_model.common.errors import BagError, KinematicsError
from parallel_robot_model.common.units import JointUnits
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.messages.topics import Topic

COUNT = 100
RANDOM = np.random.default_rng(3)
REFERENCE = RANDOM.normal(size=(COUNT, 3))
POSITION = RANDOM.normal(size=(COUNT, 3))
EFFORT = RANDOM.normal(size=(COUNT, 3))


@pytest.fixture
def record(tmp_path):
    """Write streams as a foreign bag and read it."""

    def record(found):
        write_foreign(tmp_path / 'bag', found)
        return recording.read(tmp_path / 'bag').log

    return record


def counts(log):
    """Count and missing messages by topic."""
    return {name: (found.count, found.missing) for name, found in log.messages.items()}


def test_a_foreign_bag_is_read(record):
    log = record(streams(REFERENCE, POSITION, EFFORT))
    assert (log.scenario, log.law, log.joints) == ('unknown', 'unknown', JOINTS)
    assert log.start_stamp == START
    assert np.array_equal(log.stamps, START + np.arange(COUNT) * MS)
    assert np.array_equal(log.time, np.arange(COUNT) * MS / 1e9)
    assert np.array_equal(log.position, POSITION) and not log.velocity.any()
    assert np.array_equal(log.reference_position, REFERENCE)
    assert np.array_equal(log.effort, EFFORT) and np.array_equal(log.command, EFFORT)
    assert counts(log) == dict.fromkeys(counts(log), (COUNT, 0)) and len(counts(log)) == 3


def test_joints_that_look_like_degrees_are_told(record):
    degrees = np.degrees(POSITION)
    far = np.abs(degrees).max()
    log = record(streams(REFERENCE, degrees, EFFORT))
    assert any(
        f'a joint reaches {far:.4g} rad' in text and 'degrees?' in text for text in log.warnings
    )
    assert not run_messages.beyond(degrees, JointUnits((True,) * 3))
    with pytest.raises(KinematicsError, match=r'turns: joint_states are in radians; degrees\?'):
        recorded_motions.poses_of_log(
            log._replace(reference_position=np.array([[82.2, 188.1, -30.7]]))
        )


def test_a_joint_with_the_wrong_sign_is_told(record):
    log = record(streams(REFERENCE, REFERENCE * [1.0, -1.0, 1.0] + 1e-3, EFFORT))
    (line,) = (text for text in log.warnings if 'its sign wrong?' in text)
    assert 'joint2: -1 times the reference: is its sign wrong?' in line


def test_small_errors_about_zero_are_no_wrong_sign(record):
    log = record(streams(1e-4 * REFERENCE, -1e-4 * REFERENCE, EFFORT))
    assert not any('its sign wrong?' in text for text in log.warnings)


def test_efforts_that_no_motor_gives_are_told(record):
    limit = config.resolve('paper_circle')['plant.torque_limit'][0]
    most = limit / np.abs(EFFORT).max() * EFFORT
    log = record(streams(REFERENCE, POSITION, 1e3 * most))
    (line,) = (text for text in log.warnings if 'plant.torque_limit' in text)
    told = f'efforts reach {1e3 * limit:.4g} N m, more than plant.torque_limit, {limit:g} N m'
    assert line.endswith(f'{told}: are they in N m?')


def test_efforts_at_the_limit_are_not_told(record):
    limit = config.resolve('paper_circle')['plant.torque_limit'][0]
    log = record(streams(REFERENCE, POSITION, np.clip(1e6 * EFFORT, -limit, limit)))
    assert not any('plant.torque_limit' in text for text in log.warnings)


@pytest.mark.parametrize(('first', 'count'), [(0, COUNT), (90, 10)])
def test_the_joint_whose_numbers_are_none_is_told(record, first, count):
    broken = POSITION.copy()
    broken[first:, 1] = np.nan
    told = f'position of joint2 is nan in {count} of {COUNT}'
    if first:
        assert any(told in text for text in record(streams(REFERENCE, broken, EFFORT)).warnings)
        return
    with pytest.raises(BagError, match=told):
        record(streams(REFERENCE, broken, EFFORT))


@pytest.mark.parametrize('path', ['bag', 'bag/bag_0.mcap'])
def test_directory_or_file(path, tmp_path):
    data = {'scenario': 'paper_line', 'law': 'x', 'joints': list(JOINTS), 'period': 1e-3}
    metadata = {'config': str(data), 'start_stamp': str(START + 10 * MS)}
    with BagWriter(tmp_path / 'bag', topics.RECORDED, metadata) as writer:
        for topic, messages in streams(REFERENCE, POSITION).items():
            for log_time, payload in messages:
                writer.write(topic.name, log_time, payload)
    log = recording.read(tmp_path / path).log
    assert (log.scenario, log.law) == ('paper_line', 'x')
    assert log.config == config.resolve('paper_circle') | data  # what it lacks is the default
    assert log.start_stamp == START + 10 * MS and log.time[0] == 0.0
    assert np.array_equal(log.position, POSITION[10:])  # what was before t = 0 is left out


@pytest.mark.parametrize(('told', 'mode'), [(1e-3, 'wall'), (2e-3, 'wall'), (1e-3, 'lockstep')])
def test_states_of_another_rate_than_the_controller_was_told_are_told(told, mode, tmp_path):
    """Every second state is all there are; in lockstep the period is that of the plant."""
    metadata = {'config': str({'joints': list(JOINTS), 'period': told, 'time_mode': mode})}
    found = streams(REFERENCE, POSITION)
    found[topics.JOINT_STATES] = found[topics.JOINT_STATES][::2]
    with BagWriter(tmp_path / 'bag', topics.RECORDED, metadata) as writer:
        for topic, messages in found.items():
            for log_time, payload in messages:
                writer.write(topic.name, log_time, payload)
    log = recording.read(tmp_path / 'bag').log
    rates = [line for line in log.warnings if 'come at 500 Hz, the period says 1000 Hz' in line]
    assert len(rates) == (told == 1e-3 and mode == 'wall')
    assert (log.messages['joint_states'].missing == 0) == (mode == 'wall')


def test_messages_that_are_removed_are_missing(record):
    found = streams(REFERENCE, POSITION)
    for topic, lost in (
        (topics.JOINT_STATES, [20]), (topics.REFERENCE, [30, 31, 50]), (topics.COMMANDS, [7, 8])
    ):  # fmt: skip
        found[topic] = [entry for k, entry in enumerate(found[topic]) if k not in lost]
    pose = layouts.pose_stamped('base')
    found[topics.POSE] = [
        (START + k * MS, pose.encode(START + k * MS)) for k in range(0, COUNT, 10) if k != 40
    ]
    log = record(found)
    assert counts(log) == {
        'joint_states': (99, 1),
        'reference': (97, 3),
        'effort_controller/commands': (98, 2),
        'pose': (9, 1),
    }
    assert 20 not in np.rint(log.time * 1e3) and len(log.position) == 99
    assert np.array_equal(log.position[20], POSITION[21])
    # at rest, a reference that was lost is the one before it
    assert np.array_equal(log.reference_position[[29, 30, 49]], REFERENCE[[29, 29, 49]])


def test_references_are_extrapolated_to_the_states(record):
    """theta = a + b t + c t^2 / 2, sampled at every fourth state, in between by the formula."""
    a, b, c = RANDOM.normal(size=(3, 3))
    t = np.arange(COUNT)[:, np.newaxis] * 1e-3
    motion = a + b * t + c * t**2 / 2, b + c * t, c + 0 * t
    found = streams(REFERENCE, POSITION)
    records = layouts.joint_trajectory(JOINTS).records(
        COUNT, START + np.arange(COUNT) * MS,
        position=motion[0], velocity=motion[1], acceleration=motion[2],
    )  # fmt: skip
    found[topics.REFERENCE] = [(START + k * MS, records[k].tobytes()) for k in range(0, COUNT, 4)]
    log = record(found)
    read = log.reference_position, log.reference_velocity, log.reference_acceleration
    assert np.abs(np.array(read) - motion).max() < 1e-12


def test_messages_in_the_order_of_their_log_time(record):
    found = streams(REFERENCE, POSITION, EFFORT)
    shuffled = {
        topic: [messages[k] for k in RANDOM.permutation(COUNT)]
        for topic, messages in found.items()
    }
    log = record(shuffled)
    assert np.array_equal(log.position, POSITION) and np.array_equal(log.command, EFFORT)


def test_references_that_are_sent_ahead_and_later_are_cut(record):
    found = streams(REFERENCE, POSITION)
    found[topics.REFERENCE] = found[topics.REFERENCE][10:]
    log = record(found)
    assert log.start_stamp == START + 10 * MS
    assert np.array_equal(log.position, POSITION[10:])


@pytest.mark.parametrize('names', [('joint3', 'joint1', 'joint2'), JOINTS[::-1]])
def test_joints_are_found_by_name(names, record):
    found = streams(REFERENCE, POSITION, EFFORT)
    others = streams(REFERENCE, POSITION, EFFORT, names)
    log = record({**others, topics.COMMANDS: found[topics.COMMANDS]})
    assert np.array_equal(log.position, POSITION) and np.array_equal(log.effort, EFFORT)
    assert np.array_equal(log.reference_position, REFERENCE)


def without_positions(found):
    states = layouts.joint_state(JOINTS, ('effort',))
    stamps = START + np.arange(COUNT) * MS
    rows = states.records(COUNT, stamps, effort=POSITION)
    return found | {topics.JOINT_STATES: [(int(s), r.tobytes()) for s, r in zip(stamps, rows)]}  # noqa: B905


BROKEN = {
    'no states': lambda found: found | {topics.JOINT_STATES: []},
    'no references': lambda found: found | {topics.REFERENCE: []},
    'no commands': lambda found: found | {topics.COMMANDS: []},
    'other joints': lambda found: found | {
        topics.JOINT_STATES: [(START, layouts.joint_state(('a', 'b', 'c')).encode(START))]},
    'two joints': lambda found: found | {
        topics.JOINT_STATES: [(START, layouts.joint_state(('joint1', 'joint2')).encode(START))]},
    'no positions': without_positions,
    'broken bytes': lambda found: found | {topics.JOINT_STATES: [(START, b'\0\1\0\0\xff')]},
    'references after the last state': lambda found: found | {
        topics.REFERENCE: [(6 * 10**9, layouts.joint_trajectory(JOINTS).encode(6 * 10**9))]},
}  # fmt: skip


@pytest.mark.parametrize('name', BROKEN)
def test_what_is_no_run_is_refused_with_one_line(name, tmp_path):
    write_foreign(tmp_path / 'bag', BROKEN[name](streams(REFERENCE, POSITION)))
    with pytest.raises(BagError) as caught:
        recording.read(tmp_path / 'bag')
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('content', [b'', b'not an MCAP file', b'\x89MCAP0\r\n' + b'\xff' * 200])
def test_a_file_that_is_no_bag_is_refused(content, tmp_path):
    (tmp_path / 'bag.mcap').write_bytes(content)
    for path in (tmp_path, tmp_path / 'bag.mcap', tmp_path / 'nothing'):
        with pytest.raises(BagError, match=str(path)):
            recording.read(path)


def test_metadata_of_another_suite_are_refused(tmp_path):
    with BagWriter(tmp_path / 'bag', topics.RECORDED, {'version': '99'}) as writer:
        for topic, messages in streams(REFERENCE, POSITION).items():
            for log_time, payload in messages:
                writer.write(topic.name, log_time, payload)
    with pytest.raises(BagError, match='config'):
        recording.read(tmp_path / 'bag')


RUN = config.resolve('paper_circle', {'duration': 0.5, 'time_mode': 'lockstep'})


@pytest.fixture(scope='module')
def simulated(tmp_path_factory):
    """A run of the suite: its log and its messages."""
    directory = tmp_path_factory.mktemp('run') / 'bag'
    simulation_bag.write(directory, RUN, [simulate(RUN)])
    found = content(directory / 'bag_0.mcap')
    return recording.read(directory).log, {topic: found[topic.name] for topic in topics.RECORDED}


@pytest.mark.parametrize('kind', WRITERS)
def test_whoever_wrote_it_the_figures_are_the_same(kind, simulated, tmp_path):
    log, messages = simulated
    WRITERS[kind](tmp_path / 'bag', messages)
    other = recording.read(tmp_path / 'bag').log
    assert other.messages == log.messages
    (robot,) = other.warnings
    assert 'does not say of which robot it is: taken to be of planar_3rrr' in robot
    for name in log._fields:
        if isinstance(getattr(log, name), np.ndarray):
            assert np.array_equal(getattr(other, name), getattr(log, name)), name
    assert metrics.evaluate(motion_of(other)) == metrics.evaluate(motion_of(log))


def test_reading_needs_no_ros(tmp_path):
    write_foreign(tmp_path / 'bag', streams(REFERENCE, POSITION))
    code = (
        'import sys; from pathlib import Path\n'
        'from parallel_robot.bags.run import recording\n'
        f'log = recording.read(Path({str(tmp_path / "bag")!r})).log\n'
        'print(len(log.time), "rclpy" in sys.modules)\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=Path(__file__).parents[1], capture_output=True, text=True
    )
    assert done.stdout == f'{COUNT} False\n', done.stderr


def test_joints_may_change_during_a_run(record):
    """The publisher was started again, with another order and with one joint more."""
    parts = [
        streams(REFERENCE, POSITION, EFFORT, names)[topics.JOINT_STATES]
        for names in (JOINTS, JOINTS[::-1])
    ]
    more = layouts.joint_state(('gripper', *JOINTS)).records(
        COUNT,
        START + np.arange(COUNT) * MS,
        position=np.c_[np.zeros(COUNT), POSITION],
        effort=np.c_[np.zeros(COUNT), EFFORT],
    )
    found = streams(REFERENCE, POSITION, EFFORT)
    found[topics.JOINT_STATES] = [
        *parts[0][:30], *parts[1][30:60],
        *((START + k * MS, more[k].tobytes()) for k in range(60, COUNT)),
    ]  # fmt: skip
    log = record(found)
    assert np.array_equal(log.position, POSITION) and np.array_equal(log.effort, EFFORT)


def test_several_runs_in_one_bag_are_refused(tmp_path):
    path = tmp_path / 'bag'
    path.mkdir()
    for space in ('left', 'right'):
        write_foreign(tmp_path / space, streams(REFERENCE, POSITION), space=f'/{space}')
        (tmp_path / space / f'{space}.mcap').rename(path / f'{space}.mcap')
    with pytest.raises(BagError, match='several runs, in /left, /right'):
        recording.read(path)


def test_answers_belong_to_their_states(record):
    found = streams(REFERENCE, POSITION, EFFORT)
    assert np.array_equal(record(found).answer, EFFORT)


def test_answers_belong_to_their_states_when_some_are_lost(record):
    found = streams(REFERENCE, POSITION, EFFORT)
    for topic, lost in ((topics.COMMANDS, (7, 8)), (topics.JOINT_STATES, (50,))):
        found[topic] = [entry for k, entry in enumerate(found[topic]) if k not in lost]
    answer = record(found).answer
    expected = np.delete(EFFORT, 50, axis=0)
    expected[[7, 8]] = np.nan
    expected[49] = EFFORT[50]  # of the state that is lost
    assert np.array_equal(answer, expected, equal_nan=True)


CALM = np.cumsum(1e-4 * RANDOM.normal(size=(COUNT, 3)), axis=0)


def joint_states(position, start):
    """Messages of the states alone, one a millisecond."""
    return streams(position, position, start=start)[topics.JOINT_STATES]


def test_references_that_end_count_as_long_as_for_the_controller(record):
    """What the controller takes no more has no error; it is told from when on."""
    found = streams(CALM, CALM)
    parts = (joint_states(CALM, START + k * COUNT * MS) for k in range(8))
    found[topics.JOINT_STATES] = [*itertools.chain(*parts)]
    log = record(found)
    last = COUNT - 1 + round(1e3 * log.config['safety.reference_timeout'])
    assert log.referenced.tolist() == [k <= last for k in range(8 * COUNT)]
    assert f'from t = {(last + 1) / 1e3:.3f} s on, have no reference' in log.warnings[0]
    assert run_log.with_reference(log).time[-1] == last / 1e3


def test_references_of_another_clock_are_none(record):
    found = streams(CALM, CALM)
    found[topics.JOINT_STATES] = joint_states(CALM, START + 5000 * MS)
    log = record(found)
    assert not log.referenced.any() and 'are 5 s behind those of joint_states' in log.warnings[0]
    with pytest.raises(KinematicsError, match='no state has a reference of its time'):
        recorded_motions.with_poses(log)


def test_states_are_put_in_the_order_of_their_stamps(record):
    found = streams(CALM, CALM)
    swapped = np.arange(COUNT).reshape(-1, 2)[:, ::-1].ravel()
    times = [log_time for log_time, _ in found[topics.JOINT_STATES]]
    payloads = [found[topics.JOINT_STATES][k][1] for k in swapped]
    found[topics.JOINT_STATES] = list(zip(times, payloads, strict=True))
    log = record(found)
    assert np.array_equal(log.position, CALM) and (np.diff(log.stamps) > 0).all()
    assert f'{COUNT // 2} messages on joint_states came after newer ones' in log.warnings[0]


def test_messages_of_other_publishers_are_left_out(record):
    """A gripper's, and those of a publisher that knows positions alone."""
    found = streams(CALM, CALM, EFFORT)
    grip = layouts.joint_state(('gripper',))
    zeros = layouts.joint_state(JOINTS, ('position',))
    for k in range(0, COUNT, 10):
        stamp = START + k * MS
        found[topics.JOINT_STATES] += [
            (stamp + 1, grip.encode(stamp, position=[0.0], velocity=[0.0], effort=[0.0])),
            (stamp + 2, zeros.encode(stamp, position=[0.0] * 3)),
        ]
    log = record(found)
    assert np.array_equal(log.position, CALM) and np.array_equal(log.effort, EFFORT)
    assert counts(log) == dict.fromkeys(counts(log), (COUNT, 0)) and len(counts(log)) == 3
    gripper, positions, _ = log.warnings
    assert '10 messages on joint_states are of other joints (gripper)' in gripper
    assert '10 of 110 messages on joint_states have no velocity' in positions


def test_joints_of_a_gripper_in_the_same_messages_may_know_nothing(record):
    """As a broadcaster writes them, in an order of its own; they are not looked at."""
    found, names = streams(CALM, CALM, EFFORT), ('gripper', *JOINTS[::-1], 'lamp')
    layout = layouts.joint_state(names)
    known = np.full((3, COUNT, len(names)), np.nan)
    known[:, :, 1:4] = np.array([CALM, CALM + 1.0, EFFORT])[:, :, ::-1]
    found[topics.JOINT_STATES] = [
        (
            START + k * MS,
            layout.encode(START + k * MS, position=row[0], velocity=row[1], effort=row[2]),
        )
        for k, row in enumerate(np.moveaxis(known, 1, 0))
    ]
    log = record(found)
    assert np.array_equal(log.velocity, CALM + 1.0) and np.array_equal(log.effort, EFFORT)
    assert np.array_equal(log.position, CALM) and log.has_efforts


def test_states_of_two_publishers_or_recordings_are_doubted(record):
    leaping = CALM.copy()
    leaping[::10] += 0.5
    found = streams(CALM, leaping)
    found[topics.JOINT_STATES][50:] = joint_states(CALM[50:], START + 3600_000 * MS)
    found[topics.REFERENCE] += streams(CALM, CALM, start=START + 3600_000 * MS)[topics.REFERENCE]
    doubts = ' '.join(record(found).warnings)
    assert 'no states for 3600 s' in doubts and 'leap by more than 0.1 rad and back' in doubts


@pytest.mark.parametrize(
    ('name', 'kind'),
    [
        ('/robot1/joint_states', 'sensor_msgs/msg/JointState'),
        ('/joint_states', 'sensor_msgs/JointState'),
    ],
)
def test_topics_that_may_be_meant_are_named(name, kind, tmp_path):
    """Those of another namespace than the reference, or with a type as ROS 1 writes it."""
    found = streams(REFERENCE, POSITION)
    states = Topic(name.lstrip('/'), kind)
    found = {topics.REFERENCE: found[topics.REFERENCE], states: found[topics.JOINT_STATES]}
    with (tmp_path / 'bag.mcap').open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        for topic, messages in found.items():
            schema = writer.register_schema(topic.type, 'ros2msg', b'')
            channel = writer.register_channel(f'/{topic.name}', 'cdr', schema)
            for log_time, data in messages:
                writer.add_message(channel, log_time, data, log_time)
        writer.finish()
    missing = 'reference' if 'robot1' in name else 'joint_states'
    with pytest.raises(BagError, match=f'no messages on {missing}') as error:
        recording.read(tmp_path / 'bag.mcap')
    meant = '/reference (trajectory_msgs' if 'robot1' in name else f'{name} ({kind})'
    assert f'it has {meant}' in str(error.value)
