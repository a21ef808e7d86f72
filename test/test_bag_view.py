"""Bags of others: what they do not say is given by options, the same for all commands."""

import functools
import json
from contextlib import ExitStack

import numpy as np
import pytest
from bags import MS, START, STORE, content, streams, write_mcap
from rosbags.rosbag2 import StoragePlugin, Writer

import parallel_robot as pr
from parallel_robot.analysis.report.figures import NOT_IN_FOREIGN
from parallel_robot.bags.bag_reader import view
from parallel_robot.bags.run import recorded_robot, recording
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot.cli.command_line import main
from parallel_robot.live.bag_source import open_bag
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.messages import layouts, topics

COUNT = 400
AXES = ('axis_1', 'axis_2', 'axis_3')
OWN = {topic: f'/{topic.name}' for topic in (topics.JOINT_STATES, topics.REFERENCE)}
OWN[topics.COMMANDS] = '/effort_controller/commands'


@functools.cache
def simulated(scenario):
    return pr.simulate(scenario, law='pid', duration=COUNT / 1000)


def motion(count=COUNT, joints=3):
    """References of joints and where they are [rad]."""
    run = simulated('paper_circle' if joints == 3 else 'serial_2r_circle')
    return run.reference[:count], run.position[:count]


def write(directory, runs, names=None):
    """Write runs, {place: (reference, position)}, each topic of it under its name."""
    with Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for place, found in runs.items():
            for topic, messages in found.items():
                name = place + (names or OWN)[topic]
                connection = writer.add_connection(name, topic.type, typestore=STORE)
                for log_time, data in messages:
                    writer.write(connection, log_time, data)
    return directory


def renamed(joints, count=COUNT):
    """A run whose joints have other names."""
    reference, position = motion(count, len(joints))
    stamps = START + np.arange(count) * MS
    effort = np.zeros_like(position)
    speed = np.gradient(position, 1e-3, axis=0)
    records = {
        topics.JOINT_STATES: layouts.joint_state(joints).records(
            count, stamps, position=position, velocity=speed, effort=effort
        ),
        topics.REFERENCE: layouts.joint_trajectory(joints).records(
            count, stamps, position=reference, velocity=speed
        ),
        topics.COMMANDS: layouts.float64_multi_array(len(joints)).records(count, data=effort),
    }
    return {
        topic: [(int(stamp), row.tobytes()) for stamp, row in zip(stamps, rows, strict=True)]
        for topic, rows in records.items()
    }


def asked(topics=None, values=None, **options):
    """A view by the options that are given."""
    return view(topic=topics, param_file=values, **options)


ELSEWHERE = {
    topics.JOINT_STATES: '/robot1/joint_states',
    topics.REFERENCE: '/desired',
    topics.COMMANDS: '/forward_effort_controller/commands',
}


def test_topics_of_other_names_are_named_and_taken(tmp_path):
    bag = write(tmp_path / 'bag', {'': streams(*motion())}, ELSEWHERE)
    options = {}
    for word, name in (('reference', '/desired'), ('commands', ELSEWHERE[topics.COMMANDS])):
        with pytest.raises(BagError) as error:
            recording.read(bag, view=asked(topics=options))
        assert f'--topic {word}={name} takes it' in str(error.value)
        options[word] = name
    log = recording.read(bag, view=asked(topics=options)).log
    home = recording.read(write(tmp_path / 'home', {'': streams(*motion())})).log
    assert (log.position == home.position).all() and (log.command == home.command).all()
    options['joint_states'] = 'robot1/joint_states'  # with or without a slash
    assert (recording.read(bag, view=asked(topics=options)).log.position == home.position).all()


def test_no_advice_names_a_topic_without_messages(tmp_path):
    """An empty one of the suite's own name, as a recorder leaves it, or in a namespace."""
    whole, own = streams(*motion()), topics.COMMANDS.name
    empty, commands = {**whole, topics.COMMANDS: []}, {topics.COMMANDS: whole[topics.COMMANDS]}
    for runs, meant in (
        ({'': empty, '/law': commands}, f'/law/{own}'),
        ({'/law': empty, '': commands}, f'/{own}'),
    ):
        bag = write(tmp_path / meant.replace('/', ' '), runs)
        with pytest.raises(BagError, match=f'--topic commands={meant} takes it') as error:
            recording.read(bag)
        assert 'Float64MultiArray), without a message' in str(error.value)
        assert len(recording.read(bag, view=asked(topics={'commands': meant})).log.command)
    bag = write(tmp_path / 'alone', {'/arm': empty})
    for options in ({}, {'commands': f'/arm/{own}'}):
        with pytest.raises(BagError, match=r'it has /arm/.*MultiArray\), without a message$'):
            recording.read(bag, view=asked(topics=options))


