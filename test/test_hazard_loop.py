"""Hazards in the loop: the same bytes without ROS and in lockstep, and what they do."""

import numpy as np
import pytest
from assembly import simulated
from bags import content
from replay_parts import assert_same_in_parts

from parallel_robot.analysis.replay import replayed
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import configure, resolve
from parallel_robot_control.controller import Controller
from parallel_robot_control.safety import faults
from parallel_robot_model.configuration.hazards import KINDS
from parallel_robot_model.configuration.loop import STEP_START
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import PlantRun, Simulator
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.messages import reference_messages

SAID = {
    'joint': 'joint joint2 ', 'limit': 'limit 0.4 ', 'delay': 'delay 0.012 ', 'size': 'size 0.05 ',
    'share': 'share 0.4 ',
}  # fmt: skip


def typed(what, at=0.1, lasts=0.05):
    """A hazard of a kind, with whatever it needs."""
    words = KINDS[what].words
    extra = ''.join(text for word, text in SAID.items() if word in words)
    return f'{what} {extra}at {at}' + (f' for {lasts}' if 'for' in words else '')


def values_of(*hazards, duration=0.4, **changed):
    changed = {key.replace('__', '.'): value for key, value in changed.items()}
    given = {'duration': duration, 'time_mode': 'lockstep', 'hazards': [*hazards]}
    given['plant.publish_passive'] = False
    return resolve('paper_circle', {**given, **changed})


def in_lockstep(values):
    """States, commands, and fault with stamp of each answer, of a plant and a controller."""
    configuration = configure_plant(values)
    loop = configuration.loop
    controller = Controller(configure(values))
    plant = PlantRun(lambda: Simulator(configuration), loop, lambda: None, lambda: None)
    count = loop.last_index + 1
    stamps = STEP_START + np.arange(count) * loop.period_ns
    samples = trajectory_of(values).sample(np.arange(count) * loop.period)
    for record in reference_messages(loop.joints, stamps, samples):
        assert controller.read_reference(record.tobytes())
    states, commands, found = [], [], []
    torque = np.zeros(len(loop.joints))
    assert not plant.poll(True, 10**10) and plant.poll(True, 10**10)
    there = True
    while there:
        there = False
        if plant.simulator.reception.published:
            states.append(plant.message)
            if controller.answer(plant.message) > 0:
                commands.append(controller.command)
                found.append((controller.applied_stamp, controller.fault))
                assert plant.simulator.read(controller.command, torque)
                there = plant.take_command(torque)
        there = there or plant.step_unanswered()
    assert plant.finished
    return states, commands, found


def in_bag(values, bag):
    simulation_bag.write(bag, values, [simulated(values)])
    topics = content(next(bag.glob('*.mcap')))
    return [
        [data for _, data in topics[name]]
        for name in ('joint_states', 'effort_controller/commands')
    ]


def assert_same(values, tmp_path):
    """The bag of a simulation has the bytes of the loop in lockstep, and replays; its faults."""
    states, commands, found = in_lockstep(values)
    expected = in_bag(values, tmp_path / 'bag')
    assert [len(states), len(commands)] == [*map(len, expected)]
    assert states == expected[0]
    assert commands == expected[1]
    log, past, _ = recording.read(tmp_path / 'bag')
    again = replayed.again(log, past, configure(log.config))
    assert not again.differing.any() and again.known.sum() == len(commands)
    assert_same_in_parts(again, log, past, configure(log.config))
    return [fault for _, fault in found]


@pytest.mark.parametrize('what', sorted({*KINDS} - {'clear_fault'}))
def test_every_kind_is_the_same_in_lockstep(what, tmp_path):
    assert_same(values_of(typed(what)), tmp_path)


COMBINED = {
    'from the start on': ['states_lost at 0.0 for 0.03'],
    'one in the other': ['states_late delay 0.01 at 0.1 for 0.1', typed('encoder_frozen', 0.15)],
    'one after the other': ['references_lost at 0.1 for 0.05', 'references_lost at 0.12 for 0.1'],
    'lost on both ways': ['commands_lost at 0.1 for 0.1', 'states_lost at 0.15 for 0.1'],
    'a stranger while commands are lost': [
        'commands_lost at 0.1 for 0.1', 'stranger size 0.5 at 0.12 for 0.03'
    ],
    'at the end': ['controller_paused at 0.35 for 1.0'],
    'to the last state': ['commands_lost at 0.3 for 0.1'],
}  # fmt: skip


