"""A bag in windows: together they are the bag, and none takes more than its part."""

from types import SimpleNamespace

import numpy as np
import pytest
from assembly import simulated
from bags import content, write_foreign, write_mcap

from parallel_robot.bags import indexed_reader, limits
from parallel_robot.bags.bag_reader import BagView
from parallel_robot.bags.files import bag_files, mcap_reader
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.run import bag_difference, recording, run_windows
from parallel_robot.bags.writing import recovery, simulation_bag
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import HINGES
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.layouts import header_stamp
from parallel_robot_model.messages.topics import JOINT_STATES, SLIDING_VARIABLE, Topic

MS, SECOND = 10**6, 10**9  # ns
DURATION = 4.0  # s
WIDTH = 0.43  # s of a window


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    """Little is read beyond a window, and little at once."""
    for module in (indexed_reader, recording):
        monkeypatch.setattr(module, 'SLACK', 200 * MS)
    monkeypatch.setattr(indexed_reader, 'LARGE', 1)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp('windows') / 'bag'
    values = config.resolve('paper_circle', {'duration': DURATION, 'time_mode': 'lockstep'})
    simulation_bag.write(directory, values, [simulated(values)])
    return directory


@pytest.fixture(scope='module')
def messages(bag):
    found = content(bag / 'bag_0.mcap')
    return {topic: found[topic.name] for topic in topics.RECORDED}


def test_a_bag_may_have_more_chunks_than_descriptions(messages, tmp_path, monkeypatch):
    """Chunks grow with its length; topics and what describes them are few in every bag."""
    monkeypatch.setattr(limits, 'DESCRIPTIONS', 100)
    write_mcap(tmp_path / 'bag.mcap', messages, chunk_size=2000)
    reader = BagReader(tmp_path / 'bag.mcap')
    count = sum(1 for _ in reader.messages(['/joint_states'], 0))
    assert count == len(messages[JOINT_STATES]) and len(reader._chunks) > 100
    with pytest.raises(BagError, match='of memory'):
        BagReader(tmp_path / 'bag.mcap', 100 * limits.CHUNK_INDEX)


def without(messages, topic, lost):
    """All messages but some of a topic."""
    kept = [entry for k, entry in enumerate(messages[topic]) if k not in lost]
    return messages | {topic: kept}


def logged(messages, change):
    """The messages with other log times."""
    return {
        topic: [(change(topic, time), data) for time, data in entries]
        for topic, entries in messages.items()
    }


def stalled(_, time):
    """Of a recorder that stood still for 150 ms, and then got all at once."""
    return 2_349 * MS + time // 10_000 if 2_200 * MS < time < 2_350 * MS else time


def assert_together(parts, whole, chosen=slice(None)):
    """Some windows have the states of a run, their answers and references."""
    for name in whole.log._fields:
        value = getattr(whole.log, name)
        if isinstance(value, np.ndarray) and name != 'command':
            found = np.concatenate([getattr(part.log, name) for part in parts])
            np.testing.assert_array_equal(found, value[chosen], name)
    for name in ('stamps', 'acts', 'late') if whole.log.used else ():
        found = np.concatenate([getattr(part.log.used, name) for part in parts])
        np.testing.assert_array_equal(found, getattr(whole.log.used, name)[chosen], name)
    assert all(part.history == whole.history for part in parts)
    assert {part.log.start_stamp for part in parts} == {whole.log.start_stamp}


def assert_all(bag, whole_file=True):
    """The windows of a bag are together what it holds; what a broken file lacks is a guess."""
    whole = recording.read(bag, (SLIDING_VARIABLE,))
    parts = [*recording.chunks(bag, WIDTH, (SLIDING_VARIABLE,))]
    assert_together(parts, whole)
    if SLIDING_VARIABLE in whole.extra:
        for name in ('stamps', 'log_times'):
            found = [getattr(part.extra[SLIDING_VARIABLE], name) for part in parts]
            wanted = getattr(whole.extra[SLIDING_VARIABLE], name)
            assert np.array_equal(np.concatenate(found), wanted)
    for name, counted in whole.log.messages.items():
        found = [part.log.messages[name] for part in parts if name in part.log.messages]
        assert sum(each.count for each in found) == counted.count, name
        missing = sum(each.missing for each in found)
        assert missing == counted.missing or not whole_file, name
    return whole, parts


def rewritten(directory, bag, messages):
    """A bag of the suite with the facts of another and these messages by their log time."""
    facts = recording.read(bag).history.facts
    entries = [(time, topic.name, data) for topic in messages for time, data in messages[topic]]
    with BagWriter(directory, topics.RECORDED, facts) as writer:
        for time, name, data in sorted(entries, key=lambda entry: entry[0]):
            writer.write(name, time, data)
    return directory


def test_the_windows_of_a_simulation_are_together_the_run(bag):
    _, parts = assert_all(bag)
    assert len(parts) == 10
    assert [len(part.log.stamps) for part in parts] == [430] * 9 + [131]


