"""The experiment once more, from the bag alone."""

import os
import re
import shutil
from pathlib import Path

import pytest
from bags import content, write_mcap
from mcap.reader import make_reader
from test_replay import live, switch

from parallel_robot.analysis.replay import bag_rerun
from parallel_robot.bags import experiment, history, limits
from parallel_robot.bags.files.bag_files import MISSING
from parallel_robot.bags.run import bag_difference, recording
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot.bags.writing.recorder import Recorder
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import rerun, run
from parallel_robot_control.safety import faults
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages import topics

EXAMPLE = Path(__file__).parents[1] / 'docs' / 'example_law.py'
WORDS = ['paper_circle', '--duration', '0.1']


def simulated(out, *words):
    assert main(['simulate', *WORDS, *words, '--out', str(out)]) == 0
    return out


def test_a_simulation_with_changed_values_comes_out_the_same(tmp_path, capsys):
    bag = simulated(tmp_path / 'bag', '--set', 'true_robot.m1=6', '--set', 's_fotsmc.G=12')
    assert main(['rerun', str(bag)]) == 0
    out, err = capsys.readouterr()
    again = tmp_path / 'bag_rerun'
    assert 'identical: 382 messages' in out and err == ''
    assert content(bag / 'bag_0.mcap') == content(again / 'bag_rerun_0.mcap')
    assert recording.read(again).log.config == recording.read(bag).log.config


def test_a_law_of_ones_own_comes_from_the_bag(law, tmp_path, capsys):
    words = ['--set', f'custom_laws=[{law}]', '--law', 'my_law', '--set', 'my_law.Kp=700']
    bag = simulated(tmp_path / 'bag', *words)
    assert recording.read(bag).history.sources['custom_laws'] == {'my_law': EXAMPLE.read_bytes()}
    law.unlink()
    assert main(['rerun', str(bag), '--trust', '--out', str(tmp_path / 'again')]) == 0
    assert main(['replay', str(bag), '--trust']) == 0
    out, err = capsys.readouterr()
    assert 'identical: 382 messages' in out and 'identical: 101 commands' in out
    assert 'runs the code of my_law' in err
    assert (
        recording.read(tmp_path / 'again').history.sources == recording.read(bag).history.sources
    )


def by_hand(directory, bag, **parameters):
    """The messages of a bag, as a recorder takes them that was started by hand."""
    values = config.resolve('paper_circle')
    loop = group(values, LoopParameters, '')
    recorder = Recorder(directory, loop, values, pytest.fail)
    recorder.open()
    streams, by_name = content(next(bag.glob('*.mcap'))), {t.name: t for t in topics.RECORDED}
    entries = [(time, name, data) for name, stream in streams.items() for time, data in stream]
    for log_time, name, data in sorted(entries, key=lambda entry: entry[0]):
        recorder.take(by_name[name], data, log_time)
    found = [recorder.found(f'/{node}', values) for node, values in parameters.items()]
    recorder.close()
    return [line for lines in found for line in lines]


@pytest.fixture
def law(tmp_path):
    """A custom law somewhere else."""
    path = tmp_path / 'elsewhere' / 'my_law.py'
    path.parent.mkdir()
    shutil.copy(EXAMPLE, path)
    return path


def test_a_bag_recorded_by_hand_holds_the_law_of_its_controller(law, tmp_path, capsys):
    words = ['--set', f'custom_laws=[{law}]', '--law', 'my_law', '--set', 'my_law.Kp=700']
    bag = simulated(tmp_path / 'bag', *words)
    controller = {'custom_laws': [str(law)], 'law': 'my_law', 'my_law.Kp': 700.0}
    for name in ('first', 'second'):  # two controllers of the same law, say
        assert (
            by_hand(tmp_path / name, bag, controller=controller, other={'custom_laws': ['x']})
            == []
        )
    law.unlink()
    assert recording.read(tmp_path / 'first').history.sources['custom_laws'] == {
        'my_law': EXAMPLE.read_bytes()
    }
    assert main(['replay', str(tmp_path / 'first'), '--trust']) == 0
    assert 'identical: 101 commands' in capsys.readouterr().out


