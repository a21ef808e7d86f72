"""Broken bags: what is intact in them is read and recovered, and nothing else."""

import random
import shutil
import tracemalloc
from collections import Counter

import numpy as np
import pytest
from assembly import simulated
from bags import chunks, content, motion_of, streams, write_foreign, write_mcap
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader

from parallel_robot.analysis import metrics
from parallel_robot.bags.run import recording, run_log
from parallel_robot.bags.writing import bag_writer, simulation_bag
from parallel_robot.bags.writing.recovery import recover
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics

CASES = [25, pytest.param(100, marks=pytest.mark.endurance)]
RANDOM = random.Random(5)
VALUES = config.resolve('paper_circle', {'duration': 0.08, 'time_mode': 'lockstep'})


@pytest.fixture(scope='module', autouse=True)
def _quick():
    """Read the configuration once, not twice a case."""
    with pytest.MonkeyPatch.context() as patch:
        whole = config.resolve
        known = {None: whole('paper_circle')}

        def resolve(scenario, overrides=None, *loaded):
            key = repr(overrides) if overrides else None
            if key not in known:
                known[key] = whole(scenario, overrides, *loaded)
            return dict(known[key])

        patch.setattr(config, 'resolve', resolve)
        yield


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """A run of 0.08 s in many small chunks."""
    directory = tmp_path_factory.mktemp('whole') / 'bag'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bag_writer, 'CHUNK_SIZE', 4_000)
        simulation_bag.write(directory, VALUES, [simulated(VALUES)])
    return directory


@pytest.fixture(scope='module')
def whole(bag):
    """Bytes and chunks of the file of that run."""
    path = bag / 'bag_0.mcap'
    found = chunks(path)
    assert len(found) > 10
    return path.read_bytes(), found


@pytest.fixture
def broken(bag, tmp_path):
    """Copy of the bag with other content of its file."""

    def broken(data):
        directory = tmp_path / 'broken'
        shutil.copytree(bag, directory, dirs_exist_ok=True)
        (directory / 'bag_0.mcap').write_bytes(data)
        return directory

    return broken


def messages(path):
    """Every message of a bag, as mcap reads them."""
    return Counter(
        (f'/{topic}', *entry)
        for topic, entries in content(next(path.glob('*.mcap'))).items()
        for entry in entries
    )


def attempt(function, *arguments):
    """Result of a function and None, or None and the text of its BagError."""
    try:
        return function(*arguments), None
    except BagError as error:
        return None, str(error)


def check(directory, out, found, touched):
    """What is intact is recovered and can be read; `touched(begin, end)` says what is not."""
    intact = Counter(
        message for begin, end, inside in found if not touched(begin, end) for message in inside
    )
    every = Counter(message for *_, inside in found for message in inside)
    report, error = attempt(recover, directory, out)
    if report:
        copied = messages(out)
        assert intact <= copied <= every
        assert report.kept.total() == copied.total()
        assert report.written.total() in (0, every.total())
        shutil.rmtree(out)
    else:
        assert not intact and '\n' not in error and not out.exists()
    found, error = attempt(recording.read, directory)
    if found:
        log = found.log
        metrics.evaluate(motion_of(log))
        assert not any('\n' in warning for warning in log.warnings)
    else:
        assert len(intact) < 50 and '\n' not in error


@pytest.mark.parametrize('cases', CASES)
def test_a_file_that_is_cut_anywhere(cases, broken, whole, tmp_path):
    data, found = whole
    for offset in [0, 1, 8, len(data) - 1, *RANDOM.sample(range(len(data)), cases)]:
        check(broken(data[:offset]), tmp_path / 'out', found, lambda _, end: end > offset)  # noqa: B023


@pytest.mark.parametrize('cases', CASES)
def test_a_byte_that_is_changed_anywhere(cases, broken, whole, tmp_path):
    data, found = whole
    heads = [begin + k for begin, _, _ in found for k in RANDOM.sample(range(60), 3)]
    heads = RANDOM.sample(heads, min(cases, len(heads)))
    for offset in [*RANDOM.sample(range(len(data)), cases), *heads]:
        changed = bytearray(data)
        changed[offset] ^= RANDOM.randrange(1, 256)
        directory = broken(changed)
        check(directory, tmp_path / 'out', found, lambda begin, end: begin <= offset < end)  # noqa: B023


