"""Bags for the tests: a small run of the suite, and how others write and read."""

import contextlib
import resource

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from parallel_robot.analysis import recorded_motions, table
from parallel_robot.analysis.metrics import TABLE, MotionPart
from parallel_robot.bags.run import recorded_robot
from parallel_robot_model.messages import layouts, topics
from parallel_robot_sim.motions import Motion, Poses

STORE = get_typestore(Stores.ROS2_JAZZY)
START = 5 * 10**9  # ns
MS = 10**6  # ns
JOINTS = ('joint1', 'joint2', 'joint3')


@contextlib.contextmanager
def full_disk(size):
    """No file of this process can grow beyond a size [bytes]."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def content(path):
    """(log time, payload) of every message of an MCAP file, by topic without leading slash."""
    found = {}
    with path.open('rb') as file:
        for _, channel, message in make_reader(file).iter_messages():
            stream = found.setdefault(channel.topic.removeprefix('/'), [])
            stream.append((message.log_time, message.data))
    return found


def write_foreign(directory, streams, compression=None, space=''):
    """Write serialised messages, {topic: [(log time, bytes)]}, as rosbags does."""
    writer = Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP)
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        for topic, messages in streams.items():
            name = f'{space}/{topic.name}'
            connection = writer.add_connection(name, topic.type, typestore=STORE)
            for log_time, data in messages:
                writer.write(connection, log_time, data)


def write_mcap(path, streams, **options):
    """Write serialised messages as mcap's writer does, in the order of their log time."""
    with path.open('wb') as stream:
        writer = McapWriter(stream, **options)
        writer.start('ros2')
        channels = {}
        for topic in reversed(streams):
            definition, _ = STORE.generate_msgdef(topic.type, ros_version=2)
            schema = writer.register_schema(topic.type, 'ros2msg', definition.encode())
            channels[topic] = writer.register_channel(f'/{topic.name}', 'cdr', schema)
        entries = [(*entry, channels[topic]) for topic in streams for entry in streams[topic]]
        for log_time, data, channel in sorted(entries, key=lambda entry: entry[0]):
            writer.add_message(channel, log_time, data, log_time)
        writer.finish()


WRITERS = {
    'chunks of 1 MiB': write_foreign,
    'zstd in chunks': lambda path, found: write_foreign(path, found, 'STORAGE'),
    'zstd by message': lambda path, found: write_foreign(path, found, 'MESSAGE'),
    'zstd by file': lambda path, found: write_foreign(path, found, 'FILE'),
    'a namespace': lambda path, found: write_foreign(path, found, space='/left/robot'),
    'small chunks': lambda path, found: write_mcap(path, found, chunk_size=2000),
    'lz4': lambda path, found: write_mcap(path, found, compression=CompressionType.LZ4),
    'uncompressed': lambda path, found: write_mcap(path, found, compression=CompressionType.NONE),
    'no chunks': lambda path, found: write_mcap(path, found, use_chunking=False),
    'no indexes, no summary': lambda path, found: write_mcap(
        path, found, index_types=IndexType.NONE, repeat_channels=False, repeat_schemas=False,
        use_statistics=False, use_summary_offsets=False, enable_crcs=False),
}  # fmt: skip


def table_of(bag, code=recorded_robot.NONE):
    """A bag as a table."""
    return table.of(recorded_robot.read(bag, code=code, topics=table.NEEDED))


def chunks(path):
    """Chunks of a whole MCAP file as mcap reads them: [(begin, end, [(topic, time, bytes)])]."""
    found = []
    with path.open('rb') as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        topics = {key: channel.topic for key, channel in summary.channels.items()}
        for index in summary.chunk_indexes:
            end = index.chunk_start_offset + index.chunk_length
            file.seek(index.chunk_start_offset + 9)
            inside = breakup_chunk(Chunk.read(ReadDataStream(file)), validate_crc=True)
            messages = [
                (topics[record.channel_id], record.log_time, record.data)
                for record in inside
                if isinstance(record, Message)
            ]
            found.append((index.chunk_start_offset, end, messages))
    return found


def motion_of(log, poses=None):
    """The motion of a run, with its poses by the nominal robot, or others."""
    arrays = log.time, log.position, log.reference_position, log.effort
    return Motion(*arrays, recorded_motions.poses_of_log(log) if poses is None else poses)


def metric_of_torques(key, time, effort, ideal=None, first=0):
    """A metric of torques from a sample on [N m], shape (N, n), by its key."""
    nothing = np.zeros_like(effort)
    motion = Motion(time, nothing, nothing, effort, Poses(nothing, nothing, 0))
    (metric,) = (one for one in TABLE if one.key == key)
    return metric.value(MotionPart(motion, ideal, first))


def streams(reference, position, effort=None, names=JOINTS, start=START):
    """Messages of a run, one a millisecond; arrays of shape (N, 3), angles at rest."""
    count = len(reference)
    stamps = start + np.arange(count) * MS
    effort = np.zeros((count, 3)) if effort is None else effort
    order = [JOINTS.index(name) for name in names]
    records = {
        topics.JOINT_STATES: layouts.joint_state(names).records(
            count, stamps, position=position[:, order], effort=effort[:, order]
        ),
        topics.REFERENCE: layouts.joint_trajectory(names).records(
            count, stamps, position=reference[:, order]
        ),
        topics.COMMANDS: layouts.float64_multi_array(3).records(count, data=effort),
    }
    return {
        topic: [(int(stamp), row.tobytes()) for stamp, row in zip(stamps, rows, strict=True)]
        for topic, rows in records.items()
    }