@pytest.mark.parametrize('stamp', ['sent', 'measured'])
def test_states_that_are_old_belong_to_the_windows_of_their_stamps(stamp, tmp_path):
    age = {'sensor.delay': 0.004, 'sensor.stamp': stamp}
    values = config.resolve('paper_circle', {'duration': 1.0, 'time_mode': 'lockstep', **age})
    simulation_bag.write(tmp_path / 'bag', values, [simulated(values)])
    assert_all(tmp_path / 'bag')


CHANGES = {
    'commands that are logged late': lambda found: logged(
        found, lambda topic, time: time + 3 * MS * (topic == topics.COMMANDS)),
    'records that are logged late': lambda found: logged(
        found, lambda topic, time: time + 100 * MS * (topic == topics.ANSWERED)),
    'a recorder that stood still': lambda found: logged(found, stalled),
    'another clock': lambda found: logged(found, lambda _, time: time + 10**6 * SECOND),
    'a clock that is fast': lambda found: logged(found, lambda _, time: time + time // 20),
    'lost states': lambda found: without(found, topics.JOINT_STATES, {*range(428, 433), 3000}),
    'states of a second that are lost': lambda found: without(
        found, topics.JOINT_STATES, range(1000, 2000)),
    'lost references': lambda found: without(found, topics.REFERENCE, {*range(850, 870), 50}),
    'lost commands': lambda found: without(found, topics.COMMANDS, {*range(855, 865), 3999}),
    'lost records': lambda found: without(found, topics.ANSWERED, {43, 201, 202}),
    'lost telemetry': lambda found: without(found, SLIDING_VARIABLE, {43, 131, 132}),
}  # fmt: skip


@pytest.mark.parametrize('change', CHANGES)
def test_whatever_happened_to_the_messages(change, bag, messages, tmp_path):
    assert_all(rewritten(tmp_path / 'bag', bag, CHANGES[change](messages)))


def test_a_bag_of_others_has_the_same_windows(bag, messages, tmp_path):
    """Without a record of the answers, topic after topic in the file."""
    found = {topic: messages[topic] for topic in messages if topic != topics.ANSWERED}
    write_foreign(tmp_path / 'bag', found, space='/left')
    whole, parts = assert_all(tmp_path / 'bag')
    assert whole.log.used is None and not np.isnan(whole.log.answer).any()
    assert len(parts) == 10 and not whole.history.facts


def test_a_bag_without_index_is_read_at_one_go(bag, messages, tmp_path):
    write_mcap(tmp_path / 'bag.mcap', messages, use_chunking=False)
    assert len(assert_all(tmp_path / 'bag.mcap')[1]) == 10
    data = (bag / 'bag_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(data[: len(data) * 2 // 3])
    whole, parts = assert_all(tmp_path / 'cut.mcap')
    assert len(whole.log.time) > 2000 and whole.log.warnings == parts[0].log.warnings


def test_a_broken_chunk_is_left_out_and_told(bag, tmp_path):
    data = bytearray((bag / 'bag_0.mcap').read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / 'bag.mcap').write_bytes(data)
    whole, parts = assert_all(tmp_path / 'bag.mcap', whole_file=False)
    assert len(whole.log.time) < 4_001 and 'damaged in one place' in whole.log.warnings[0]
    assert parts[-1].log.warnings[0] == whole.log.warnings[0]


@pytest.mark.parametrize(
    'window', [(0.0, 1.0), (-5.0, 0.5), (2.0001, 2.0051), (1.1, 3.0), (3.5, 20.0)]
)
@pytest.mark.parametrize('change', [None, 'a recorder that stood still', 'another clock'])
def test_a_window_has_the_states_between_its_times(window, change, bag, messages, tmp_path):
    if change:
        bag = rewritten(tmp_path / 'bag', bag, CHANGES[change](messages))
    whole = recording.read(bag)
    chosen = (whole.log.time >= window[0]) & (whole.log.time < window[1])
    assert chosen.any()
    assert_together([recording.read(bag, window=window)], whole, chosen)


def test_a_window_without_states_is_refused(bag):
    with pytest.raises(BagError, match='no states from t = 30 s to 31 s'):
        recording.read(bag, window=(30.0, 31.0))


def test_what_is_not_needed_is_not_unpacked(bag, monkeypatch):
    """Apart from the chunks with statuses, here the first one."""
    chunks, unpacked, content_of = len(BagReader(bag)._chunks), [], mcap_reader.chunk_content

    def counted(record, allowance):
        unpacked.append(len(record))
        return content_of(record, allowance)

    monkeypatch.setattr(mcap_reader, 'chunk_content', counted)
    recording.read(bag, window=(3.0, 3.1))
    assert chunks > 10 and len(unpacked) < 6
    unpacked.clear()
    parts = recording.chunks(bag, 0.5)
    next(parts)
    assert len(unpacked) < 6
    assert sum(1 for _ in parts) == 8 and len(unpacked) < 1.5 * chunks


def test_memory_is_that_of_a_window(bag):
    """A bag that takes too much as a whole is read in windows."""
    size = sum(path.stat().st_size for path in bag_files.files(bag))
    with pytest.raises(BagError, match='takes more than'):
        recording.read(bag, memory=4 * size)
    assert (
        sum(len(part.log.stamps) for part in recording.chunks(bag, 0.2, memory=4 * size)) == 4_001
    )
    with pytest.raises(BagError, match='takes more than'):
        [*recording.chunks(bag, 4.0, memory=4 * size)]


def test_a_second_run_in_a_bag_is_refused_in_windows(bag, messages, tmp_path):
    states = messages[topics.JOINT_STATES]
    again = [(time + 4 * SECOND, data) for time, data in states if header_stamp(data) % 2 == 0]
    found = messages | {topics.JOINT_STATES: states + again}
    with pytest.raises(
        BagError, match='go back, as in a second run: it can be read as a whole alone'
    ):
        [*recording.chunks(rewritten(tmp_path / 'bag', bag, found), WIDTH)]
    parts = recording.chunks(tmp_path / 'bag', WIDTH, view=BagView(stop=2.0))
    assert sum(len(part.log.time) for part in parts) == 2001
    size = (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size
    message = (
        r'bag, 0\.00\d+ GB read at once \(parallel_robot recover mends one that is damaged; '
        r'export, identify and replay take --to before stamps that go back\), takes more than '
        r'0\.00\d+ GB of memory$'
    )
    with pytest.raises(BagError, match=message):
        recording.read(tmp_path / 'bag', memory=2 * size)


@pytest.mark.parametrize('part', [(1.0, 2.5), (None, 0.7), (3.1, None)])
def test_a_part_of_a_bag_of_others_has_the_same_windows(part, bag, messages, tmp_path):
    """Topics of their own, without references and commands."""
    found = {Topic('arm/states', JOINT_STATES.type): messages[JOINT_STATES]}
    write_foreign(tmp_path / 'bag', found)
    view = BagView({JOINT_STATES.name: '/arm/states'}, start=part[0], stop=part[1])
    whole = recording.read(tmp_path / 'bag', motion_only=True, view=view)
    parts = [*recording.chunks(tmp_path / 'bag', WIDTH, motion_only=True, view=view)]
    assert_together(parts, whole)
    assert {warning for each in parts for warning in each.log.warnings} == {*whole.log.warnings}


def test_the_end_of_a_run_is_known_without_its_states(bag, monkeypatch):
    monkeypatch.setattr(run_windows, 'SECONDS', WIDTH)
    log, past, count = run_windows.run_end(bag)
    whole = recording.read(bag)
    assert count == len(whole.log.stamps) and log.stamps[-1] == whole.log.stamps[-1]
    assert len(log.stamps) <= DURATION / WIDTH + 1.0 and past == whole.history


def test_the_difference_of_two_runs_is_found_in_windows(bag, tmp_path, monkeypatch):
    """They end at different times."""
    given = {'duration': 3.1, 's_fotsmc.G': 11.0, 'time_mode': 'lockstep'}
    values = config.resolve('paper_circle', given)
    simulation_bag.write(tmp_path / 'other', values, [simulated(values)])
    monkeypatch.setattr(bag_difference, 'SECONDS', WIDTH)
    one, two = (recording.read(each).log for each in (bag, tmp_path / 'other'))
    count = len(two.time)
    angle, torque = (
        np.abs(first[:count] - second[:count]).max()
        for first, second in ((one.position, two.position), (one.command, two.command))
    )
    wanted = f'joints by up to {angle:.2g} rad, commands by up to {torque:.2g} N m'
    assert bag_difference.size(bag, tmp_path / 'other') == wanted


def test_states_are_compared_wherever_their_windows_end(monkeypatch):
    position = np.random.default_rng(5).normal(size=(9, 3))
    answer = 10.0 * position
    other = position.copy()
    other[7, 1] += 0.25
    runs = {
        'one': (position, answer, np.split(np.arange(9), [2, 6])),
        'other': (other, answer - 0.5, np.split(np.arange(9), [4, 5])),
    }

    def windows(bag, *_, **__):
        positions, answers, parts = runs[bag]
        for rows in parts:
            log = SimpleNamespace(units=HINGES, position=positions[rows], answer=answers[rows])
            yield SimpleNamespace(log=log)

    monkeypatch.setattr(recording, 'chunks', windows)
    wanted = 'joints by up to 0.25 rad, commands by up to 0.5 N m'
    assert bag_difference.size('one', 'other') == wanted


def test_what_a_recovered_bag_lacks_is_counted_in_windows(bag, messages, tmp_path, monkeypatch):
    monkeypatch.setattr(recovery, 'SECONDS', WIDTH)
    lost = without(messages, JOINT_STATES, {*range(428, 433), *range(2000, 2600)})
    write_foreign(tmp_path / 'bag', lost)
    missing = recovery.recover(tmp_path / 'bag', tmp_path / 'whole').missing
    assert missing[JOINT_STATES.name] == 605
