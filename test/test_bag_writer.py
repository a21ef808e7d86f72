"""Bags: written, read back by other implementations, compared."""

import dataclasses
import tracemalloc
from contextlib import ExitStack

import numpy as np
import pytest
import yaml
from bags import STORE, full_disk
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import Reader

from parallel_robot.bags.files.bag_files import open_file
from parallel_robot.bags.files.mcap_reader import Damage, scan
from parallel_robot.bags.files.mcap_records import Block
from parallel_robot.bags.files.mcap_writer import McapWriter, Rows
from parallel_robot.bags.writing import bag_writer
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_control.messages import Status, status_message
from parallel_robot_control.safety.faults import FAULTS, SPEED
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import layouts, topics

JOINTS = ('joint1', 'joint2', 'joint3')
METADATA = {'scenario': 'Kreis: "ä"\n', 'law': 's_fotsmc', 'config': 'a: [1, 2]\nb: 3\n'}
NUMBERS = np.random.default_rng(7)
LAYOUTS = {
    topics.JOINT_STATES.type: layouts.joint_state(JOINTS),
    topics.REFERENCE.type: layouts.joint_trajectory(JOINTS),
    topics.COMMANDS.type: layouts.float64_multi_array(3),
    topics.POSE.type: layouts.pose_stamped('base'),
    topics.ANSWERED.type: layouts.int64_multi_array(20),
}


def message(topic, stamp):
    """A message of a topic with random numbers."""
    if topic == topics.ACTIVE_LAW:
        return layouts.text_message('s_fotsmc')
    if topic == topics.STATUS:
        return status_message(stamp, Status('s_fotsmc', FAULTS[SPEED], 3))
    if topic == topics.STATUS:
        return status_message(stamp, Status('s_fotsmc', FAULTS[SPEED], 3))
    layout = LAYOUTS[topic.type]
    record = layout.records(1, stamp if layout.stamped else None)
    for name in record.dtype.names:
        if name not in ('sec', 'nanosec'):
            record[name] = 1e6 * NUMBERS.normal(size=record[name].shape)
    return record.tobytes()


WRITTEN = [
    (topic.name, 10**9 + k * 10**6, message(topic, 10**9 + k * 10**6))
    for k in range(20)
    for topic in topics.RECORDED
    if k % (topic.every or 20) == 0
]


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp('bags') / 'deep' / 'bag'
    with BagWriter(directory, topics.RECORDED, METADATA) as writer:
        for entry in WRITTEN:
            writer.write(*entry)
    return directory