def test_one_of_several_robots_is_chosen(tmp_path):
    runs = {'/left': streams(*motion()), '/right': streams(*motion(100))}
    bag = write(tmp_path / 'bag', runs)
    with pytest.raises(BagError, match='holds several runs, in /left, /right; --namespace'):
        recording.read(bag)
    assert len(recording.read(bag, view=asked(namespace='/right')).log.time) == 100
    with pytest.raises(BagError, match='has nothing in --namespace /up, but in /left, /right'):
        recording.read(bag, view=asked(namespace='/up'))


def test_joints_of_other_names(tmp_path):
    bag = write(tmp_path / 'bag', {'': renamed(AXES)})
    with pytest.raises(BagError, match='only axis_1, axis_2, axis_3; --joints names them'):
        recording.read(bag)
    log = recording.read(bag, view=asked(joints=AXES)).log
    assert log.joints == AXES
    assert 'planar_3rrr' in log.warnings[-1] and 'given: joints=axis_1' in log.warnings[-1]
    turned = recording.read(bag, view=asked(joints=AXES[::-1])).log
    assert (turned.position == log.position[:, ::-1]).all()


def test_another_robot_by_scenario_and_values(tmp_path):
    bag = write(tmp_path / 'bag', {'': renamed(('shoulder', 'elbow'))})
    values = {'robot.l1': 0.7}
    names = ('shoulder', 'elbow')
    log = recording.read(
        bag, view=asked(scenario='serial_2r_circle', joints=names, values=values)
    ).log
    assert log.scenario == 'serial_2r_circle' and log.law == 'unknown'
    assert log.config['robot_model'] == 'serial_2r' and log.config['true_robot.l1'] == 0.7
    assert 'serial_2r_circle' in log.warnings[-1] and 'robot.l1=0.7' in log.warnings[-1]
    with pytest.raises(InputError, match='no_such'):
        recording.read(bag, view=asked(values={'no_such': 1}))
    with pytest.raises(InputError, match=r'joints must be 3 names.*--scenario chooses'):
        recording.read(bag, view=asked(joints=names))  # the robot of the paper has three


@pytest.fixture(scope='module')
def own(tmp_path_factory):
    """A bag of the suite."""
    bag = tmp_path_factory.mktemp('own') / 'bag'
    pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), bag)
    return bag


def test_what_a_bag_says_itself_is_kept_unless_told(own):
    for options in ({'scenario': 'paper_line'}, {'values': {'robot.l1': 0.5}}):
        with pytest.raises(InputError, match=r'has its own configuration.*--override'):
            recording.read(own, view=asked(**options))
    changed = asked(values={'robot.l1': 0.5}, override=True)
    log = recording.read(own, view=changed).log
    assert log.config['robot.l1'] == 0.5 and log.config['true_robot.l1'] == 0.5
    assert 'in place of what it says itself' in log.warnings[-1]
    assert recording.read(own).log.config['robot.l1'] != 0.5


def test_a_part_of_a_run(own):
    whole = recorded_robot.read(own).log
    log = recorded_robot.read(own, view=asked(start=0.1, stop=0.2)).log
    assert log.time[0] == 0.1 and log.time[-1] == 0.2
    assert (log.position == whole.position[100:201]).all()
    with pytest.raises(BagError, match=r'no state between --from and --to.*0\.500 s'):
        recorded_robot.read(own, view=asked(start=7.0))
    with pytest.raises(InputError, match=r'--from 2 must be before --to 1'):
        asked(start=2.0, stop=1.0)


FOREIGN = [
    '--topic',
    'reference=/desired',
    '--topic',
    'commands=/forward_effort_controller/commands',
]
FOREIGN += ['--joints', 'axis_1,axis_2,axis_3', '--set', 'robot.mp=2.9']
COMMANDS = {
    'analyze': ['--figure', '{tmp}/run.png', '--json', '{tmp}/run.json'],
    'export': ['--out', '{tmp}/run.csv', '--from', '0.1', '--to', '0.2'],
    'report': ['--out', '{tmp}/report', '--from', '0.1'],
    'video': ['--out', '{tmp}/run.gif', '--rate', '4', '--to', '0.3'],
    'replay': ['--law', 'pid', '--figure', '{tmp}/replay.png', '--from', '0.1'],
    'identify': ['--rest'],
}


@pytest.mark.parametrize('command', COMMANDS)
def test_each_command_takes_the_options(tmp_path, capsys, command):
    bag = write(tmp_path / 'bag', {'': renamed(AXES)}, ELSEWHERE)
    words = [word.format(tmp=tmp_path) for word in COMMANDS[command]]
    code = main([command, str(bag), *FOREIGN, *words])
    out, err = capsys.readouterr()
    if command == 'identify':  # it was read, and moves all the time
        assert code == 2 and 'no phase of rest' in err
        return
    assert code == 0, err
    if command == 'analyze':
        assert json.loads((tmp_path / 'run.json').read_text())['messages']['joint_states']
    if command == 'export':
        assert '101 rows' in out
    assert command not in ('analyze', 'export', 'replay') or 'robot.mp=2.9' in err


