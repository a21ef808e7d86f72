"""The piecewise reader beside that of mcap."""

import tracemalloc

import numpy as np
import pytest
from bags import content, write_foreign
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, IndexType, Writer

from parallel_robot.bags.files import mcap_reader
from parallel_robot.bags.files.mcap_reader import Chunk, Chunks, ChunkTable
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import layouts, topics

LATCHED = topics.ACTIVE_LAW


def write(path, log_times, compression=CompressionType.ZSTD, index=IndexType.ALL, chunked=True):
    """Write one message for each log time, in turn on two topics, in small chunks."""
    with path.open('wb') as stream:
        writer = Writer(stream, 500, compression, index, use_chunking=chunked)
        writer.start()
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channels = [writer.register_channel(name, 'cdr', schema) for name in ('/a', '/b')]
        for k, log_time in enumerate(log_times):
            writer.add_message(channels[k % 2], log_time, layouts.text_message(f'{k}' * 9), 0)
        writer.finish()


def by_mcap(path, names, start, end):
    with path.open('rb') as stream:
        found = make_reader(stream).iter_messages(names, starting_at=start, ending_at=end)
        return [(m.log_time, channel.topic, m.data) for _, channel, m in found]


@pytest.mark.parametrize('compression', CompressionType)
@pytest.mark.parametrize('disorder', [0, 3, 1000])
@pytest.mark.parametrize(
    ('names', 'start', 'end'), [(['/a', '/b'], 0, 10**6), (['/b'], 50, 120), (['/a'], 199, 199)]
)
def test_order_and_bytes_are_those_of_mcap(compression, disorder, names, start, end, tmp_path):
    path = tmp_path / 'bag.mcap'
    times = np.arange(200) + np.random.default_rng(1).integers(0, disorder + 1, 200)
    write(path, (times // 2).tolist(), compression)  # halved: equal times too
    reader = BagReader(path)
    assert list(reader.messages(names, start, end)) == by_mcap(path, names, start, end)
    assert (reader.start, reader.end) == (min(times // 2), max(times // 2))
    assert reader.counts == {'/a': 100, '/b': 100}
    reader.close()


def test_chunks_without_message_index_are_read(tmp_path):
    path = tmp_path / 'bag.mcap'
    write(path, range(100), index=IndexType.ALL & ~IndexType.MESSAGE)
    found = list(BagReader(path).messages(['/b'], 10))
    assert [message.log_time for message in found] == list(range(11, 100, 2))


def test_files_of_one_bag_are_one(tmp_path):
    write(tmp_path / 'bag_1.mcap', range(100, 200))
    write(tmp_path / 'bag_0.mcap', range(100))
    found = [message.log_time for message in BagReader(tmp_path).messages(['/a', '/b'], 50)]
    assert found == list(range(50, 200))


def test_memory_holds_a_few_chunks(tmp_path, monkeypatch):
    write(tmp_path / 'bag.mcap', range(10_000))
    loaded = []
    load = mcap_reader.chunk_content
    monkeypatch.setattr(
        mcap_reader, 'chunk_content', lambda *args: loaded.append(args) or load(*args)
    )
    reader = BagReader(tmp_path / 'bag.mcap')
    messages = reader.messages(['/a', '/b'], 0)
    for _ in range(3):
        next(messages)
    assert 0 < len(loaded) < 5 < len(reader._chunks) / 10
    reader.close()


def test_what_was_latched_is_known_later(tmp_path):
    with BagWriter(tmp_path / 'bag', [LATCHED, topics.POSE], {}) as writer:
        for moment, law in ((10, 'smc'), (20, 'pid'), (30, 's_smc')):
            writer.write(LATCHED.name, moment, layouts.text_message(law))
            writer.write(topics.POSE.name, moment, layouts.pose_stamped('base').encode(moment))
    reader = BagReader(tmp_path / 'bag')
    assert reader.topics['/controller/active_law'].latched == 1
    assert reader.topics['/pose'].latched == 0
    for moment, laws in ((10, []), (20, ['smc']), (25, ['pid']), (99, ['s_smc'])):
        found = reader.latched(list(reader.topics), moment)
        assert [message.data for message in found] == [layouts.text_message(law) for law in laws]


@pytest.mark.parametrize(
    ('durability', 'latched'), [('1', 3), ('transient_local', 3), ('2', 0), ('volatile', 0)]
)
def test_old_and_new_profiles_are_understood(durability, latched, tmp_path):
    profile = f'- {{history: 1, depth: 3, durability: {durability}}}'
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        writer.register_channel('/a', 'cdr', schema, {'offered_qos_profiles': profile})
        writer.finish()
    assert BagReader(path).topics['/a'].latched == latched


def test_bags_of_others_are_read(tmp_path):
    data = layouts.pose_stamped('base').encode(1)
    write_foreign(tmp_path / 'bag', {topics.POSE: [(1, data), (2, data)]})
    (path,) = (tmp_path / 'bag').glob('*.mcap')
    found = list(BagReader(tmp_path / 'bag').messages(['/pose'], 0))
    assert [(m.log_time, m.data) for m in found] == content(path)['pose']


def test_what_is_no_bag_is_refused(tmp_path):
    with pytest.raises(BagError, match='no MCAP file there'):
        BagReader(tmp_path)
    path = tmp_path / 'bag.mcap'
    path.write_bytes(b'not a bag at all')
    with pytest.raises(BagError, match='no MCAP file, or was cut off'):
        BagReader(path)
    write(path, range(100))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BagError, match='cut off'):
        BagReader(path)
    write(path, range(100), chunked=False)
    with pytest.raises(BagError, match='without chunks'):
        BagReader(path)


def test_a_broken_chunk_is_an_error_of_the_bag(tmp_path):
    path = tmp_path / 'bag.mcap'
    write(path, range(100))
    broken = bytearray(path.read_bytes())
    reader = BagReader(path)
    offset = reader._chunks[1].offset
    broken[offset + 60 : offset + 100] = bytes(40)
    path.write_bytes(broken)
    with pytest.raises(BagError, match='cannot be read'):
        list(BagReader(path).messages(['/a', '/b'], 0))


def test_the_index_of_a_bag_of_hours_takes_little_memory(tmp_path):
    found = []
    for count in (500, 2500):
        path = tmp_path / f'{count}.mcap'
        write(path, range(50 * count))
        tracemalloc.start()
        try:
            reader = BagReader(path)
            found.append((len(reader._chunks), *tracemalloc.get_traced_memory()))
        finally:
            tracemalloc.stop()
    (few, *small), (many, *large) = found
    assert many > few + 500
    held, peak = (np.array(large) - small) / (many - few)
    assert held < 60 and peak < 250  # bytes a chunk; as objects of mcap they have 1200


def test_where_chunks_lie_is_what_mcap_reads(tmp_path):
    write(tmp_path / 'bag.mcap', range(3000))
    with (tmp_path / 'bag.mcap').open('rb') as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    chunks = BagReader(tmp_path / 'bag.mcap')._chunks
    assert len(chunks) == len(indexes) > 10
    for chunk, index in zip(chunks, indexes, strict=True):
        times = index.message_start_time, index.message_end_time
        assert chunk[:4] == (*times, index.chunk_start_offset, index.chunk_length)
        assert chunk.channels == tuple(index.message_index_offsets)
    assert [*reversed(chunks)] == [*chunks][::-1]


def test_a_broken_index_of_a_chunk_is_left_out(tmp_path):
    index = ChunkIndex(100, 8, 'zstd', 60, 20, 30, {1: 5, 7: 6}, 10, 90)
    builder = RecordBuilder()
    index.write(builder)
    record = builder.end()
    table = ChunkTable()
    for end in range(len(record)):
        table.add_index(memoryview(record[:end]))
    twice = bytearray(record)
    twice[55:57] = twice[45:47]  # both channels are one
    table.add_index(memoryview(twice))
    assert not len(table)
    for each in (record, record + b'of a later version'):
        table.add_index(memoryview(each))
    assert [*Chunks([table])] == [Chunk(10, 20, 8, 100, (1, 7))]
