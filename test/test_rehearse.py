"""The rehearsal of a first power-up: findings of made runs, and the drill on real nodes."""

from types import SimpleNamespace

import numpy as np
import pytest
from bags import streams, write_foreign
from geometry import PAPER_START, legs

from parallel_robot.bags.history import ControllerStatus
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import rehearse
from parallel_robot.cli.commands.rehearse import Finding, fault_between, motors_braked

pytest_plugins = ['ros_fixtures']


@pytest.fixture(scope='module')
def log(tmp_path_factory, robot):
    """A second in which the motors brake up to 0.5 s, and then drive."""
    bag = tmp_path_factory.mktemp('drill') / 'bag'
    t = np.arange(1000)[:, np.newaxis] * 1e-3
    path = PAPER_START + np.hstack([0.01 * np.sin(t), 0 * t, 0 * t])
    position = legs(robot, path)[0]
    velocity = np.gradient(position, 1e-3, axis=0)
    effort = np.where(t < 0.5, -20.0, 20.0) * velocity
    write_foreign(bag, streams(position, position, effort))
    read = recording.read(bag).log
    return read._replace(velocity=velocity[: len(read.time)])  # of which such bags have none


def statuses(log, *pairs):
    return [ControllerStatus(log.start_stamp + round(1e9 * t), 'smc', f, '', ()) for t, f in pairs]


def test_motors_that_brake_are_told_from_those_that_drive(log):
    assert motors_braked(log, 0.1, 0.4).holds
    driven = motors_braked(log, 0.1, 0.9)
    assert not driven.holds and 'the motors drove' in driven.text
    assert not motors_braked(log, 5.0, 6.0).holds


def test_noise_beside_the_torque_of_gravity_is_no_drive(log):
    random = np.random.default_rng(1)
    shape = log.velocity.shape
    for effort in (0.0, 2.0, 40.0):  # N m
        for at_rest in (1e-4, 1e-2):  # rad/s
            held = effort + random.normal(scale=1e-2 * effort, size=shape)
            still = random.normal(scale=at_rest, size=shape)
            drill = log._replace(effort=held, velocity=still)
            assert motors_braked(drill, 0.1, 0.9).holds
            lifts = drill._replace(velocity=still + 0.2 * at_rest)
            assert motors_braked(lifts, 0.1, 0.9).holds == (effort == 0.0)


@pytest.mark.parametrize(
    ('pairs', 'holds', 'text'),
    [
        ([(0.0, ''), (0.2, 'speed'), (0.4, '')], True, 'speed at t = 0.20 s, cleared at 0.40 s'),
        ([(0.0, ''), (0.2, 'speed')], False, 'speed was not cleared'),
        ([(0.0, ''), (0.2, 'emergency_stop')], False, 'no fault speed, but emergency_stop'),
        ([(0.0, ''), (0.8, 'speed')], False, 'no fault speed'),
    ],
)
def test_a_fault_must_come_and_go_in_its_time(pairs, holds, text, log):
    pairs = [(t, fault or 'none') for t, fault in pairs]
    found = fault_between(log, statuses(log, *pairs), 'speed', 0.1, 0.5)
    assert (found.holds, found.text) == (holds, text)


def test_the_simulated_robot_is_another_one_than_is_assumed(robot):
    base = rehearse.base_of('paper_circle', {'true_robot.m1': 4.0, 'seed': 3})
    assert base['true_robot.m1'] == 4.0 and base['seed'] == 3
    assert base['true_robot.m2'] == 1.15 * robot.m2 and base['true_robot.l1'] == robot.l1
    assert base['sensor.position_noise'] > 0
    noisy = rehearse.base_of('paper_circle', {'sensor.velocity_noise': 0.01})
    assert 'sensor.position_noise' not in noisy


@pytest.mark.endurance
def test_the_drill_on_real_nodes(launch, domain, tmp_path):
    words = ('rehearse', '--only', 'drill', '--out', 'drill')
    process = launch('parallel_robot.cli.command_line', *words)
    assert process.wait() == 0, (process.stdout, process.stderr)
    lines = process.stdout.splitlines()
    assert sum(line.startswith('  ok') for line in lines) == 5
    assert {path.name for path in (tmp_path / 'drill').iterdir()} == {'2_drill'}


@pytest.mark.parametrize('holds', [True, False])
def test_a_finding_that_fails_is_told_by_the_exit_code(holds, tmp_path, monkeypatch, capsys):
    ended = SimpleNamespace(signal=0, driven_out=False)
    monkeypatch.setattr(rehearse.run, 'move', lambda *_: ended)
    found = [Finding(True, 'the first'), Finding(holds, 'the second'), Finding(True, 'the third')]
    monkeypatch.setattr(rehearse, 'findings', lambda *_: found)
    words = ('rehearse', '--only', 'drill', '--out', str(tmp_path / 'out'))
    assert main(words) == (0 if holds else 1)
    failed = [line.split() for line in capsys.readouterr().out.splitlines() if 'FAILED' in line]
    assert failed == ([] if holds else [['FAILED', 'the', 'second']])


def test_wrong_words_are_refused_before_anything_moves(tmp_path, capsys):
    out = tmp_path / 'out'
    for words, text in (
        (['nowhere'], "unknown scenario 'nowhere'"),
        (['--set', 'plant.substeps=0'], 'plant.substeps'),
        (['--set', 'law=nothing'], "unknown law 'nothing'"),
    ):
        assert main(['rehearse', *words, '--out', str(out)]) == 2
        err = capsys.readouterr().err
        assert text in err and err.count('\n') == 1
    assert not out.exists()