def test_a_part_that_is_zero_or_gone(broken, whole, tmp_path):
    data, found = whole
    for _ in range(20):
        begin, end = sorted(RANDOM.sample(range(len(data)), 2))
        for filling in (bytes(end - begin), RANDOM.randbytes(end - begin)):
            changed = data[:begin] + filling + data[end:]
            hit = lambda first, last: first < end and begin < last  # noqa: B023, E731
            check(broken(changed), tmp_path / 'out', found, hit)
    begin, end, _ = found[5]
    check(broken(data[: begin + 9] + data[end - 9 :]), tmp_path / 'out', found,
          lambda first, _: first == begin)  # fmt: skip


@pytest.mark.parametrize('value', [2**31 - 1, 2**40, 2**63 - 1, 2**64 - 1])
def test_a_wrong_length_takes_no_memory(value, broken, whole, tmp_path):
    data, found = whole
    begin, end, _ = found[3]
    places = {
        'record': (begin + 1, 8), 'unpacked': (begin + 25, 8), 'name': (begin + 37, 4),
        'packed': (begin + 45, 8), 'frame': (begin + 53 + 5, 8), 'index': (end + 1, 8),
        'index entries': (end + 11, 4), 'header': (9, 8), 'footer': (len(data) - 28, 8),
    }  # fmt: skip
    for offset, size in places.values():
        changed = bytearray(data)
        changed[offset : offset + size] = (value % 256**size).to_bytes(size, 'little')
        tracemalloc.start()
        check(broken(changed), tmp_path / 'out', found,
              lambda first, last: first < offset + size and offset < last)  # noqa: B023  # fmt: skip
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 50e6


def test_the_metadata_of_the_run_are_not_trusted_when_they_were_hit(broken, whole):
    data, _ = whole
    where = data.index(b'"robot.l1": ') + len('"robot.l1": 0.')
    changed = data[:where] + b'9' + data[where + 1 :]
    log = recording.read(broken(changed)).log
    assert log.config['robot.l1'] == VALUES['robot.l1'] and len(log.warnings) == 1


@pytest.mark.parametrize('state', ['missing', 'broken', 'half'])
def test_the_file_of_metadata_is_not_needed(state, broken, whole, tmp_path):
    directory = broken(whole[0])
    path = directory / 'metadata.yaml'
    if state == 'missing':
        path.unlink()
    else:
        path.write_text(path.read_text()[:300] if state == 'half' else '{[\0')
    report = recover(directory, tmp_path / 'out')
    assert not report.damage and report.kept == report.written
    log, again = recording.read(directory).log, recording.read(tmp_path / 'out').log
    assert log.warnings == again.warnings == () and again.config == log.config == VALUES
    assert np.array_equal(log.position, again.position)


