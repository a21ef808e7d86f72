"""Bags for the tests: a small run of the suite, and how others write and read."""

import numpy as np
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from parallel_robot_interface import cdr, topics

STORE = get_typestore(Stores.ROS2_JAZZY)
START = 5 * 10**9  # ns
MS = 10**6  # ns
JOINTS = ('joint1', 'joint2', 'joint3')


def content(path):
    """(log time, payload) of every message of an MCAP file, by topic without leading slash."""
    found = {}
    with path.open('rb') as file:
        for _, channel, message in make_reader(file).iter_messages():
            stream = found.setdefault(channel.topic.removeprefix('/'), [])
            stream.append((message.log_time, message.data))
    return found


def write_foreign(directory, streams):
    """Write serialised messages, {topic: [(log time, bytes)]}, as rosbags does."""
    with Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, messages in streams.items():
            connection = writer.add_connection(f'/{topic.name}', topic.type, typestore=STORE)
            for log_time, data in messages:
                writer.write(connection, log_time, data)


def streams(reference, position, effort=None, names=JOINTS, start=START):
    """Messages of a run, one a millisecond; arrays of shape (N, 3), angles at rest."""
    count = len(reference)
    stamps = start + np.arange(count) * MS
    effort = np.zeros((count, 3)) if effort is None else effort
    order = [JOINTS.index(name) for name in names]
    records = {
        topics.JOINT_STATES: cdr.joint_state(names).records(
            count, stamps, position=position[:, order], effort=effort[:, order]
        ),
        topics.REFERENCE: cdr.joint_trajectory(names).records(
            count, stamps, position=reference[:, order]
        ),
        topics.COMMANDS: cdr.float64_multi_array(3).records(count, data=effort),
    }
    return {
        topic: [(int(stamp), row.tobytes()) for stamp, row in zip(stamps, rows, strict=True)]
        for topic, rows in records.items()
    }
