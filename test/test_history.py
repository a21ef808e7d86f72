"""What a bag says beside the motion."""

import contextlib

import numpy as np
from bags import START, streams
from hypothesis import given
from hypothesis import strategies as st
from test_plain_data import DEFAULTS, PLAIN

from parallel_robot.bags import history
from parallel_robot.bags.files.bag_files import MESSAGES, Certificate
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_control.messages import Status, status_message
from parallel_robot_control.safety import faults, limiting
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.messages import topics

CODES = {'joint_states': Certificate(10, 3).dump(), 'pose': Certificate(1, 0).dump()}


@contextlib.contextmanager
def at_rest(directory):
    """A bag of a robot at rest, which can be added to."""
    with BagWriter(directory, topics.RECORDED, {}) as writer:
        for topic, messages in streams(np.zeros((2, 3)), np.zeros((2, 3))).items():
            for log_time, message in messages:
                writer.write(topic.name, log_time, message)
        yield writer


def test_faults_limits_and_losses(tmp_path):
    told = [
        Status('pid', None, 0),
        Status('pid', None, limiting.RATE | limiting.TORQUE),
        Status(
            'pid',
            faults.FAULTS[faults.EMERGENCY_STOP],
            limiting.RATE | limiting.TORQUE | limiting.RAMP,
        ),
        Status('smc', None, 0),
    ]
    with at_rest(tmp_path / 'bag') as writer:
        for k, status in enumerate(told):
            stamp = START + k * 10**9
            writer.write(topics.STATUS.name, stamp, status_message(stamp, status))
        writer.note(MESSAGES, CODES)
    past = recording.read(tmp_path / 'bag').history
    assert [status.fault for status in past.statuses] == ['none', 'none', 'emergency_stop', 'none']
    assert [status.law for status in past.statuses] == ['pid', 'pid', 'pid', 'smc']
    assert past.statuses[2].limits == ('torque', 'rate', 'ramp')
    assert history.remarks(past, START) == [
        'limits acted: ramp after a take-over, torque limit, torque rate limit',
        'fault at t = 2.000 s, safe action from there on: emergency stop',
        'fault cleared at t = 3.000 s',
    ]
    assert past.lost == {'joint_states': 3, 'pose': 0}
    (line,) = history.losses(past)
    assert line.endswith('lost on their way to the bag: joint_states (3)')


def test_statuses_of_one_stamp_stay_in_the_order_of_the_recording(tmp_path):
    told = [
        Status('smc', faults.FAULTS[faults.EMERGENCY_STOP], 0),
        Status('smc', None, 0),
        Status('pid', None, 0),
    ]
    with at_rest(tmp_path / 'bag') as writer:
        for k, status in enumerate(told):
            writer.write(topics.STATUS.name, START + k, status_message(START, status))
    past = recording.read(tmp_path / 'bag').history
    assert [(status.law, status.fault) for status in past.statuses] == [
        ('smc', 'emergency_stop'),
        ('smc', 'none'),
        ('pid', 'none'),
    ]


@given(st.dictionaries(st.sampled_from(['law', 's_fotsmc.G', 'joints', 'own.gain']), PLAIN))
def test_changes_are_like_the_default_or_left_out(changes):
    found = history._values(plain_data.dump(changes), DEFAULTS)
    assert found == {k: v for k, v in found.items() if changes[k] == v}
    assert isinstance(found.get('law', ''), (str, bool))
    assert isinstance(found.get('s_fotsmc.G', 1.0), (int, float))
    assert all(isinstance(name, str) for name in found.get('joints', []))
