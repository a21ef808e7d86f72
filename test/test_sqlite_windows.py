"""Bags of sqlite3 in windows: what they hold as a whole, in the memory of a window."""

import sqlite3

import numpy as np
import pytest
from test_bag_kinds import write_sqlite
from test_long_bags import assert_alike
from test_windows import WIDTH, assert_all, assert_together, bag, messages  # noqa: F401  fixtures

from parallel_robot.analysis import evaluated_bag
from parallel_robot.bags.bag_reader import BagView
from parallel_robot.bags.files import bag_files, bag_kinds
from parallel_robot.bags.files.mcap_reader import Damage
from parallel_robot.bags.files.mcap_records import Block
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.run import recording
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import JOINT_STATES

ROWS = 300


@pytest.fixture(autouse=True)
def _few_rows(monkeypatch):
    monkeypatch.setattr(bag_kinds, 'ROWS', ROWS)
    monkeypatch.setattr(bag_kinds, 'BATCH', 10_000)


@pytest.fixture
def recorded(messages, tmp_path):  # noqa: F811
    """The rows of a run as they came, by a recorder that begins a new file; and the first file."""
    path = write_sqlite(tmp_path / 'bag', found=messages)
    with sqlite3.connect(path) as opened:
        opened.execute('CREATE TABLE others AS SELECT * FROM messages ORDER BY timestamp, id')
        opened.execute('DELETE FROM messages')
        opened.execute('INSERT INTO messages SELECT rowid, topic_id, timestamp, data FROM others')
        opened.execute('DROP TABLE others')
    opened.close()
    return path


def changed(path, statement):
    with sqlite3.connect(path) as opened:
        opened.execute(statement)
    opened.close()


@pytest.mark.parametrize('compression', [None, 'MESSAGE', 'FILE'])
def test_topic_after_topic(compression, messages, tmp_path):  # noqa: F811
    write_sqlite(tmp_path / 'bag', compression, messages)
    _, parts = assert_all(tmp_path / 'bag')
    assert len(parts) == 10


def test_in_the_order_of_time(recorded):
    whole, parts = assert_all(recorded)
    assert len(parts) == 10 and len(whole.log.time) == 4001
    window = 1.1, 1.2
    inside = (whole.log.time >= window[0]) & (whole.log.time < window[1])
    assert_together([recording.read(recorded, window=window)], whole, inside)


def test_rows_may_be_missing(recorded):
    changed(recorded, 'DELETE FROM messages WHERE id % 1000 BETWEEN 100 AND 400')
    whole, parts = assert_all(recorded)
    assert len(parts) > 5 and 2000 < len(whole.log.time) < 3500


def test_what_stands_in_the_journal(recorded):
    with sqlite3.connect(recorded) as opened:
        opened.execute('PRAGMA journal_mode=WAL')
        opened.execute('PRAGMA wal_autocheckpoint=0')
        opened.execute('DELETE FROM messages WHERE timestamp > 3000000000')
        opened.commit()
        whole, _ = assert_all(recorded)
        assert len(whole.log.time) == 2001
    opened.close()


@pytest.mark.parametrize(
    'change',
    ["data = 'text'", 'timestamp = 1.5', 'timestamp = -1', "topic_id = 'x'", 'id = -id'],
)
def test_a_row_that_is_none_costs_a_reading_as_a_whole(change, recorded):
    """As before it is left out, or not."""
    changed(recorded, f'UPDATE messages SET {change} WHERE id = 5000')
    whole, _ = assert_all(recorded, whole_file=False)
    assert len(whole.log.time) >= 4000
    assert recording.size(recorded) == (0.0, 0)


@pytest.mark.parametrize(
    'statement',
    [
        "ALTER TABLE messages ADD COLUMN rowid TEXT DEFAULT 'x'",
        'ALTER TABLE messages ADD COLUMN rowid REAL DEFAULT 1.5',
        'DELETE FROM topics WHERE id > 1',
        'ALTER TABLE topics RENAME COLUMN id TO number',
        'DELETE FROM messages',
    ],
)
def test_a_strange_table_is_read_as_without_an_index(statement, recorded):
    changed(recorded, statement)
    told = []
    for read in (recording.read, lambda path: next(recording.chunks(path, WIDTH))):
        try:
            told.append(read(recorded).log.warnings)
        except BagError as error:
            told.append(str(error))
    assert told[0] == told[1]


def test_memory_is_that_of_a_window(recorded):
    size = recorded.stat().st_size
    with pytest.raises(BagError, match='takes more than'):
        recording.read(recorded, memory=size)
    windows = recording.chunks(recorded, 0.2, memory=size)
    assert sum(len(part.log.stamps) for part in windows) == 4001


def test_it_is_evaluated_in_windows(recorded, monkeypatch):
    seconds, states = recording.size(recorded)
    assert seconds == pytest.approx(4.0) and states == 4001
    whole = evaluated_bag.evaluate(recorded, view=BagView(whole=True))
    monkeypatch.setattr(evaluated_bag, 'SMALL', 0)
    monkeypatch.setattr(evaluated_bag, 'LONG', 1.0)
    monkeypatch.setattr(evaluated_bag, 'WINDOW', WIDTH)
    long = evaluated_bag.evaluate(recorded, view=BagView(whole=True))
    assert np.array_equal(long.log.time, whole.log.time) and long.last == whole.last
    assert_alike(long.metrics, whole.metrics)
    assert long.log.messages == whole.log.messages


def test_only_what_is_wanted_is_read(recorded, messages):  # noqa: F811
    file = bag_files.open_file(recorded)
    every = [
        record for record in bag_kinds.scan_sqlite(recorded, file) if isinstance(record, Block)
    ]
    rows = [row for block in every for row in block.heads()[['channel', 'log_time']].tolist()]
    begins = range(1, len(rows) + 1, ROWS)
    skipped = {*begins[1:7], begins[-1]}
    kept = [
        row
        for block in bag_kinds.scan_sqlite(recorded, file, skipped)
        if isinstance(block, Block)
        for row in block.heads()[['channel', 'log_time']].tolist()
    ]
    assert kept == rows[:ROWS] + rows[7 * ROWS : begins[-1] - 1]
    reader = BagReader(recorded, make_index=True)
    assert reader.counts == {f'/{topic.name}': len(found) for topic, found in messages.items()}
    there = reader.without(['/controller/status'])[recorded]
    told = [time for time, _ in messages[topics.STATUS]]
    near = [k // ROWS * ROWS + 1 for k, (_, time) in enumerate(rows) if time in told]
    assert len(there) > 20 and {*begins} - there <= {*near}
    parts = [part for part, _ in reader.arrays({'/joint_states': JOINT_STATES}, 2 * 10**9)]
    found = np.concatenate([each.log_times for part in parts for _, each in part])
    times = np.array([time for time, _ in messages[JOINT_STATES]])
    assert np.array_equal(found[found >= 2 * 10**9], times[times >= 2 * 10**9])
    assert (found >= 19 * 10**8).all()
    reader.close()


def test_a_table_that_breaks_while_it_is_read(recorded):
    reader = BagReader(recorded, make_index=True)
    changed(recorded, 'DROP TABLE messages')
    parts = [*reader.arrays({'/joint_states': JOINT_STATES})]
    assert isinstance(reader.damage[0], Damage) and parts[-1][1] is None