def plain(value):
    """Fields of a message, whichever library decoded it, as comparable data."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
    else:
        names = getattr(value, '__slots__', None)
    if isinstance(value, (list, tuple, bytes, np.ndarray)):
        return [plain(item) for item in value]
    if names is None:
        return value
    fields = [name for name in names if not name.startswith('_') and not name.isupper()]
    return {name: plain(getattr(value, name)) for name in fields}  # without constants


def test_every_type_is_written_and_read_back(bag):
    with AnyReader([bag]) as reader:
        found = [
            (connection.topic.removeprefix('/'), log_time, bytes(data))
            for connection, log_time, data in reader.messages()
        ]
        assert {connection.msgtype for connection in reader.connections} == {
            topic.type for topic in topics.RECORDED
        }
    assert sorted(found) == sorted(WRITTEN)
    assert [entry[1] for entry in found] == sorted(entry[1] for entry in WRITTEN)


def test_other_libraries_decode_the_same_from_the_schemas_of_the_file(bag):
    types = {topic.name: topic.type for topic in topics.RECORDED}
    count = 0
    with (bag / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, raw, decoded in reader.iter_decoded_messages():
            assert schema.name == types[channel.topic.removeprefix('/')]
            expected = plain(STORE.deserialize_cdr(raw.data, schema.name))
            assert plain(decoded) == expected
            assert raw.publish_time == raw.log_time
            count += 1
    assert count == len(WRITTEN)


def test_metadata_file(bag):
    with Reader(bag) as reader:
        assert reader.message_count == len(WRITTEN)
        assert (reader.start_time, reader.duration) == (10**9, 19 * 10**6 + 1)
        found = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
    names = [entry[0] for entry in WRITTEN]
    assert found == {f'/{t.name}': (t.type, names.count(t.name)) for t in topics.RECORDED}
    text = (bag / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert '&' not in text and information['custom_data'] == METADATA
    assert information['files'][0]['message_count'] == len(WRITTEN)
    assert information['duration']['nanoseconds'] == 19 * 10**6
    assert information['relative_file_paths'] == ['bag_0.mcap']


def test_the_file_is_what_the_recorder_of_ros_writes(bag):
    with (bag / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == 'ros2'
        facts, *described = ((record.name, record.metadata) for record in reader.iter_metadata())
        assert facts == ('parallel_robot', METADATA)
        assert [(name, d['ROS_DISTRO']) for name, d in described] == [('rosbag2', 'jazzy')] * 2
        opened, closed = (yaml.safe_load(d['serialized_metadata']) for _, d in described)
        assert (opened['ros_distro'], opened['message_count']) == ('jazzy', 0)
        text = (bag / 'metadata.yaml').read_text()
        assert closed == yaml.safe_load(text)['rosbag2_bagfile_information']
        summary = reader.get_summary()
        assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}
        by_name = {f'/{topic.name}': topic for topic in topics.RECORDED}
        assert {channel.topic for channel in summary.channels.values()} == set(by_name)
        for channel in summary.channels.values():
            topic = by_name[channel.topic]
            assert channel.message_encoding == 'cdr'
            [qos] = yaml.safe_load(channel.metadata['offered_qos_profiles'])
            assert qos['durability'] == ('transient_local' if topic.latched else 'volatile')
            assert (qos['reliability'], qos['history']) == ('reliable', 'keep_last')
            digest = channel.metadata['topic_type_hash']
            assert digest == STORE.hash_rihs01(topic.type) and digest.startswith('RIHS01_')
        assert summary.statistics.message_count == len(WRITTEN)


@pytest.mark.parametrize('kind', ['file', 'directory'])
def test_what_exists_is_refused_and_untouched(kind, tmp_path):
    path = tmp_path / 'bag'
    (path.mkdir if kind == 'directory' else path.touch)()
    before = path.stat()
    with pytest.raises(BagError, match='exists; nothing is overwritten'):
        BagWriter(path, topics.RECORDED, {})
    assert path.stat() == before and list(tmp_path.rglob('*')) == [path]


@pytest.mark.parametrize('name', ['file/bag', 'x' * 300])
def test_what_cannot_be_made_is_refused_without_a_trace(name, tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(BagError, match='cannot write'):
        BagWriter(tmp_path / name, topics.RECORDED, {})
    assert list(tmp_path.iterdir()) == [tmp_path / 'file']


def test_an_empty_bag_is_a_bag(tmp_path):
    with BagWriter(tmp_path / 'bag', topics.RECORDED, {}):
        pass
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 0


def test_what_was_written_before_an_error_stays_readable(tmp_path):
    def fail(writer):
        writer.write(*WRITTEN[0])
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), BagWriter(tmp_path / 'bag', topics.RECORDED, {}) as w:
        fail(w)
    with Reader(tmp_path / 'bag') as reader:
        assert [bytes(data) for *_, data in reader.messages()] == [WRITTEN[0][2]]


def survives(path):
    """Messages in the chunks of a file that nobody has closed, and its damage."""
    records = list(scan(*open_file(path)))
    count = sum(len(record.starts) for record in records if isinstance(record, Block))
    return count, [record for record in records if isinstance(record, Damage)]


def test_finished_chunks_are_with_the_system_at_once(tmp_path):
    layout, size, lost = layouts.float64_multi_array(100), 812 + 31, 0
    with BagWriter(tmp_path / 'bag', topics.RECORDED, {}) as writer:
        for k in range(2000):
            writer.write(topics.COMMANDS.name, k, layout.encode(data=NUMBERS.normal(size=100)))
            if k % 50 == 0:
                count, damage = survives(tmp_path / 'bag' / 'bag_0.mcap')
                assert damage == [Damage('end', 0)]
                lost = max(lost, k + 1 - count)
    assert 200 < lost <= 256 * 1024 / size
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    assert len(indexes) > 6 and max(i.uncompressed_size for i in indexes) <= 256 * 1024
    assert {index.compression for index in indexes} == {'zstd'}


def test_a_chunk_that_is_not_full_can_be_finished(tmp_path):
    path = tmp_path / 'bag' / 'bag_0.mcap'
    with BagWriter(tmp_path / 'bag', topics.RECORDED, METADATA) as writer:
        writer.write(*WRITTEN[0])
        writer.flush(age=1000.0)
        assert survives(path)[0] == 0
        writer.flush()
        assert survives(path) == (1, [Damage('end', 0)])


def test_many_messages_at_once_are_the_same_bytes(tmp_path, monkeypatch):
    """Beside messages that are written by themselves, in the same chunks."""
    monkeypatch.setattr(bag_writer, 'CHUNK_SIZE', 3000)
    count, layout = 300, layouts.float64_multi_array(4)
    fixed = layout.records(count, data=NUMBERS.normal(size=(count, 4)))
    fixed = np.frombuffer(fixed.tobytes(), np.uint8).reshape(count, -1)
    places = np.sort(NUMBERS.permutation(2 * count)[:count])
    others = np.setdiff1d(np.arange(2 * count), places)
    varied = [bytes(range(k % 200)) for k in range(count)]
    streams = [
        Rows(topics.COMMANDS.name, places, 10 * places, fixed),
        Rows(topics.STATUS.name, others, 10 * others + 7, varied),
    ]
    merged = sorted(
        (place, rows.topic, int(time), bytes(payload))
        for rows in streams
        for place, time, payload in zip(rows.places, rows.log_times, rows.payloads, strict=True)
    )
    for name in ('one', 'many'):
        with BagWriter(tmp_path / name / 'bag', topics.RECORDED, METADATA) as writer:
            writer.write(topics.COMMANDS.name, 5, fixed[0].tobytes())
            if name == 'many':
                writer.extend(streams)
            else:
                for _, topic, log_time, payload in merged:
                    writer.write(topic, log_time, payload)
            writer.write(topics.COMMANDS.name, 9000, fixed[1].tobytes())
            assert writer.written == {topics.COMMANDS.name: count + 2, topics.STATUS.name: count}
    for file in ('bag_0.mcap', 'metadata.yaml'):
        one, many = ((tmp_path / name / 'bag' / file).read_bytes() for name in ('one', 'many'))
        assert one == many


def test_a_recording_of_hours_needs_little_memory(tmp_path):
    with BagWriter(tmp_path / 'bag', topics.RECORDED, METADATA) as writer:

        def record(chunks):
            for stamp in range(chunks):
                for topic in topics.RECORDED:
                    writer.write(topic.name, stamp, b'\0' * 8)
                writer.flush()

        record(50)
        tracemalloc.start()
        try:
            record(200)
            grown, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    assert grown < 250 * 250  # bytes; their indices unpacked have more than 1000 each
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    assert len(indexes) == 250 and len(indexes[-1].message_index_offsets) == len(topics.RECORDED)


@pytest.mark.parametrize('where', ['first', 'middle', 'end', 'metadata'])
def test_a_full_disk_leaves_what_is_finished(where, tmp_path, monkeypatch):
    """The file is cut after its last whole record; metadata.yaml is whole or not there."""
    layout, path = layouts.float64_multi_array(100), tmp_path / 'bag' / 'bag_0.mcap'
    many = [topics.Topic(f'{name}{k}', topics.COMMANDS.type) for name in 'ab' for k in range(100)]
    messages = [layout.encode(data=NUMBERS.normal(size=100)) for _ in range(1000)]
    messages = [] if where == 'metadata' else messages

    def write(directory):
        with BagWriter(directory, many, METADATA) as writer:
            for k, message in enumerate(messages):
                writer.write('a0', k, message)

    write(tmp_path / 'whole')
    size = (tmp_path / 'whole' / 'whole_0.mcap').stat().st_size
    limit = {'first': 100, 'middle': size // 2, 'end': size - 10, 'metadata': size}[where]
    disk, close = ExitStack(), McapWriter.close
    if where == 'metadata':  # the disk is full once the file is complete

        def close_and_fill(file):
            close(file)
            disk.enter_context(full_disk(100))

        monkeypatch.setattr(McapWriter, 'close', close_and_fill)
    with full_disk(limit), disk, pytest.raises(OSError, match='File too large'):
        write(tmp_path / 'bag')
    assert [file.name for file in path.parent.iterdir()] == ['bag_0.mcap']
    count, damage = survives(path)
    low, high = {'first': (0, 0), 'middle': (300, 700)}.get(where, (len(messages),) * 2)
    assert low <= count <= high
    assert [place.what for place in damage] == ([] if where == 'metadata' else ['end'])
    assert sum(place.length for place in damage) == 0 or where == 'end'


def random_value(kind, what):
    """A random value of a field as rosbags describes it; sequences have two elements."""
    if kind == Nodetype.NAME:
        fields = STORE.get_msgdef(what).fields
        return STORE.types[what](**{name: random_value(*field) for name, field in fields})
    if kind == Nodetype.BASE:
        name = what[0]
        if name == 'string':
            return f'Größe {NUMBERS.integers(1000)}'
        return np.dtype(name).type(NUMBERS.integers(100) % (2 if name == 'bool' else 100)).item()
    (inner, name), count = what
    values = [random_value(inner, name) for _ in range(count or 2)]
    numeric = inner == Nodetype.BASE and name[0] != 'string'
    return np.array(values, dtype=name[0]) if numeric else values


def test_every_message_type_of_the_suite_comes_back(tmp_path):
    """All types, also those that the recorder does not take, by both other libraries."""
    suite = [value for value in vars(topics).values() if isinstance(value, topics.Topic)]
    suite.append(topics.Topic('diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'))
    written = {}
    with BagWriter(tmp_path / 'bag', suite, METADATA) as writer:
        for k, topic in enumerate(suite):
            message = random_value(Nodetype.NAME, topic.type)
            written[f'/{topic.name}'] = plain(message)
            writer.write(topic.name, k, bytes(STORE.serialize_cdr(message, topic.type)))
    assert {topic.type for topic in suite} >= {
        'visualization_msgs/msg/MarkerArray', 'rosgraph_msgs/msg/Clock', 'std_msgs/msg/String'
    }  # fmt: skip
    with AnyReader([tmp_path / 'bag']) as reader:
        found = {c.topic: plain(reader.deserialize(d, c.msgtype)) for c, _, d in reader.messages()}
    assert found == written
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        decoded = {c.topic: plain(m) for _, c, _, m in reader.iter_decoded_messages()}
    assert decoded == written