@pytest.mark.parametrize('case', COMBINED)
def test_several_are_the_same_in_lockstep(case, tmp_path):
    assert_same(values_of(*COMBINED[case]), tmp_path)


@pytest.mark.parametrize(
    'changed',
    [
        {'law': 'observer_s_fotsmc', 'sensor.delay': 0.002, 'seed': 3, 'actuator.delay': 0.003},
        {'law': 'lqg_tracking', 'sensor.position_noise': 1e-5, 'period': 0.002},
        {'law': 'pid', 'estimator.kind': 'levant', 'sensor.differentiate': True},
    ],
)
def test_hazards_and_imperfections_are_the_same_in_lockstep(changed, tmp_path):
    values = values_of(typed('states_lost'), typed('motors_clipped', 0.3), **changed)
    assert_same(values, tmp_path)


def test_a_gap_of_the_states_is_a_fault_that_can_be_cleared(tmp_path):
    values = values_of('states_lost at 1.0 for 0.7', 'clear_fault at 2.0', duration=2.2)
    found = assert_same(values, tmp_path)
    assert found == [faults.NONE] * 1000 + [faults.STATES_STALE] * 300 + [faults.NONE] * 201


def test_a_shorter_gap_is_none(tmp_path):
    found = assert_same(values_of('states_lost at 1.0 for 0.4', duration=1.6), tmp_path)
    assert set(found) == {faults.NONE}


def test_references_that_stay_away_are_a_fault_as_long_as_they_do(tmp_path):
    said = ['references_lost at 1.0 for 0.8', 'clear_fault at 1.6', 'clear_fault at 1.9']
    found = assert_same(values_of(*said, duration=2.0), tmp_path)
    stale = found.index(faults.REFERENCE_STALE)
    assert stale == 999 + 501  # the newest one is that of 0.999 s, and 0.5 s old is not too old
    assert found[1600:1900] == [faults.REFERENCE_STALE] * 300
    assert found[1900:] == [faults.NONE] * 101


LOST = {
    'states_late delay 0.05 at 1.0 for 0.3': (faults.STATES_LATE, 1050),
    'states_ahead size 0.3 at 1.0 for 0.3': (faults.STATES_AHEAD, 1000),
    'velocity_nan joint joint1 at 1.0 for 0.3': (faults.STATES_INVALID, 1000),
}


@pytest.mark.parametrize('said', LOST)
def test_states_that_are_refused_for_long_are_a_fault(said, tmp_path):
    values = values_of(said, 'clear_fault at 1.2', 'clear_fault at 1.35', duration=1.5)
    found = assert_same(values, tmp_path)
    fault, begin = LOST[said]
    assert found == [faults.NONE] * 1000 + [fault] * 50 + [faults.NONE] * 151
    run = simulated(values).run
    assert int(np.flatnonzero(run.fault)[0]) == begin + 101  # 0.1 s is borne
    statuses = recording.read(tmp_path / 'bag').history.statuses
    assert [status.fault for status in statuses][-1] == 'none'


def test_states_that_are_a_little_late_are_answered(tmp_path):
    found = assert_same(values_of('states_late delay 0.01 at 1.0 for 0.3', duration=1.5), tmp_path)
    assert len(found) == 1501 - 10 and set(found) == {faults.NONE}


def test_a_new_controller_knows_of_no_fault(tmp_path):
    said = ['states_lost at 1.0 for 0.6', 'controller_restarted at 1.8 for 0.1']
    found = assert_same(values_of(*said, duration=2.0), tmp_path)
    assert found[1000:1200] == [faults.STATES_STALE] * 200
    assert set(found[1200:]) == {faults.NONE}


def run_of(*hazards, **changed):
    return simulated(values_of(*hazards, **changed)).run


