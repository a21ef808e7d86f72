"""Ten thousand messages of every kind into the controller, half as many into the plant."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.messages import topics
from parallel_robot_sim.plant_node import PlantNode
from trajectory_gen.configuration import trajectory_of

pytest_plugins = ['ros_fixtures']

JOINTS = ('joint1', 'joint2', 'joint3')
MOTION = trajectory_of(config.resolve('paper_circle')).sample(np.arange(100) * 1e-3)
LIMITS = group(config.resolve('paper_circle'), SafetyParameters, 'safety')
BATCH = 50  # messages of one example
SECOND, MS = 10**9, 10**6  # ns

NAMES = [
    *[JOINTS] * 40,
    JOINTS[::-1],
    ('joint2', 'gripper', 'joint3', 'joint1'),
    JOINTS[:2],
    (),
    ('joint1', 'joint2', 'joint4'),
    (*JOINTS, 'joint2'),
    ('joint1', 'joint1', 'joint1'),
    (*JOINTS, 'j' * 3000),
    (*JOINTS, 'Gelenk \u00e4\U0001f916'),
    (*JOINTS, ''),
]
NUMBERS = [
    *[None] * 48,  # what would be right there
    0.0, -0.0, 1e-3, 0.5, -10.0, 2 * math.pi, 1e6, 1e155, 1.7e308, -1.7e308, 5e-324,
    math.nan, math.inf, -math.inf,
]  # fmt: skip
# Seconds and nanoseconds after the stamp before, or seconds of their own.
STAMPS = [
    *[(0, 1_000_000)] * 32, (0, 0), (0, -1_000_000), (0, 1), (0, 40_000_000), (0, 300_000_000),
    (-1, 0), (1, 0), (1000, 0),
    'zero', 'negative', 'largest', 'no nanoseconds', 'other end',
]  # fmt: skip
OWN_STAMPS = {
    'zero': (0, 0),
    'negative': (-5, 0),
    'largest': (2**31 - 1, 999_999_999),
    'no nanoseconds': (2**31 - 1, 2**32 - 1),
    'other end': (-(2**31), 0),
}
KINDS = ['command', 'garbage', 'watch', 'clear', 'begin', 'begin']
MESSAGE = st.tuples(
    st.sampled_from(['state'] * 6 + ['reference'] * 6 + KINDS),
    st.sampled_from(STAMPS),
    st.sampled_from(NAMES),
    st.sampled_from([None] * 40 + ['short', 'long', 'empty', 'cut', 'flipped', 'again']),
    st.sampled_from(NUMBERS),
    st.integers(0, 2**16 - 1),
    st.sampled_from(['', '', 'base', 'x' * 3000]),
)


def stamp_after(last, step):
    """Seconds and nanoseconds of the next stamp."""
    if isinstance(step, str):
        return OWN_STAMPS[step]
    total = last[0] * SECOND + last[1] + step[0] * SECOND + step[1]
    sec, nanosec = divmod(total, SECOND)
    return min(max(sec, -(2**31)), 2**31 - 1), nanosec


def spoil(row, how, number, place):
    """A row of numbers with one of them, or its length, changed."""
    row = [float(value) for value in row]
    if number is not None and row:
        row[place % len(row)] = number
    return {'short': row[:-1], 'long': [*row, 0.0], 'empty': []}.get(how, row)


def encode(kind, stamp, names, how, number, place, frame):
    """Bytes of one message."""
    if kind == 'garbage':
        return np.random.default_rng(place).bytes(place % 400)
    k = place % 100
    order = [JOINTS.index(name) if name in JOINTS else 0 for name in names]
    rows = [MOTION.position[k], MOTION.velocity[k], MOTION.acceleration[k]]
    rows = [list(row[order]) for row in rows]
    rows[place % 3] = spoil(rows[place % 3], how, number, place // 3)
    if kind == 'command':
        return serialize_message(Float64MultiArray(data=rows[place % 3]))
    if kind == 'state':
        message = JointState(name=list(names))
        message.position, message.velocity, message.effort = rows
    else:
        message = JointTrajectory(joint_names=list(names))
        message.points = [
            JointTrajectoryPoint(positions=rows[0], velocities=rows[1], accelerations=rows[2])
        ] * (place % 7 != 0 or place % 2)
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    message.header.frame_id = frame
    data = serialize_message(message)
    if how == 'cut':
        return data[: place % len(data)]
    if how == 'flipped':
        at = 4 + place % (len(data) - 4)
        return data[:at] + bytes([data[at] ^ (1 << place % 8)]) + data[at + 1 :]
    return data


def feed(node, commands, messages):
    """Give messages to the callbacks of the controller; how many of the made-up it answered."""
    good = 0
    stamps = {'state': (1000, 0), 'reference': (1000, 0)}
    for kind, step, names, how, number, place, frame in messages:
        if kind in stamps:
            stamps[kind] = stamp_after(stamps[kind], step)
        if kind == 'watch':
            node._watch()
        elif kind == 'clear':
            node._answer_clear_fault(Trigger.Request(), Trigger.Response())
        elif kind == 'begin':
            second = 3000 + place
            before = len(commands)
            begin(node, second)
            good += len(commands) - before
            stamps = dict.fromkeys(stamps, (second, 0))
        else:
            stamp = stamps.get(kind, (0, 0))
            data = encode(kind, stamp, names, how, number, place, frame)
            for _ in range(2 if how == 'again' else 1):
                (node._on_state if kind == 'state' else node._on_reference)(data)
    return len(commands) - good


def pair(stamp):
    """A good reference and a good state."""
    plain = (stamp, 0), JOINTS, None, None, 1, ''
    return (encode(kind, *plain) for kind in ('reference', 'state'))


def begin(node, second):
    """Begin a new run: a good pair, and what confirms the robot."""
    for data, take in zip(pair(second), (node._on_reference, node._on_state), strict=True):
        take(data)
    for answer in ('clear_fault', 'confirm_pose', 'clear_fault'):  # it may be lost
        getattr(node, f'_answer_{answer}')(Trigger.Request(), Trigger.Response())


def torques_of(data):
    """Numbers of a command, by another reader than the suite's."""
    return np.array(deserialize_message(data, Float64MultiArray).data)


