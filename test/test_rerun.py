"""The experiment once more, from the bag alone."""

import shutil
from pathlib import Path

import pytest
from bags import content
from test_replay import live, switch

from parallel_robot_analysis.bags import experiment, history, run_log
from parallel_robot_analysis.bags.bag_writer import BagWriter
from parallel_robot_analysis.command_line import main
from parallel_robot_analysis.commands import rerun
from parallel_robot_analysis.recorder import Recorder
from parallel_robot_control import faults
from parallel_robot_interface import config, topics
from parallel_robot_interface.loop import LoopParameters

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
    assert run_log.read(again).config == run_log.read(bag).config


def test_a_law_of_ones_own_comes_from_the_bag(tmp_path, capsys):
    law = tmp_path / 'elsewhere' / 'my_law.py'
    law.parent.mkdir()
    shutil.copy(EXAMPLE, law)
    words = ['--set', f'own_laws=[{law}]', '--law', 'my_law', '--set', 'my_law.Kp=700']
    bag = simulated(tmp_path / 'bag', *words)
    assert history.read(bag).laws == {'my_law': EXAMPLE.read_bytes()}
    law.unlink()
    assert main(['rerun', str(bag), '--out', str(tmp_path / 'again')]) == 0
    assert main(['replay', str(bag)]) == 0
    out, err = capsys.readouterr()
    assert 'identical: 382 messages' in out and 'identical: 101 commands' in out
    assert 'runs the code of my_law' in err
    assert history.read(tmp_path / 'again').laws == history.read(bag).laws


def test_what_differs_first_is_said(tmp_path):
    one, other = simulated(tmp_path / 'one'), simulated(tmp_path / 'other', '--law', 'smc')
    assert rerun.compare(one, one) == (382, '')
    _, difference = rerun.compare(one, other)
    assert 'at t = 0.000 s: other bytes' in difference and difference.startswith('first on /')
    longer = tmp_path / 'longer'
    assert main(['simulate', 'paper_circle', '--duration', '0.2', '--out', str(longer)]) == 0
    assert 'at t = 0.101 s: 101 messages, now 201' in rerun.compare(one, longer)[1]


def test_a_bag_of_another_version_and_a_difference(tmp_path, capsys, monkeypatch):
    bag = simulated(tmp_path / 'bag')
    monkeypatch.setattr(rerun, 'software', lambda: {'version': '9.9.9'})
    monkeypatch.setattr(rerun, 'compare', lambda *_: (3, 'first on /pose'))
    assert main(['rerun', str(bag)]) == 1
    out, err = capsys.readouterr()
    assert 'differs: first on /pose' in out
    assert err.startswith('warning: the bag was made by version ') and err.count('\n') == 1
    assert err.endswith('this is version 9.9.9\n')


def test_changes_during_the_run_are_not_repeated(tmp_path):
    bag = live(
        tmp_path / 'bag',
        {50: switch(law='pid'), 90: lambda controller: controller.trip(faults.EMERGENCY_STOP)},
    )
    log, past = run_log.read(bag), history.read(bag)
    assert '2 changes of law' in rerun.doubts(log.config, past)[-1]
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


def test_a_bag_says_what_made_it(tmp_path):
    facts = history.read(simulated(tmp_path / 'bag')).facts
    assert facts['source'] == 'simulation' and facts['randomness'] == 'none'
    assert 'numpy' in facts['libraries'] and facts['python'].count('.') == 2
    assert facts['command_line'] == experiment.command_line()


def test_the_revision_is_that_of_a_working_copy_only(tmp_path, monkeypatch):
    assert experiment._revision(tmp_path) == ''
    (tmp_path / '.git').mkdir()
    assert experiment._revision(tmp_path) == ''  # not a working copy after all
    monkeypatch.setenv('PATH', '')
    assert experiment._revision(tmp_path) == ''


@pytest.mark.parametrize('early', [False, True])
def test_the_recorder_notes_parameters_and_their_changes(early, tmp_path):
    values = config.resolve('paper_circle', {'time_mode': 'lockstep', 'duration': 0.1})
    loop = config.group(values, LoopParameters, '')
    recorder = Recorder(tmp_path / 'bag', loop, values, pytest.fail)
    if not early:
        recorder.open(10**9)
    recorder.found('/controller', {'law': 'pid', 'pid.Kp': 3.0, 'joints': ['a', 'b']})
    recorder.changed('/controller', {'law': 'smc'})
    if early:
        recorder.open(10**9)
    recorder.close()
    past = history.read(tmp_path / 'bag')
    assert past.parameters == {'/controller': {'law': 'pid', 'pid.Kp': 3.0, 'joints': ['a', 'b']}}
    stamp = 0 if early else 10**9
    assert past.changes == (history.Change(stamp, '/controller', {'law': 'smc'}),)
    assert past.facts['source'] == 'nodes'