def test_motors_hold_the_last_command_and_then_damp():
    lost = 'commands_lost at 0.3 for 0.4'
    run = run_of(lost, duration=0.8, plant__timeout_action='zero')
    assert (run.effort[300:500] == run.command[299]).all()  # 0.2 s
    assert (run.effort[500:701] == 0.0).all()
    assert (run.effort[701:] == run.command[700:-1]).all()
    damped = run_of(lost, duration=0.8, safety__damping=2.0)
    assert np.allclose(damped.effort[500:701], -2.0 * damped.velocity[499:700], atol=1e-12)


def test_torques_are_what_the_motors_can_give():
    off = run_of('motors_off at 0.1 for 0.1').effort
    assert (off[101:201] == 0.0).all() and off[100].all() and off[201].all()
    dead = run_of('motor_dead joint joint2 at 0.1 for 0.1').effort
    assert (dead[101:201, 1] == 0.0).all() and dead[101:201, [0, 2]].all()
    clipped = run_of('motors_clipped limit 0.4 at 0.1 for 0.1')
    expected = np.clip(clipped.command[100:200], -0.4, 0.4)
    assert (clipped.effort[101:201] == expected).all()
    other = run_of('stranger size 0.5 at 0.1 for 0.1')
    assert (other.effort[101:201] == 0.5).all()


def test_brakes_hold_the_robot():
    run = run_of('brakes at 0.1 for 0.1')
    assert (run.joints[101:201] == run.joints[100]).all()
    assert (run.effort[101:201] == 0.0).all() and (run.velocity[101:201] == 0.0).all()
    assert (run.joints[201] != run.joints[200]).all()


def test_states_say_what_the_hazard_says():
    plain = run_of()
    frozen = run_of('states_frozen at 0.1 for 0.1')
    assert (frozen.position[100:200] == plain.position[100]).all()
    assert (frozen.velocity[100:200] == plain.velocity[100]).all()
    assert (frozen.joints[110] != frozen.joints[100]).all()
    encoder = run_of('encoder_frozen joint joint2 at 0.1 for 0.1')
    assert (encoder.position[100:200, 1] == plain.position[100, 1]).all()
    assert (encoder.velocity[100:200, 1] == 0.0).all() and encoder.velocity[100:200, 0].all()
    jump = run_of('encoder_jump joint joint1 size 0.005 at 0.1 for 0.1')
    assert np.allclose((jump.position - jump.joints)[100:200], [0.005, 0.0, 0.0], atol=1e-15)
    assert (jump.position == jump.joints)[:100].all() and (jump.position == jump.joints)[
        200:
    ].all()
    late = run_of('states_late delay 0.02 at 0.1 for 0.1')
    assert (late.position[120:200] == late.joints[100:180]).all()
    assert np.isnan(late.command[100:120]).all() and np.isfinite(late.command[120:]).all()


def test_a_link_that_is_down_leaves_the_true_robot_moving(tmp_path):
    values = values_of('plant_paused at 0.1 for 0.1')
    made = simulated(values)
    assert np.abs(np.diff(made.run.joints[100:200], axis=0)).max() > 0.0
    simulation_bag.write(tmp_path / 'bag', values, [made])
    stamps = recording.read(tmp_path / 'bag').log.stamps
    assert np.diff(stamps).max() == 101 * 10**6 and len(stamps) == 301
    poses = content(next((tmp_path / 'bag').glob('*.mcap')))['pose']
    assert len(poses) == 31


def test_a_run_without_hazards_does_not_look_at_them():
    plain, later = run_of(), run_of('commands_lost at 5.0 for 1.0')
    for name in ('pose', 'position', 'velocity', 'effort', 'command', 'fault', 'active_limits'):
        assert np.array_equal(getattr(plain, name), getattr(later, name))


def test_a_refusal_to_clear_is_told_with_its_reason_by_the_run_and_its_bag(tmp_path, capsys):
    hazards = '[motors_off at 0.3 for 0.8, clear_fault at 1.2]'
    out = tmp_path / 'bag'
    words = ['serial_2r_circle', '--set', f'hazards={hazards}', '--duration', '1.5']
    assert main(['simulate', *words, '--out', str(out)]) == 1
    line = 'not cleared at t = 1.200 s: the elbow has folded to the other side'
    assert f'warning: {line}\n' in capsys.readouterr().err
    assert main(['analyze', str(out), '--to', '0.2']) == 0
    assert line in capsys.readouterr().out