def test_no_message_stops_the_controller_or_spoils_its_torque(node):
    controller, commands = node(ControllerNode, topics.COMMANDS)
    answered = []

    @settings(max_examples=150)
    @given(st.lists(MESSAGE, min_size=BATCH, max_size=BATCH))
    def check(messages):
        commands.clear()
        answered.append(feed(controller, commands, messages))
        spoilt = len(commands)
        controller._answer_clear_fault(Trigger.Request(), Trigger.Response())
        for second in (2000, 2002, 2004):
            begin(controller, second)
        torques = np.array([torques_of(data) for data in commands])
        assert torques.shape == (len(commands), 3) and np.isfinite(torques).all()
        assert (np.abs(torques) <= np.array(LIMITS.torque_limit)).all()
        assert len(commands) > spoilt and not controller._controller.fault

    check()
    assert sum(answered) > 200  # some of it was no nonsense
    reasons = '; '.join(controller.counts)
    for reason in ('missing', 'named twice', 'not finite', 'short', 'not a message', 'in ns'):
        assert reason in reasons


def test_no_message_stops_the_plant_or_spoils_its_state(node):
    """Commands that drive the robot out of its workspace hold it there."""
    plant, states = node(PlantNode, topics.JOINT_STATES)
    if plant.loop.lockstep:
        plant.set_start(SECOND)

    def take(data, tick):
        plant.take_command(data)
        if not plant.loop.lockstep:
            plant.tick(tick * MS)
        if plant.alarm():
            plant.run.reset()

    @settings(max_examples=50)
    @given(st.lists(MESSAGE, min_size=BATCH, max_size=BATCH))
    def check(messages):
        states.clear()
        for tick, (kind, _, names, how, number, place, frame) in enumerate(messages):
            kind = 'garbage' if kind == 'garbage' else 'command'
            take(encode(kind, (0, 0), names, how, number, place, frame), 1000 + tick)
            assert np.isfinite(plant.run.command).all() and plant.run.command.shape == (3,)
        for data in states:
            joints = deserialize_message(data, JointState)
            for numbers in (joints.position, joints.velocity, joints.effort):
                assert np.isfinite(numbers).all()
            assert np.abs(joints.effort).max() <= 200.0
        answered.append(len(states))

    answered = []
    check()
    assert sum(answered) > 500 and plant.exit_code is None
    assert plant.counts['commands that are not three finite torques'] > 500