def test_a_law_that_cannot_be_read_is_named(law, tmp_path):
    bag, odd = simulated(tmp_path / 'bag'), law.with_name('odd.py')
    law.write_bytes(bytes(limits.SOURCE + 1))
    odd.mkdir()
    os.mkfifo(law.with_name('waits.py'))
    files = ['my_law.py', str(law), str(law.with_name('gone.py')), str(odd), str(EXAMPLE),
             str(law.with_name('waits.py')), '/etc/passwd', '\0.py', 7]  # fmt: skip
    lines = by_hand(tmp_path / 'hand', bag, controller={'custom_laws': files})
    assert len(lines) == len(files) - 1 and not any('\n' in line for line in lines)
    assert f'{law} has more than 1048576 bytes' in lines[1]
    assert all(lines[k].endswith('is not on this machine') for k in (0, 2))
    assert all(line.endswith('is no .py file') for line in lines[3:6])
    assert all('is not on this machine' in line for line in lines[6:])
    assert recording.read(tmp_path / 'hand').history.sources['custom_laws'] == {
        'example_law': EXAMPLE.read_bytes()
    }
    with (tmp_path / 'hand' / 'hand_0.mcap').open('rb') as stream:
        notes = [
            record.metadata
            for record in make_reader(stream).iter_metadata()
            if record.name == MISSING['custom_laws']
        ]
    assert [*{key: text for note in notes for key, text in note.items()}.values()] == lines
    strange = {'text': 'abc', 'number': 7, 'many': [str(EXAMPLE), *['/x.py'] * 10_000]}
    for name, value in strange.items():
        assert len(by_hand(tmp_path / name, bag, controller={'custom_laws': value})) < 100


def test_a_bag_without_the_source_of_its_law_says_so(law, tmp_path, capsys):
    bag = simulated(tmp_path / 'bag')
    controller = {'custom_laws': [str(law.with_name('gone.py'))], 'law': 'gone'}
    by_hand(tmp_path / 'hand', bag, controller=controller)
    capsys.readouterr()
    assert main(['replay', str(tmp_path / 'hand')]) == 2
    assert 'does not hold the law gone' in capsys.readouterr().err


def test_a_bag_recorded_by_hand_is_run_again_as_its_nodes_were(law, tmp_path, monkeypatch, capsys):
    bag = simulated(tmp_path / 'bag')
    nodes = {
        'trajectory': {
            'scenario': 'paper_line', 'trajectory.shape': 'line', 'line.duration': 5.0,
            'law': 'smc',
        },
        'plant': {'true_robot.m1': 6.0, 'robot.m1': 7.0, 'scenario': 'heavy_circle'},
        'controller': {
            'custom_laws': [str(law)], 'law': 'my_law', 'my_law.Kp': 700.0, 'smc.z': 21.0,
            'granted.realtime': 'none', 'start_stamp': 5, 'robot.m1': 5.0,
        },
    }  # fmt: skip
    by_hand(tmp_path / 'hand', bag, **nodes)
    log = recording.read(tmp_path / 'hand').log
    assert (log.scenario, log.law) == ('paper_line', 'my_law')
    assert (log.config['robot.m1'], log.config['custom_laws']) == (5.0, [])
    runs = []
    monkeypatch.setattr(run, 'record', lambda *words: runs.append(words) or 0)
    assert main(['rerun', str(tmp_path / 'hand'), '--trust']) == 0
    assert main(['rerun', str(tmp_path / 'hand'), '--trust', '--duration', '7']) == 0
    (scenario, changed, out), (_, other, _) = runs
    assert scenario == 'paper_line' and out == tmp_path / 'hand_rerun'
    (source,) = changed.pop('custom_laws')
    assert Path(source).name == 'my_law.py' and source != str(law)
    assert changed == {
        'duration': 0.1, 'line.duration': 5.0, 'true_robot.m1': 6.0, 'robot.m1': 5.0,
        'law': 'my_law', 'my_law.Kp': 700.0, 'smc.z': 21.0,
        'robot_model': 'planar_3rrr', 'robot_description': '', 'robot_compiled': '',
        'custom_robots': [], 'custom_trajectories': [],
    }  # fmt: skip
    assert other['duration'] == 7.0
    assert 'bytes cannot be compared' in capsys.readouterr().out


def test_another_duration_is_run(tmp_path, capsys):
    bag = simulated(tmp_path / 'bag')
    assert main(['rerun', str(bag), '--duration', '0.05']) == 0
    assert 'identical: 123 messages, as far as both bags go, t = 0.03 s' in capsys.readouterr().out
    assert len(recording.read(tmp_path / 'bag_rerun').log.time) == 51
    for wrong, message in ('0', 'duration must be positive'), ('-1', 'duration must be at least'):
        words = ['rerun', str(bag), '--duration', wrong, '--out', str(tmp_path / 'again')]
        assert main(words) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / 'again').exists()


def test_what_differs_first_is_said(tmp_path):
    one, other = simulated(tmp_path / 'one'), simulated(tmp_path / 'other', '--law', 'smc')
    assert bag_difference.compare(one, one) == (382, '')
    _, difference = bag_difference.compare(one, other)
    assert 'at t = 0.000 s: other bytes' in difference and difference.startswith('first on /')
    longer = tmp_path / 'longer'
    assert main(['simulate', 'paper_circle', '--duration', '0.2', '--out', str(longer)]) == 0
    assert 'at t = 0.101 s: 101 messages, now 201' in bag_difference.compare(one, longer)[1]


