"""The recorder without ROS."""

import itertools
import json
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from bags import content
from mcap.reader import make_reader

from parallel_robot.bags import bag_reader, history
from parallel_robot.bags.files.bag_files import MESSAGES, open_file
from parallel_robot.bags.files.mcap_reader import scan
from parallel_robot.bags.files.mcap_records import Block
from parallel_robot.bags.messages.message_types import channel, channel_of, qos_profile
from parallel_robot.bags.writing import recorder as module
from parallel_robot.bags.writing.recorder import Recorder
from parallel_robot_control.messages import Status, answers_message, status_message
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.messages.topics import Topic

START = 10**9  # ns; that of lockstep
MS = 10**6  # ns
SAMPLES = 20
LAYOUTS = {
    topics.JOINT_STATES.type: layouts.joint_state(('a', 'b', 'c')),
    topics.REFERENCE.type: layouts.joint_trajectory(('a', 'b', 'c')),
    topics.POSE.type: layouts.pose_stamped('base'),
}
LAW = layouts.text_message('s_fotsmc')


def message(topic, k):
    """Message of a topic for state k."""
    if topic == topics.ACTIVE_LAW:
        return LAW
    if topic == topics.STATUS:
        return status_message(START + k * MS, Status('s_fotsmc', None, 0))
    if topic == topics.COMMANDS:
        return layouts.float64_multi_array(3).encode(data=[k, k, k])
    if topic == topics.ANSWERED:
        return answers_message(np.full((1, 3), START + k * MS), np.full((1, 3), -float(k)))
    return LAYOUTS[topic.type].encode(START + k * MS)


@pytest.fixture
def make(tmp_path):
    """Make a recorder of 20 ms of motion; its errors end the test."""

    def make(mode='lockstep', seconds=SAMPLES * 1e-3):
        values = config.resolve('paper_circle', {'time_mode': mode, 'duration': seconds})
        loop = group(values, LoopParameters, '')
        return Recorder(tmp_path / 'bag', loop, values, pytest.fail)

    return make


def take(recorder, indices=range(SAMPLES + 1), left_out=()):
    """Give the messages of some states, except those of `left_out`: (topic, k)."""
    for k in indices:
        for topic in topics.RECORDED:
            if k % (topic.every or 1000) == 0 and (topic, k) not in left_out:
                recorder.take(topic, message(topic, k))


def recorded(tmp_path):
    return content(tmp_path / 'bag' / 'bag_0.mcap')


def test_a_whole_motion_in_lockstep_has_the_time_of_the_simulation(make, tmp_path):
    recorder = make()
    recorder.open(START)
    take(recorder)
    assert recorder.complete()
    report = recorder.close()
    found = recorded(tmp_path)
    for topic in topics.RECORDED:
        indices = range(0, SAMPLES + 1, topic.every or 1000)
        assert found[topic.name] == [(START + k * MS, message(topic, k)) for k in indices]
        line = f'{topic.name}: received {len(indices)}, written {len(indices)}, lost 0'
        assert line in report
    assert len(report) == len(topics.RECORDED)


SWITCHES = [(0, 's_fotsmc'), (5, 'pid'), (12, 's_fotsmc')]  # state, law


@pytest.mark.parametrize('common', [True, False])
@pytest.mark.parametrize('order', ['name first', 'status first', 'names last'])
def test_in_lockstep_the_name_of_a_law_has_the_time_of_its_switch(order, common, make, tmp_path):
    names = [(topics.ACTIVE_LAW, layouts.text_message(law)) for _, law in SWITCHES]
    statuses = [
        (topics.STATUS, status_message(START + k * MS, Status(law, None, limits)))
        for k, law in SWITCHES
        for limits in (0, 1)  # the second says no other law
    ]
    pairs = [[name, *statuses[2 * i : 2 * i + 2]] for i, name in enumerate(names)]
    told = {
        'name first': [*itertools.chain(*pairs)],
        'status first': [*itertools.chain(*(pair[::-1] for pair in pairs))],
        'names last': statuses + names,
    }[order]
    recorder = make()
    recorder.open(START if common else 0)
    take(recorder, range(9), left_out=[(topics.ACTIVE_LAW, 0), (topics.STATUS, 0)])
    for topic, data in told:
        recorder.take(topic, data)
    recorder.close()
    expected = [(START + k * MS, data) for (k, _), (_, data) in zip(SWITCHES, names, strict=True)]
    assert recorded(tmp_path)['controller/active_law'] == expected


