"""The table of a bag that is written window by window is that of the bag, to the byte."""

import pandas
import pytest
from assembly import simulated
from bags import content, full_disk, streams, write_foreign

from parallel_robot.analysis import frames
from parallel_robot.bags import indexed_reader
from parallel_robot.bags.run import recorded_robot, recording
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.cli.command_line import main
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import JOINT_STATES, REFERENCE, Topic

DURATION = 2.0  # s
WIDTH = 0.43  # s of a window
PLACES = {
    'true links': {'true_robot.l1': 0.4008, 'true_robot.l2': 0.5993},
    'sensors that are not ideal': {'sensor.resolution': 1e-5},
    'states that are late': {'sensor.delay': 0.004, 'sensor.stamp': 'measured'},
}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return made(tmp_path_factory.mktemp('tables') / 'bag')


@pytest.fixture(scope='module')
def messages(bag):
    found = content(bag / 'bag_0.mcap')
    return {topic: found[topic.name] for topic in topics.RECORDED if topic != topics.ANSWERED}


def made(directory, scenario='paper_circle', **changed):
    values = config.resolve(scenario, {'duration': DURATION, 'time_mode': 'lockstep', **changed})
    simulation_bag.write(directory, values, [simulated(values)])
    return directory


@pytest.fixture
def exported(tmp_path, monkeypatch, capsys):
    """Exports a bag at once and in windows; returns the lines of both about the bag."""
    monkeypatch.setattr(indexed_reader, 'LARGE', 1)
    read = []
    chunks = recording.chunks
    monkeypatch.setattr(
        recording, 'chunks', lambda *words: (read.append(1) or part for part in chunks(*words))
    )

    def export(bag, *options, several=True):
        said = []
        for name, seconds in (('whole', 1000.0), ('parts', WIDTH)):
            monkeypatch.setattr(recorded_robot, 'SECONDS', seconds)
            read.clear()
            words = ['export', str(bag), '--out', str(tmp_path / f'{name}.csv'), *options]
            assert main(words) == 0
            said.append(capsys.readouterr().err.splitlines())
        assert len(read) > 2 or not several
        assert (tmp_path / 'parts.csv').read_bytes() == (tmp_path / 'whole.csv').read_bytes()
        return said

    return export


def test_the_table_of_a_simulation(bag, exported):
    assert exported(bag) == [[], []]


@pytest.mark.parametrize('change', PLACES)
def test_poses_go_on_where_those_of_the_window_before_end(change, tmp_path, exported):
    exported(made(tmp_path / 'bag', **PLACES[change]), several=change == 'true links')


def test_another_robot(tmp_path, exported):
    exported(made(tmp_path / 'bag', 'serial_2r_circle'))


def test_what_others_recorded_in_part(messages, tmp_path, exported):
    """States alone on a topic of their own, from one time on."""
    write_foreign(
        tmp_path / 'bag', {Topic('arm/states', JOINT_STATES.type): messages[JOINT_STATES]}
    )
    words = ('--topic', 'joint_states=/arm/states', '--from', '0.3', '--set', 'robot.l2=0.61')
    whole, parts = exported(tmp_path / 'bag', *words)
    assert parts == whole and any('no messages on' in line for line in parts)


def test_messages_that_are_lost(messages, tmp_path, exported):
    """References end for a while, commands and telemetry are lost across windows."""
    lost = {
        REFERENCE: range(820, 1400),
        topics.COMMANDS: range(855, 865),
        JOINT_STATES: (430, 861),
        topics.SLIDING_VARIABLE: (43, 131),
    }
    kept = {
        topic: [entry for k, entry in enumerate(entries) if k not in lost.get(topic, ())]
        for topic, entries in messages.items()
    }
    write_foreign(tmp_path / 'bag', kept)
    whole, parts = exported(tmp_path / 'bag')
    assert sum('no reference of their time' in line for line in parts) == 1
    assert len(parts) == len(whole)


@pytest.mark.parametrize('sample', [1500, 860], ids=['in a window', 'from its begin on'])
def test_poses_end_where_the_joints_have_none(sample, bag, tmp_path, exported):
    found = recording.read(bag).log.position.copy()
    found[sample:, 0] += 3.0
    write_foreign(tmp_path / 'bag', streams(found, found, start=0))
    whole, parts = exported(tmp_path / 'bag')
    (cut,) = {line for line in whole if 'the pose of the robot is evaluated up to' in line}
    assert cut in parts and f'sample {sample}' in cut


def test_a_second_run_is_read_as_a_whole(bag, messages, tmp_path, exported):
    states = messages[JOINT_STATES]
    later = [(time + 4 * 10**9, data) for time, data in states]
    write_foreign(tmp_path / 'bag', messages | {JOINT_STATES: states + later})
    whole, parts = exported(tmp_path / 'bag', several=False)
    assert parts == whole and any('go back' in line for line in parts)


def test_parquet_has_the_rows_of_all_windows(bag, tmp_path, monkeypatch):
    monkeypatch.setattr(recorded_robot, 'SECONDS', WIDTH)
    for suffix in ('.csv', '.parquet'):
        assert main(['export', str(bag), '--out', str(tmp_path / f'run{suffix}')]) == 0
    csv, parquet = (
        pandas.read_csv(tmp_path / 'run.csv'),
        pandas.read_parquet(tmp_path / 'run.parquet'),
    )
    pandas.testing.assert_frame_equal(csv, parquet, check_exact=True)


def test_a_disk_that_gets_full_in_a_later_window_leaves_nothing(bag, tmp_path, monkeypatch):
    monkeypatch.setattr(recorded_robot, 'SECONDS', WIDTH)
    with full_disk(700_000):
        assert main(['export', str(bag), '--out', str(tmp_path / 'run.csv')]) == 1
    assert not list(tmp_path.iterdir())


def test_lines_that_differ_in_numbers_are_told_once():
    lines = AlikeLines()
    for part in (['3 states of 1.5e-3 s', 'a bag'], ['a bag'], ['4 states of 2 s']):
        lines.add(part)
    assert lines.lines == ('3 states of 1.5e-3 s (the first of 2 such lines)', 'a bag')


def test_a_part_without_states_is_refused_as_ever(bag, tmp_path, capsys):
    words = ['export', str(bag), '--out', str(tmp_path / 'run.csv'), '--from', '100']
    assert main(words) == 2 and not list(tmp_path.iterdir())
    assert 'has no state between --from and --to: its states go from' in capsys.readouterr().err


@pytest.mark.parametrize('points', [10_000, 70])
def test_a_copy_for_viewers_is_the_same(points, bag, tmp_path, monkeypatch):
    monkeypatch.setattr(indexed_reader, 'LARGE', 1)
    monkeypatch.setattr(frames, 'ALL', points)
    copies = []
    for seconds in (1000.0, WIDTH):
        monkeypatch.setattr(recorded_robot, 'SECONDS', seconds)
        (tmp_path / f'{seconds}').mkdir()
        out = tmp_path / f'{seconds}' / 'copy'
        assert main(['export', str(bag), '--foxglove', str(out)]) == 0
        copies.append((out / 'copy_0.mcap').read_bytes())
    assert copies[0] == copies[1]