def test_a_bag_of_another_version_and_a_difference(tmp_path, capsys, monkeypatch):
    bag = simulated(tmp_path / 'bag')
    monkeypatch.setattr(bag_rerun, 'software', lambda: {'version': '9.9.9'})
    monkeypatch.setattr(bag_difference, 'compare', lambda *_: (3, 'first on /pose'))
    assert main(['rerun', str(bag)]) == 1
    out, err = capsys.readouterr()
    assert 'differs: first on /pose' in out
    assert err.startswith('warning: the bag was made by version ') and err.count('\n') == 1
    assert err.endswith('this is version 9.9.9\n')


def test_a_bag_of_another_processor_says_so_and_how_much_it_differs(tmp_path, capsys, monkeypatch):
    bag = simulated(tmp_path / 'bag', '--set', 's_fotsmc.G=11')
    monkeypatch.setattr(experiment.platform, 'machine', lambda: 'another')
    assert main(['rerun', str(bag)]) == 0
    err = capsys.readouterr().err
    assert err.startswith('warning: the bag is of another kind of processor (')
    old = experiment.arithmetic_doubt({'arithmetic': '85b3d972-3ebf942f', 'processor': 'theirs'})
    assert old.startswith('the bag was computed with the libm of its machine') and 'theirs' in old
    other = simulated(tmp_path / 'other')
    capsys.readouterr()
    monkeypatch.setattr(rerun.simulate, 'record', lambda *_: 0)
    assert main(['rerun', str(bag), '--out', str(other)]) == 1
    logs = recording.read(bag).log, recording.read(other).log
    apart = [f'{abs(logs[0].position - logs[1].position).max():.2g} rad']
    apart.append(f'{abs(logs[0].command - logs[1].command).max():.2g} N m')
    told = capsys.readouterr().out.splitlines()[-1]
    assert told.strip() == f'joints by up to {apart[0]}, commands by up to {apart[1]}'
    assert '0 rad' not in apart and '0 N m' not in apart


def test_changes_during_the_run_are_not_repeated(tmp_path):
    bag = live(
        tmp_path / 'bag',
        {50: switch(law='pid'), 90: lambda controller: controller.trip(faults.EMERGENCY_STOP)},
    )
    log, past, _ = recording.read(bag)
    assert '2 changes of law' in bag_rerun.doubts(log.config, past)[-1]
    remarks = history.remarks(past, log.start_stamp)
    assert remarks[-1].startswith('fault at t = 0.090 s') and 'emergency stop' in remarks[-1]


def test_a_bag_of_others_cannot_be_repeated(tmp_path, capsys):
    bag = simulated(tmp_path / 'bag')
    with BagWriter(tmp_path / 'other', topics.RECORDED, {}) as writer:
        for topic, stream in content(bag / 'bag_0.mcap').items():
            for log_time, data in stream:
                writer.write(topic, log_time, data)
    capsys.readouterr()
    assert main(['rerun', str(tmp_path / 'other')]) == 2
    assert 'does not say what experiment made it' in capsys.readouterr().err


CHANGES = {
    'one is missing': (lambda each: each[:50] + each[51:], 0.05, 'another time|other bytes'),
    'one is doubled': (lambda each: each[:51] + each[50:], 0.051, 'another time|other bytes'),
    'one is late': (
        lambda each: [*each[:50], (each[50][0] + 7, each[50][1]), *each[51:]],
        0.05,
        'another time',
    ),
    'one says something else': (
        lambda each: [*each[:50], (each[50][0], each[49][1]), *each[51:]],
        0.05,
        'other bytes',
    ),
    'the rest is missing': (lambda each: each[:50], 0.05, '101 messages, now 50'),
    'all are missing': (lambda _: [], 0.0, '101 messages, now 0'),
}


@pytest.mark.parametrize('change', CHANGES)
def test_one_topic_that_differs_is_found_in_both_directions(change, tmp_path):
    function, time, what = CHANGES[change]
    found = content(simulated(tmp_path / 'bag') / 'bag_0.mcap')
    messages = {topic: found[topic.name] for topic in topics.RECORDED}
    write_mcap(tmp_path / 'one.mcap', messages, chunk_size=2000)
    changed = messages | {topics.JOINT_STATES: function(messages[topics.JOINT_STATES])}
    write_mcap(tmp_path / 'other.mcap', changed, chunk_size=2000)
    count, difference = bag_difference.compare(tmp_path / 'one.mcap', tmp_path / 'other.mcap')
    assert count == 382 and re.fullmatch(
        f'first on /joint_states at t = {time:.3f} s: ({what}); 1 topics differ', difference
    )
    assert bag_difference.compare(tmp_path / 'other.mcap', tmp_path / 'one.mcap')[1]