def test_names_of_laws_from_before_the_first_status_are_kept(make, tmp_path):
    """One of another controller, one that is broken; a status that is broken names none."""
    recorder = make()
    recorder.open(START)
    take(recorder, range(9), left_out=[(topics.ACTIVE_LAW, 0), (topics.STATUS, 0)])
    pid = layouts.text_message('pid')
    early = [layouts.text_message('s_fotsmc'), b'\x00\x01\x00\x00']
    for name in early:
        recorder.take(topics.ACTIVE_LAW, name)
    recorder.take(topics.STATUS, b'\x00\x01\x00\x00' + bytes(8) + b'broken')
    recorder.take(topics.STATUS, status_message(START + 3 * MS, Status('pid', None, 0)))
    recorder.take(topics.ACTIVE_LAW, pid)
    recorder.close()
    expected = [*((START, name) for name in early), (START + 3 * MS, pid)]
    assert recorded(tmp_path)['controller/active_law'] == expected


def test_the_name_of_a_law_without_statuses_is_written_at_once(tmp_path):
    values = config.resolve('paper_circle', {'time_mode': 'lockstep'})
    loop = group(values, LoopParameters, '')
    recorder = Recorder(tmp_path / 'bag', loop, values, pytest.fail, suite=())
    for topic in (topics.JOINT_STATES, topics.ACTIVE_LAW):
        recorder.add(topic, channel_of(topic))
    recorder.open()
    recorder.take(topics.JOINT_STATES, message(topics.JOINT_STATES, 7))
    recorder.take(topics.ACTIVE_LAW, LAW)
    recorder.close()
    assert recorded(tmp_path)['controller/active_law'] == [(START + 7 * MS, LAW)]


def test_messages_from_outside_the_motion_are_left_out(make, tmp_path):
    recorder = make()
    recorder.open(START)
    for k in (-1000, -1, SAMPLES + 1, SAMPLES + 1000):
        for topic in topics.RECORDED:
            if topic.type in LAYOUTS:
                recorder.take(topic, message(topic, k))
    assert not recorder.complete()
    take(recorder)
    recorder.close()
    stamps = {stamp for stream in recorded(tmp_path).values() for stamp, _ in stream}
    assert (min(stamps), max(stamps)) == (START, START + SAMPLES * MS)


def test_before_the_start_only_the_latched_is_kept(make, tmp_path):
    recorder = make()
    take(recorder, range(5))
    assert not recorder.complete() and not (tmp_path / 'bag').exists()
    recorder.open(START)
    recorder.close()
    assert recorded(tmp_path) == {
        'controller/active_law': [(START, LAW)],
        'controller/status': [(START, message(topics.STATUS, 0))],
    }


def test_in_real_time_the_log_time_is_that_of_reception(make, tmp_path):
    recorder = make('wall')
    recorder.open(START)
    before = time.time_ns()
    take(recorder)
    after = time.time_ns()
    recorder.close()
    for stream in recorded(tmp_path).values():
        times = [stamp for stamp, _ in stream]
        assert times == sorted(times) and before <= times[0] and times[-1] <= after


@pytest.mark.parametrize('topic', topics.RECORDED, ids=lambda topic: topic.name)
def test_the_motion_is_complete_with_its_last_message(topic, make):
    recorder = make()
    recorder.open(START)
    last = (topic, SAMPLES if topic.every else 0)
    take(recorder, left_out=[last])
    assert not recorder.complete()
    recorder.take(topic, message(*last))
    assert recorder.complete()
    recorder.close()


def test_what_never_comes_is_not_waited_for_and_reported(make, monkeypatch):
    recorder = make()
    recorder.open(START)
    lost = [(topics.REFERENCE, 3), (topics.REFERENCE, 4), (topics.POSE, 10)]
    take(recorder, left_out=lost)
    assert not recorder.complete()
    now = time.monotonic()
    monkeypatch.setattr(time, 'monotonic', lambda: now + 10.0)
    assert recorder.complete()
    report = recorder.close()
    assert 'reference: received 19, written 19, lost 2' in report
    assert 'pose: received 2, written 2, lost 1' in report


def test_a_long_silence_before_the_end_is_no_end(make, monkeypatch):
    recorder = make()
    recorder.open(START)
    take(recorder, range(SAMPLES))
    now = time.monotonic()
    monkeypatch.setattr(time, 'monotonic', lambda: now + 1000.0)
    assert not recorder.complete()
    recorder.close()