@pytest.mark.parametrize('words', [['analyze'], ['replay', '--law', 'pid']])
def test_nothing_is_written_into_a_bag_of_somebody_else(tmp_path, capsys, words):
    bag = write(tmp_path / 'bag', {'': renamed(AXES)}, ELSEWHERE)
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    assert main([words[0], str(bag), *FOREIGN, *words[1:]]) == 0
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before
    assert f'figure  {NOT_IN_FOREIGN}' in capsys.readouterr().out


def test_python_takes_the_same_options(tmp_path):
    bag = write(tmp_path / 'bag', {'': renamed(AXES)}, ELSEWHERE)
    topic = {'reference': '/desired', 'commands': ELSEWHERE[topics.COMMANDS]}
    options = {'topic': topic, 'joints': AXES, 'robot.mp': 2.9}
    run = pr.load(bag, start=0.1, **options)
    assert run.joints == AXES and run.time[0] == 0.1
    assert len(pr.export(bag, start=0.1, stop=0.2, **options)) == 101
    assert pr.replay(bag, law='pid', stop=0.1, **options).torque.shape == (101, 3)
    for wrong in ({'joints': 'a,b'}, {'topic': 'x'}, {'start': 'x'}, {'topic': {'no': '/x'}}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            pr.load(bag, **wrong)


def test_a_bag_without_configuration_is_shown(tmp_path):
    bag = write(tmp_path / 'bag', {'': renamed(AXES)})
    with ExitStack() as stack:
        source = open_bag(stack, bag, False, asked(joints=AXES))
        assert source.texts() and source.look()


def test_words_of_the_option_are_checked(capsys):
    assert main(['analyze', 'x', '--topic', 'nothing']) == 2
    assert 'NAME=TOPIC' in capsys.readouterr().err
    assert main(['analyze', 'x', '--topic', 'joint_state=/x']) == 2
    assert "did you mean 'joint_states'" in capsys.readouterr().err


def test_one_of_several_recordings_in_a_folder(tmp_path, capsys):
    reference, position = motion()
    (tmp_path / 'bag').mkdir()
    for k, start in enumerate((START, START + 3600_000 * MS)):
        found = streams(reference, position, start=start)
        write_mcap(tmp_path / 'bag' / f'{k}.mcap', found)
    bag, first = tmp_path / 'bag', tmp_path / 'bag' / '0.mcap'
    assert 'several recordings' in ' '.join(recording.read(bag).log.warnings)
    alone = recording.read(first).log
    for start, stop in ((0.0, 1.0), (3600.0, None)):
        log = recording.read(bag, view=asked(start=start, stop=stop)).log
        assert (log.position == alone.position).all()
        assert 'several recordings' not in ' '.join(log.warnings)
    figures = []
    for words in (
        [str(first)],
        [str(bag), '--from', '0', '--to', '1'],
        [str(bag), '--from', '3600'],
    ):
        place = tmp_path / f'{len(figures)}.json'
        main(['analyze', *words, '--json', str(place), '--figure', str(place.with_suffix('.png'))])
        figures.append(json.loads(place.read_text())['seen']['steady'])
    out, err = capsys.readouterr()
    assert 'several recordings' not in err and out.count('real time: held') == 3
    assert figures[1] == pytest.approx(figures[2])


def test_neighbours_swapped_in_the_file_give_the_same_figures(own, tmp_path, capsys):
    [file] = own.glob('*.mcap')
    found = content(file)
    states = found['joint_states']
    times, payloads = zip(*states, strict=True)
    order = np.arange(len(states))
    order[: len(order) // 2 * 2] = order[: len(order) // 2 * 2].reshape(-1, 2)[:, ::-1].ravel()
    found['joint_states'] = [(times[k], payloads[j]) for k, j in enumerate(order)]
    facts = recording.read(own).history.facts
    with BagWriter(tmp_path / 'swapped', topics.RECORDED, facts) as writer:
        for topic, stream in found.items():
            for log_time, data in stream:
                writer.write(topic, log_time, data)
    results = []
    for bag in (own, tmp_path / 'swapped'):
        place = tmp_path / f'{len(results)}.json'
        figure = ['--figure', str(tmp_path / f'{len(results)}.png')]
        assert main(['analyze', str(bag), '--json', str(place), *figure]) == 0
        results.append(json.loads(place.read_text()))
    assert results[0] == results[1]
    assert 'are put in the order of their stamps' in capsys.readouterr().err
    assert main(['replay', str(tmp_path / 'swapped')]) == 0
    assert 'identical' in capsys.readouterr().out
