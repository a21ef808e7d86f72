"""Bags that are not MCAP: sqlite3 of rosbag2 is read, others are called what they are."""

import gzip
import shutil
import sqlite3

import numpy as np
import pytest
from bags import STORE, streams, write_foreign, write_mcap
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing.recovery import recover
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import BagError

REST = np.tile([1.454, 2.418, 1.983], (300, 1)) + 1e-3 * np.arange(300)[:, None]
FOUND = streams(REST + 1e-4, REST)


def write_sqlite(directory, compression=None, found=FOUND):
    writer = Writer(directory, version=9, storage_plugin=StoragePlugin.SQLITE3)
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        for topic, messages in found.items():
            connection = writer.add_connection(f'/{topic.name}', topic.type, typestore=STORE)
            for log_time, data in messages:
                writer.write(connection, log_time, data)
    return next(path for path in directory.iterdir() if '.db3' in path.name)


@pytest.fixture(scope='module')
def home(tmp_path_factory):
    bag = tmp_path_factory.mktemp('home') / 'bag'
    write_foreign(bag, FOUND)
    return recording.read(bag).log


def same(log, home):
    assert (log.stamps == home.stamps).all() and (log.position == home.position).all()
    assert (log.command == home.command).all() and log.messages == home.messages


@pytest.mark.parametrize('compression', [None, 'MESSAGE', 'FILE'])
def test_sqlite_bags_are_read(tmp_path, home, compression):
    write_sqlite(tmp_path / 'bag', compression)
    before = sorted(path.name for path in (tmp_path / 'bag').iterdir())
    same(recording.read(tmp_path / 'bag').log, home)
    assert sorted(path.name for path in (tmp_path / 'bag').iterdir()) == before


def test_a_sqlite_file_alone_is_read_and_made_an_mcap_bag(tmp_path, home):
    path = write_sqlite(tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    same(recording.read(path).log, home)
    recover(tmp_path / 'bag', tmp_path / 'out')
    same(recording.read(tmp_path / 'out').log, home)
    with pytest.raises(BagError, match=r'sqlite3 bag.*parallel_robot recover'):
        BagReader(path)


def test_what_a_killed_recorder_left_in_its_journal_is_read(tmp_path, home):
    path = write_sqlite(tmp_path / 'bag')
    with sqlite3.connect(path) as bag:
        bag.execute('PRAGMA journal_mode=WAL')
        bag.execute('PRAGMA wal_autocheckpoint=0')
        rows = bag.execute('SELECT topic_id, timestamp, data FROM messages').fetchall()
        bag.execute('DELETE FROM messages')
        bag.commit()
        bag.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        bag.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', rows)
        bag.commit()
        left = tmp_path / 'left'
        left.mkdir()
        for file in path.parent.glob('*.db3*'):
            shutil.copyfile(file, left / file.name)
    bag.close()
    assert any(file.name.endswith('-wal') for file in left.iterdir())
    same(recording.read(left).log, home)


def test_broken_sqlite_files_cost_one_line(tmp_path, capsys):
    path = write_sqlite(tmp_path / 'bag')
    data = path.read_bytes()
    for k, broken in enumerate((data[:100], data[: len(data) // 2], data[:4096])):
        copy = tmp_path / f'{k}.db3'
        copy.write_bytes(broken)
        assert main(['export', str(copy), '--out', str(tmp_path / f'{k}.csv')]) in (0, 2)
        err = capsys.readouterr().err
        assert str(copy) in err and 'Traceback' not in err
    view = tmp_path / 'view.db3'
    with sqlite3.connect(view) as bag:  # rows without end
        bag.execute('CREATE TABLE topics(id, name, type)')
        bag.execute(
            'CREATE VIEW messages AS WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k FROM n) '
            "SELECT 1 AS topic_id, 1 AS timestamp, x'00' AS data FROM n"
        )
    bag.close()
    with pytest.raises(BagError, match='no topics and messages'):
        recording.read(view)


def test_a_pointer_of_git_lfs_is_called_one(tmp_path):
    path = tmp_path / 'bag' / 'run.mcap'
    path.parent.mkdir()
    path.write_text('version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n')
    for each in (path, path.parent):
        with pytest.raises(BagError, match=r'run\.mcap is a pointer of Git LFS.*git lfs pull'):
            recording.read(each)
    with pytest.raises(BagError, match='pointer of Git LFS'):
        BagReader(path)


def test_a_ros_1_bag_is_called_one_with_what_converts_it(tmp_path, capsys):
    path = tmp_path / 'run.bag'
    store = get_typestore(Stores.ROS1_NOETIC)
    with Ros1Writer(path) as writer:
        String = store.types['std_msgs/msg/String']
        connection = writer.add_connection('/text', String.__msgtype__, typestore=store)
        message = store.serialize_ros1(String('x'), String.__msgtype__)
        writer.write(connection, 1, message)
    assert main(['analyze', str(path)]) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and f'rosbags-convert --src {path}' in err
    content = path.read_bytes()
    place = content.index(b'index_pos=') + len(b'index_pos=')
    path.write_bytes(content[:place] + bytes(8) + content[place + 8 :])
    with pytest.raises(BagError, match='without its index: rosbag reindex'):
        recording.read(path)


@pytest.mark.parametrize(
    ('kind', 'encoding', 'told'),
    [
        ('sensor_msgs/msg/JointState', 'json', 'as json'),
        ('sensor_msgs/msg/JointState', 'ros1', 'as ros1'),
        ('sensor_msgs/JointState', 'ros1', r'\(sensor_msgs/JointState as ros1\)'),
        ('foxglove.JointStates', 'protobuf', r'\(foxglove.JointStates as protobuf\)'),
    ],
)
def test_other_encodings_and_types_are_named(tmp_path, kind, encoding, told):
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream, compression=CompressionType.NONE)
        writer.start('')
        schema = writer.register_schema(kind, 'none', b'')
        channel = writer.register_channel('/joint_states', encoding, schema)
        writer.add_message(channel, 1, b'{}', 1)
        writer.finish()
    with pytest.raises(BagError, match=f'no messages on joint_states .* it has .*{told}') as error:
        recording.read(path)
    assert 'cdr' in str(error.value)


def test_what_the_player_cannot_play_names_recover(tmp_path):
    path = tmp_path / 'bag.mcap'
    write_mcap(path, FOUND, use_chunking=False)
    with pytest.raises(BagError, match='without chunks; parallel_robot recover'):
        BagReader(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(BagError, match='cut off; parallel_robot recover'):
        BagReader(path)


@pytest.mark.parametrize(
    ('name', 'content', 'told'),
    [
        ('run.mcap', b'', 'is empty'),
        ('run.mcap', gzip.compress(b'x', mtime=0), 'is packed by gzip: unpack it first'),
        ('run.db3', b'PK\3\4', 'is packed by zip: unpack it first'),
        ('metadata.yaml', b'x: 1', 'says what a bag holds: give its directory'),
    ],
)
def test_what_is_no_bag_is_called_what_it_is(tmp_path, name, content, told):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BagError, match=told):
        recording.read(tmp_path / name)


def test_a_directory_of_bags_names_them(tmp_path):
    write_sqlite(tmp_path / 'one')
    with pytest.raises(BagError, match='is not a bag, but holds bags: one; give one of them'):
        recording.read(tmp_path)