def test_a_motion_without_end_is_never_complete(make):
    recorder = make(seconds=0.0)
    recorder.open(START)
    take(recorder, range(200))
    assert not recorder.complete()
    assert 'joint_states: received 200, written 200, lost unknown' in recorder.close()


def test_by_hand_the_commands_of_lockstep_have_the_time_of_their_states(make, tmp_path):
    """Without a common start the recorder listens at once; time is still the simulation's."""
    recorder = make(seconds=0.0)
    recorder.open()
    take(recorder, range(5))
    recorder.close()
    found = recorded(tmp_path)
    times = [stamp for stamp, _ in found['joint_states']]
    assert [stamp for stamp, _ in found['effort_controller/commands']] == times


def test_a_recorder_that_was_never_opened_leaves_nothing(make, tmp_path):
    recorder = make()
    take(recorder)
    assert recorder.close() == [] and not list(tmp_path.iterdir())


def test_a_bag_that_exists_is_refused(make, tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(BagError, match='exists'):
        make().open(START)


@pytest.mark.parametrize('data', [b'', b'\x00\x01\x00\x00', b'\x00\x01\x00\x00\x01'])
def test_bytes_too_short_for_a_stamp_do_no_harm(data, make, tmp_path):
    recorder = make()
    recorder.open(START)
    recorder.take(topics.JOINT_STATES, data)
    take(recorder)
    recorder.close()
    assert len(recorded(tmp_path)['joint_states']) == SAMPLES + 1


def test_what_comes_slowly_is_soon_with_the_system(make, tmp_path, monkeypatch):
    monkeypatch.setattr(module, 'FLUSH', 0.05)
    recorder = make()
    recorder.open(START)
    take(recorder, range(2))
    deadline = time.monotonic() + 100.0
    file, count = tmp_path / 'bag' / 'bag_0.mcap', 0
    while count < sum(recorder.received.values()):
        assert time.monotonic() < deadline, 'waited in vain'
        blocks = [record for record in scan(*open_file(file)) if isinstance(record, Block)]
        count = sum(len(block.starts) for block in blocks)
    recorder.close()


def test_a_full_disk_is_handed_over(tmp_path):
    script = f"""
        import os, resource, threading
        from pathlib import Path
        from parallel_robot.bags.writing.recorder import Recorder
        from parallel_robot_model.configuration import config
        from parallel_robot_model.messages import layouts, topics
        from parallel_robot_model.configuration.fields import group
        from parallel_robot_model.configuration.loop import LoopParameters

        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        failed, errors = threading.Event(), []
        values = config.resolve('paper_circle')
        loop = group(values, LoopParameters, '')
        recorder = Recorder(Path({str(tmp_path / 'bag')!r}), loop, values,
                            lambda error: (errors.append(error), failed.set()))
        recorder.open()
        layout = layouts.float64_multi_array(1000)
        for _ in range(200):
            recorder.take(topics.COMMANDS, layout.encode() + os.urandom(9000))
        assert failed.wait(100.0)
        recorder.close()
        print([f'{{type(error).__name__}}: {{error}}' for error in errors])
    """
    done = subprocess.run(
        [sys.executable, '-c', textwrap.dedent(script)],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        timeout=300.0,
    )
    message = f'RunError: cannot write {tmp_path / "bag"}: File too large'
    assert done.stdout == f'{[message]}\n'
    assert done.returncode == 0 and done.stderr == ''


def certificate(tmp_path):
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        records = make_reader(stream).iter_metadata()
        return next(record.metadata for record in records if record.name == MESSAGES)


def test_missing_numbers_are_losses_and_stand_in_the_bag(make, tmp_path):
    recorder = make('wall', seconds=0.0)
    recorder.open()
    for number in (7, 8, 11, 12, 1, 2, 4):  # two lost, a new publisher, one lost
        recorder.take(topics.JOINT_STATES, message(topics.JOINT_STATES, number), 0, number)
        recorder.take(topics.POSE, message(topics.POSE, number), 0, number)
    for number in (1, 2, 1, 2):  # what the first one sent last is not known
        recorder.take(topics.REFERENCE, message(topics.REFERENCE, number), 0, number)
    recorder.several(topics.POSE)
    report = recorder.close()
    assert 'joint_states: received 7, written 7, lost 3' in report
    assert 'pose: received 7, written 7, lost unknown' in report
    found = certificate(tmp_path)
    assert json.loads(found['joint_states']) == {'written': 7, 'lost': 3}
    assert json.loads(found['pose']) == {'written': 7, 'lost': None}
    assert json.loads(found['reference']) == {'written': 4, 'lost': None}


def test_a_state_that_the_controller_left_out_is_no_loss(make, tmp_path, monkeypatch):
    """In wall time, numbers tell what was lost of what the controller published."""
    recorder = make('wall')
    recorder.open(START)
    skipped, lost = (3, 4, 10), 7
    take(recorder, left_out=[(topic, k) for topic in module.ANSWERS for k in range(SAMPLES + 1)])
    number = 0
    for k in range(SAMPLES + 1):
        number += k not in skipped
        if k not in (*skipped, lost):
            for topic in (topics.COMMANDS, topics.ERROR):
                recorder.take(topic, message(topic, k), 0, number)
    now = time.monotonic()
    monkeypatch.setattr(time, 'monotonic', lambda: now + 10.0)
    assert recorder.complete()
    report = recorder.close()
    assert 'effort_controller/commands: received 17, written 17, lost 1' in report
    assert 'controller/error: received 17, written 17, lost 1' in report
    assert f'joint_states: received {SAMPLES + 1}, written {SAMPLES + 1}, lost 0' in report
    assert 'controller/sliding_variable: received 0, written 0, lost 3' in report


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_commands_that_answer_no_state_are_recorded_as_such(mode, make, tmp_path):
    recorder = make(mode)
    recorder.open(START)
    take(recorder, range(6))
    zero = answers_message(np.zeros((1, 3), np.int64), np.zeros((1, 3)))
    recorder.take(topics.ANSWERED, zero)
    recorder.close()
    log_time, data = recorded(tmp_path)['controller/answered'][-1]
    assert data == zero and (mode == 'wall' or log_time == START + 5 * MS)


def test_the_middleware_tells_the_time_of_reception(make, tmp_path):
    recorder = make('wall', seconds=0.0)
    recorder.open()
    recorder.take(topics.JOINT_STATES, message(topics.JOINT_STATES, 1), 12345)
    recorder.close()
    assert recorded(tmp_path)['joint_states'][0][0] == 12345


ODD = Topic('odd', 'odd_msgs/msg/Odd', 0)
OFFER = 'int32 value', 'RIHS01_1', [qos_profile(False, False)]


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_other_topics_are_recorded_with_their_definition(mode, make, tmp_path):
    recorder = make(mode, seconds=0.0)
    recorder.add(ODD, channel(ODD.name, ODD.type, *OFFER))
    recorder.add(ODD._replace(name='silent'), channel('silent', ODD.type, *OFFER))
    recorder.open()
    recorder.take(topics.JOINT_STATES, message(topics.JOINT_STATES, 5))
    recorder.take(ODD, b'\x00\x01\x00\x00\x01\x00\x00\x00', 5 * 10**9, 1)
    report = recorder.close()
    assert 'odd: received 1, written 1, lost 0' in report
    assert 'silent: received 0, written 0, lost unknown' in report
    ((log_time, data),) = recorded(tmp_path)['odd']
    assert log_time == (5 * 10**9 if mode == 'wall' else START + 5 * MS) and data[4] == 1
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        summary = make_reader(stream).get_summary()
    (schema,) = (s for s in summary.schemas.values() if s.name == ODD.type)
    (odd,) = (c for c in summary.channels.values() if c.schema_id == schema.id)
    assert schema.data == b'int32 value' and 'best_effort' in str(odd.metadata)


@pytest.mark.parametrize('early', [False, True])
def test_the_recorder_notes_parameters_and_their_changes(early, tmp_path):
    values = config.resolve('paper_circle', {'time_mode': 'lockstep', 'duration': 0.1})
    loop = group(values, LoopParameters, '')
    recorder = Recorder(tmp_path / 'bag', loop, values, pytest.fail)
    if not early:
        recorder.open(10**9)
    recorder.found('/controller', {'law': 'pid', 'pid.Kp': 3.0, 'joints': ['a', 'b']})
    recorder.changed('/controller', {'law': 'smc'})
    if early:
        recorder.open(10**9)
    recorder.close()
    past = history.of(bag_reader.read(tmp_path / 'bag', (), print), ())
    assert past.parameters == {'/controller': {'law': 'pid', 'pid.Kp': 3.0, 'joints': ['a', 'b']}}
    stamp = 0 if early else 10**9
    assert past.changes == (history.Change(stamp, '/controller', {'law': 'smc'}),)
    assert past.facts['source'] == 'nodes'
