"""A robot that is driven out of its workspace ends its run early, with a bag that can be read."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from bags import MS
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from test_replay import START, live

from parallel_robot.bags.experiment import describe
from parallel_robot.bags.output import Progress
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import run
from parallel_robot.cli.ros_session import Session
from parallel_robot_model.common.errors import DRIVEN_OUT, RunError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.nodes.background import OUTSIDE, STATE_INDEX

END = 201  # states inside the workspace


def diagnostics(node, **values):
    items = [KeyValue(key=key, value=value) for key, value in values.items()]
    status = DiagnosticStatus(
        level=DiagnosticStatus.ERROR, name=f'{node}: loop', message=DRIVEN_OUT, hardware_id=node
    )
    status.values = items
    return DiagnosticArray(status=[status])


@pytest.mark.parametrize(
    ('node', 'outside', 'driven_out'),
    [
        ('/left/plant', 'True', True),
        ('/left/plant', 'False', False),  # whatever its text says
        ('/left/plant', 'perhaps', False),
        ('/plant', 'True', False),  # of another robot
        ('/left/controller', 'True', False),
    ],
)
def test_the_session_hears_it_from_the_plant(node, outside, driven_out):
    session = Session([], lambda: None, '/left')
    session.take_diagnostics(diagnostics(node, **{OUTSIDE: outside, STATE_INDEX: '7'}))
    assert session.driven_out == driven_out
    assert session.state == (7 if node == '/left/plant' else -1)
    session.take_diagnostics(diagnostics('/left/plant', **{OUTSIDE: 'False'}))
    assert session.driven_out == driven_out  # it has been, though it was put back


def test_a_motion_that_stands_still_is_told_with_what_the_nodes_say(monkeypatch):
    monkeypatch.setattr(run, 'STANDSTILL', 0.0)
    session = Session(['plant'], lambda: None)
    status = diagnostics('/plant', **{STATE_INDEX: '7'})
    status.status[0].level, status.status[0].message = DiagnosticStatus.ERROR, 'no \x1b[2Jcommand'
    session.spin = lambda _: session.take_diagnostics(status)
    session.silent = lambda _: []
    processes = SimpleNamespace(running=lambda _: True, check=pytest.fail)
    with pytest.raises(RunError, match=r'at state 7 of 12000: plant: no .*command$') as raised:
        run.follow(processes, session, 12_000, 12.0, Progress(12.0, 's'))
    assert '\x1b' not in str(raised.value)


def test_the_run_does_not_wait_for_the_rest_of_the_motion():
    session = SimpleNamespace(state=0, driven_out=False, spins=0, alarms={})

    def spin(_):
        session.spins += 1
        session.state, session.driven_out = session.spins, session.spins == 3

    session.spin = spin
    processes = SimpleNamespace(running=lambda _: True, check=pytest.fail)
    run.follow(processes, session, 12_000, 12.0, Progress(12.0, 's'))
    assert session.spins == 3


@pytest.mark.parametrize('states', [0, 1, 2])
def test_a_run_that_is_stopped_at_its_start_says_so(states, tmp_path, monkeypatch, capsys):
    bag = tmp_path / 'bag'

    def stopped(*_):
        values = config.resolve('paper_circle', {'duration': 0.4})
        facts = describe(group(values, LoopParameters, ''), values, START)
        with BagWriter(bag, topics.RECORDED, facts) as writer:
            for k in range(states):
                one, stamp = np.full(3, 0.1), START + k * MS
                layout = layouts.joint_state(('joint1', 'joint2', 'joint3'))
                writer.write('joint_states', stamp, layout.encode(stamp, position=one))
                layout = layouts.joint_trajectory(('joint1', 'joint2', 'joint3'))
                writer.write('reference', stamp, layout.encode(stamp, position=one))
                command = layouts.float64_multi_array(3).encode(data=one)
                writer.write('effort_controller/commands', stamp, command)
        return run.End(signal=2)

    monkeypatch.setattr(run, '_supervise', stopped)
    assert main(['run', 'paper_circle', '--duration', '0.4', '--out', str(bag)]) == 130
    out, err = capsys.readouterr()
    assert 'stopped by SIGINT' in out + err and 'Traceback' not in err
    assert bag.is_dir()


@pytest.fixture
def driven_out(tmp_path):
    """Make a bag whose last states are out of reach."""

    def make(directory):
        live(tmp_path / 'whole', {})
        log = recording.read(tmp_path / 'whole').log
        values = config.resolve('paper_circle', {'duration': 0.4})
        facts = describe(group(values, LoopParameters, ''), values, START)
        position = log.position[: END + 30].copy()
        position[END:] += np.linspace(0.3, 1.5, 30)[:, np.newaxis] * [1.0, -1.0, 0.0]
        states, references = (
            layouts.joint_state(log.joints),
            layouts.joint_trajectory(log.joints),
        )
        with BagWriter(directory, topics.RECORDED, facts) as bag:
            for k, row in enumerate(position):
                stamp = START + k * MS
                desired = log.reference_position[k]
                bag.write('joint_states', stamp, states.encode(stamp, position=row))
                bag.write('reference', stamp, references.encode(stamp, position=desired))
                command = layouts.float64_multi_array(3).encode(data=log.command[k])
                bag.write('effort_controller/commands', stamp, command)
        return directory

    return make


def test_analyze_evaluates_up_to_there(driven_out, tmp_path, capsys):
    bag = driven_out(tmp_path / 'bag')
    assert main(['analyze', str(bag), '--json', str(tmp_path / 'run.json')]) == 0
    out, err = capsys.readouterr()
    assert 'warning: evaluated up to t = 0.2' in err and 'forward kinematics' in err
    found = json.loads((tmp_path / 'run.json').read_text())
    assert 0.2 <= found['duration_s'] < 0.23 and f'{found["duration_s"]:g} s of 0.4 s' in out


def test_run_keeps_the_bag_and_says_when(driven_out, tmp_path, monkeypatch, capsys):
    bag = tmp_path / 'bag'
    monkeypatch.setattr(run, '_supervise', lambda *_: run.End(bool(driven_out(bag))))
    assert main(['run', 'paper_circle', '--duration', '0.4', '--out', str(bag)]) == 1
    out, err = capsys.readouterr()
    assert f'{DRIVEN_OUT} at t = 0.230 s' in err.splitlines()[-1]
    assert ' s of 0.4 s; errors' in out and 'end-effector error, rms' in out
    assert f'bag     {bag}\nnext    parallel_robot analyze {bag}\n' in out
    assert len(recording.read(bag).log.time) == END + 30


def test_run_ends_with_the_figures_of_analyze(tmp_path, monkeypatch, capsys):
    bag = tmp_path / 'bag'
    monkeypatch.setattr(run, '_supervise', lambda *_: live(bag, {}) and run.End())
    assert main(['run', 'paper_circle', '--duration', '0.4', '--out', str(bag)]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[-2:] == [f'bag     {bag}', f'next    parallel_robot analyze {bag}']
    assert main(['analyze', str(bag)]) == 0
    table = capsys.readouterr().out.splitlines()
    (head,) = (k for k, line in enumerate(out) if 'errors over the second half' in line)
    assert out[head] in table  # what the figures are of
    figures = [' '.join(line.split()) for line in table]
    for merit in '; '.join(out[head + 1 : -2]).split('; '):
        assert merit.strip() in figures


@pytest.mark.usefixtures('page_alone')
def test_a_report_evaluates_up_to_there(driven_out, tmp_path):
    bag = driven_out(tmp_path / 'bag')
    assert main(['report', str(bag), '--out', str(tmp_path / 'report')]) == 0
    assert 'is evaluated up to t = 0.2' in (tmp_path / 'report' / 'report.html').read_text()