def test_a_recovered_bag_is_a_bag(broken, whole, tmp_path, capsys):
    data, found = whole
    directory = broken(data[: found[-1][0] + 100])
    assert main(['recover', str(directory)]) == 0
    out = tmp_path / 'broken_recovered'
    kept = sum(len(inside) for *_, inside in found[:-1])
    assert f'kept    {kept} messages in {len(found) - 1} chunks' in capsys.readouterr().out
    with Reader(out) as reader:
        assert reader.message_count == kept
        by_topic = Counter(connection.topic for connection, *_ in reader.messages())
        assert by_topic == {c.topic: c.msgcount for c in reader.connections}
        assert all(c.ext.offered_qos_profiles for c in reader.connections)
    assert recording.read(out).log.config == VALUES
    with (out / f'{out.name}_0.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert sum(1 for _ in reader.iter_decoded_messages()) == kept
    assert main(['recover', str(directory)]) == 2
    assert 'exists; nothing is overwritten' in capsys.readouterr().err


def test_the_report_says_what_is_lost(broken, whole, tmp_path):
    data, found = whole
    begin, end, inside = found[4]
    changed = bytearray(data)
    changed[end - 20] ^= 1
    report = recover(broken(changed), tmp_path / 'out')
    lost = Counter(topic for topic, *_ in inside)
    assert report.written - report.kept == lost
    assert f'lost    {end - begin} bytes, 1 chunks; damaged: chunk (1)' in report.lines()
    lines = [line.split()[:2] for line in report.lines()[2:]]
    assert lines == [[topic, str(lost[topic])] for topic in sorted(lost)]
    cut = bytes(changed[: found[-1][1]])  # no summary: the rhythm of the stamps says it
    report = recover(broken(cut), tmp_path / 'again')
    assert not report.written and {k: v for k, v in report.missing.items() if v} == {
        topic.removeprefix('/'): count for topic, count in lost.items()
    }


def test_analyze_warns_in_one_line(broken, whole, tmp_path, capsys):
    data, found = whole
    directory = broken(data[: found[-2][1] + 5])
    assert main(['analyze', str(directory)]) == 0
    out, err = capsys.readouterr()
    assert err.count('\n') == 1 and err.startswith(f'warning: {directory} was not closed')
    assert 'end-effector error' in out


FOREIGN = {
    'uncompressed': {'compression': CompressionType.NONE},
    'lz4': {'compression': CompressionType.LZ4},
    'zstd': {},
    'no checksums': {'compression': CompressionType.NONE, 'enable_crcs': False},
    'no chunks': {'use_chunking': False},
}


@pytest.mark.parametrize('kind', FOREIGN)
def test_bags_of_others_that_are_cut_or_hit(kind, tmp_path):
    (tmp_path / 'bag').mkdir()
    path = tmp_path / 'bag' / 'bag_0.mcap'
    zeros = np.random.default_rng(0).normal(size=(100, 3))
    write_mcap(path, streams(zeros, zeros), chunk_size=4000, **FOREIGN[kind])
    data, every = path.read_bytes(), messages(path.parent)
    for _ in range(20):
        changed, offset = bytearray(data), RANDOM.randrange(len(data))
        changed[offset] ^= RANDOM.randrange(1, 256)
        path.write_bytes(RANDOM.choice([changed, data[:offset]]))
        for function, arguments in ((recover, [tmp_path / 'out']), (recording.read, [])):
            _, error = attempt(function, path.parent, *arguments)
            assert '\n' not in (error or '')
        shutil.rmtree(tmp_path / 'out', ignore_errors=True)
    path.write_bytes(data)
    assert not recover(path.parent, tmp_path / 'out').damage
    assert messages(tmp_path / 'out') == every


def test_files_of_a_split_bag_become_one(tmp_path):
    zeros = np.zeros((120, 3))
    whole = streams(zeros, zeros)
    for k in range(12):
        part = {topic: entries[10 * k : 10 * k + 10] for topic, entries in whole.items()}
        write_foreign(tmp_path / f'part_{k}', part)
        (tmp_path / 'bag').mkdir(exist_ok=True)
        shutil.copy(tmp_path / f'part_{k}' / f'part_{k}.mcap', tmp_path / 'bag' / f'bag_{k}.mcap')
    assert recording.read(tmp_path / 'bag').log.messages['joint_states'].count == 120
    (tmp_path / 'bag' / 'bag_3.mcap').write_bytes(b'\x89MCAP0\r\n')
    recover(tmp_path / 'bag', tmp_path / 'out')
    log = recording.read(tmp_path / 'out').log
    assert log.messages['joint_states'] == run_log.TopicCount(110, 10)
    assert len(log.warnings) == 1 and 'of which robot' in log.warnings[0]


def test_topics_that_are_not_ours_are_recovered_too(tmp_path):
    path = tmp_path / 'other.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream, chunk_size=100)
        writer.start('', 'another')
        camera = writer.register_channel('/camera', 'cdr', 0)
        for k in range(50):
            writer.add_message(camera, k, b'\0\1\0\0' + bytes(k), k + 3, sequence=k)
        writer.add_attachment(5, 5, 'photo', 'image/png', b'hello')
        writer.add_metadata('calibration', {'offset': '0.1'})
        writer.finish()
    assert main(['recover', str(path)]) == 0
    out = tmp_path / 'other_recovered' / 'other_recovered_0.mcap'
    with path.open('rb') as old, out.open('rb') as new:
        pair = [[message for *_, message in make_reader(f).iter_messages()] for f in (old, new)]
    assert pair[0] == pair[1] and len(pair[0]) == 50
    with out.open('rb') as stream:
        reader = make_reader(stream)
        (attachment,) = reader.iter_attachments()
        (metadata,) = (note for note in reader.iter_metadata() if note.name != 'rosbag2')
    assert (attachment.name, attachment.media_type) == ('photo', 'image/png')
    assert attachment.data == b'hello' and attachment.create_time == 5
    assert (metadata.name, metadata.metadata) == ('calibration', {'offset': '0.1'})
    with pytest.raises(BagError, match='no messages on joint_states'):
        recording.read(tmp_path / 'other_recovered')


def test_a_bag_without_messages(tmp_path):
    with bag_writer.BagWriter(tmp_path / 'bag', topics.RECORDED, {}):
        pass
    with pytest.raises(BagError, match='no message that is intact'):
        recover(tmp_path / 'bag', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()
