"""Torques computed again from a bag: the recorded ones, bit for bit, or those of another law."""

from pathlib import Path

import numpy as np
import pandas
import pytest
from assembly import simulated as simulate
from bags import content, streams, write_foreign
from rclpy.serialization import deserialize_message
from replay_parts import assert_same_in_parts
from sensor_msgs.msg import JointState

import parallel_robot as pr
from parallel_robot.analysis import timing
from parallel_robot.analysis.replay import replayed
from parallel_robot.bags import history, indexed_reader
from parallel_robot.bags.experiment import describe
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import rehearse
from parallel_robot_control.answer_kernel import LOG
from parallel_robot_control.configuration import configure, resolve
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_control.messages import status_message
from parallel_robot_control.safety import faults
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import STEP_START, LoopParameters
from parallel_robot_model.messages import layouts, topics
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.messages import reference_messages

EXAMPLE = Path(__file__).parents[1] / 'docs' / 'example_law.py'
START = 1_700_000_000 * 10**9  # ns
MS = 10**6  # ns
N = 400


@pytest.fixture
def simulated(tmp_path):
    """Make the bag of a simulation of 0.3 s."""

    def make(**changed):
        changed = {key.replace('__', '.'): value for key, value in changed.items()}
        values = resolve('paper_circle', {'duration': 0.3, 'time_mode': 'lockstep', **changed})
        simulation_bag.write(tmp_path / 'bag', values, [simulate(values)])
        return tmp_path / 'bag'

    return make


def again(bag):
    """The torques of a bag; those of its parts, whatever they are, are the same."""
    log, past, _ = recording.read(bag)
    whole = replayed.again(log, past, configure(log.config))
    assert_same_in_parts(whole, log, past, configure(log.config))
    return whole


@pytest.mark.parametrize(
    'law', ['s_fotsmc', 'pid', 'nftsmc', 'adaptive_s_fotsmc', 'observer_s_fotsmc']
)
def test_a_simulation_is_replayed_bit_for_bit(law, simulated, capsys):
    bag = simulated(law=law)
    assert main(['replay', str(bag), '--trust']) == 0
    assert 'identical: 301 commands' in capsys.readouterr().out


def test_old_states_are_replayed_bit_for_bit(simulated):
    old = {'sensor__stamp': 'measured', 'sensor__delay': 0.004, 'approach__duration': 0.1}
    bag = simulated(law='lqg_tracking', sensor__position_noise=1e-5, seed=2, **old)
    log, found = recording.read(bag).log, again(bag)
    assert log.stamps[0] == STEP_START - 4 * MS and len(log.stamps) == 301
    assert found.known.all() and not found.differing.any() and found.late == 0


def test_limits_and_faults_are_replayed(simulated):
    bag = simulated(safety__torque_limit=[3.0, 3.0, 3.0], safety__speed_limit=[0.05, 9.0, 9.0])
    said = recording.read(bag).history.statuses
    assert said[0].fault == 'none' and said[-1].fault != 'none'
    assert not again(bag).differing.any()


def live(directory, script, common=True, skipped=(), says=True, since=0, given=()):
    """Write the bag of a controller in real time, to which things happen.

    `script` maps a state to a function of the controller, called before that state; or to a number
    of milliseconds by which references are late from that state on. States that are `skipped` are
    not answered. A bag of an older version does not say which are; nor had its statuses codes.
    The recorder comes at the state `since`. `given` are parameters.
    """
    changed = {'duration': N * 1e-3, 'safety.state_timeout': 5.0, **dict(given)}
    changed['safety.reference_timeout'] = 0.05
    changed['start_stamp'] = -1 if common else 0
    values = config.resolve('paper_circle', changed)
    loop = group(values, LoopParameters, '')
    controller, plant = Controller(configure(values)), Simulator(configure_plant(values))
    stamps = START + np.arange(N + 1) * MS
    reference = trajectory_of(values).sample(np.arange(N + 1) * 1e-3)
    records = reference_messages(loop.joints, stamps, reference)
    if common:
        controller.set_start(START)
    status, known, late, torque = None, 0, -5, np.zeros(3)
    with BagWriter(directory, topics.RECORDED, describe(loop, values, START * common)) as bag:

        def write(name, stamp, data):
            if stamp >= START + since * MS:
                bag.write(name, stamp, data)

        def command(data, stamp):
            write('effort_controller/commands', stamp + 1000, data)

        def tell(stamp):
            if says:
                write('controller/answered', stamp + 2000, controller.log.take())

        for k, stamp in enumerate(stamps.tolist()):
            act = script.get(k)
            late = act if isinstance(act, int) else late
            if callable(act) and act(controller) is ZERO:
                command(controller.log.zero_command(), stamp - MS // 2)
            while known <= min(k - late, N):
                row = JointReference(
                    reference.position[known],
                    reference.velocity[known],
                    reference.acceleration[known],
                )
                controller.add_reference(int(stamps[known]), row)
                write('reference', stamp, records[known].tobytes())
                known += 1
            write('joint_states', stamp, plant.message(stamp))
            if k not in skipped:
                measured = plant.measurement()
                state = measured.position, measured.velocity, plant.state.torque
                assert controller.add_state(stamp, state)
                torque = controller.torque
                if controller.status != status:
                    status = controller.status
                    write('controller/status', stamp, status_message(stamp, status))
                command(controller.command, stamp)
                if controller.code & LOG:
                    tell(stamp)
            plant.advance(torque)
        if k in skipped or not controller.code & LOG:
            tell(stamp)
    return directory


ZERO = object()  # what a function of the controller returns when a zero command is due


def lose(controller):
    controller.lose(faults.STATES_STALE)
    return ZERO


def switch(**changes):
    changes = {key.replace('__', '.'): value for key, value in changes.items()}
    return lambda controller: controller.apply(controller.prepare_change(changes))


def test_switches_and_faults_of_a_live_run_are_replayed(tmp_path):
    bag = live(
        tmp_path / 'bag',
        {
            50: switch(law='pid'),
            120: lambda controller: controller.trip(faults.EMERGENCY_STOP),
            180: lambda controller: controller.clear_fault(),
            230: switch(law='s_fotsmc'),
        },
    )
    log, found = recording.read(bag).log, again(bag)
    assert found.known.all() and not found.differing.any() and found.late == 0
    assert np.array_equal(found.torque, log.command)
    laws = [said.law for said in recording.read(bag).history.statuses]
    assert set(laws) == {'s_fotsmc', 'pid'}


LEARNING = {
    'circle.radius': 0.001, 'circle.rate': 20.0 * np.pi, 'repetition.gain': 0.5,
    'repetition.cutoff': 50.0, 'repetition.wait': 0.02,
}  # fmt: skip


def test_what_was_learned_from_turn_to_turn_is_replayed(tmp_path):
    script = {
        230: switch(law='lqg_tracking'),
        290: lambda controller: controller.trip(faults.EMERGENCY_STOP),
        320: lambda controller: controller.clear_fault(),
    }
    bag = live(tmp_path / 'bag', script, given=LEARNING)
    log, past, _ = recording.read(bag)
    found = again(bag)
    assert found.known.all() and not found.differing.any()
    configuration = configure({**log.config, 'repetition.gain': 0.0})
    assert replayed.again(log, past, configuration).differing[:230].any()


def test_a_pose_that_was_told_is_replayed(tmp_path):
    """Another assembly mode, so that the law computes with another model from there on."""

    def tell(controller):
        position, pose = controller.state.position, controller.state.pose
        modes = controller._modes.all(np.array(position), np.array(pose))
        controller.set_pose(modes[1])

    script = {
        120: lambda controller: controller.trip(faults.EMERGENCY_STOP),
        150: tell,
        180: lambda controller: controller.clear_fault(),
    }
    bag = live(tmp_path / 'bag', script)
    log, past, _ = recording.read(bag)
    found = again(bag)
    assert found.known.all() and not found.differing.any()
    untold = tuple(said._replace(pose=()) for said in past.statuses)
    without = replayed.again(log, past._replace(statuses=untold), configure(log.config))
    assert without.differing[185:].any()


def test_a_filter_that_begins_and_ends_with_its_law_is_replayed(tmp_path):
    """Guesses from which state on a change acted must not leave traces in its memory."""
    bag = live(
        tmp_path / 'bag',
        {
            50: switch(law='observer_s_fotsmc'),
            110: switch(observer_s_fotsmc__Gamma1=150.0),
            170: switch(law='pid'),
            173: switch(law='lqg_tracking'),
            240: lambda controller: controller.trip(faults.EMERGENCY_STOP),
            260: lambda controller: controller.clear_fault(),
        },
    )
    log, past, _ = recording.read(bag)
    change = {'observer_s_fotsmc.Gamma1': 150.0, 'preset': 'custom'}
    changes = (history.Change(START + 115 * MS, '/controller', change),)
    found = replayed.again(log, past._replace(changes=changes), configure(log.config))
    assert found.known.all() and not found.differing.any()


@pytest.mark.parametrize('recorded_at', [-20, 0, 20])
def test_new_gains_act_where_they_explain_the_commands(recorded_at, tmp_path):
    bag = live(tmp_path / 'bag', {100: switch(s_fotsmc__G=20.0)})
    log, past, _ = recording.read(bag)
    stamp = START + (100 + recorded_at) * MS
    change = history.Change(stamp, '/controller', {'s_fotsmc.G': 20.0, 'preset': 'custom'})
    found = replayed.again(log, past._replace(changes=(change,)), configure(log.config))
    assert not found.differing.any()
    unknown = replayed.again(log, past, configure(log.config))
    assert np.flatnonzero(unknown.differing)[0] == 101  # at 100 they change only the memory


def test_new_gains_that_are_recorded_after_a_switch_of_the_law_acted_before_it(tmp_path):
    bag = live(tmp_path / 'bag', {100: switch(s_fotsmc__G=20.0), 105: switch(law='pid')})
    log, past, _ = recording.read(bag)
    values = {'s_fotsmc.G': 20.0, 'preset': 'custom'}
    change = history.Change(START + 108 * MS, '/controller', values)
    found = replayed.again(log, past._replace(changes=(change,)), configure(log.config))
    assert not found.differing.any()


@pytest.mark.parametrize('says', [True, False])
def test_references_that_came_late_are_found(says, tmp_path):
    bag = live(tmp_path / 'bag', {100: 1, 110: 0, 200: 7, 203: -5}, says=says)
    found = again(bag)
    assert not found.differing.any() and found.late == 5 + 3  # the next 5 were known


SKIPPED = {1, 2, 50, 51, N} | {*np.random.default_rng(5).choice(N, N // 4, replace=False).tolist()}


@pytest.mark.parametrize('common', [True, False])
def test_only_what_was_answered_is_answered_again(common, tmp_path, capsys):
    """A quarter of the states is skipped, references are late by up to 20 ms, things happen."""
    script = {
        30: 1, 60: 20, 75: 3, 95: -5,
        100: switch(law='pid'),
        150: lambda controller: controller.trip(faults.EMERGENCY_STOP),
        170: lambda controller: controller.clear_fault(),
        200: switch(law='adaptive_s_fotsmc'),
        250: lose,
        270: lambda controller: controller.clear_fault(),
        300: 9,
    }  # fmt: skip
    bag = live(tmp_path / 'bag', script, common, SKIPPED)
    log, found = recording.read(bag).log, again(bag)
    answered = np.isin(np.arange(N + 1), [*SKIPPED], invert=True)
    assert np.array_equal(found.known, answered) and not found.differing.any()
    assert np.array_equal(np.isnan(found.torque[:, 0]), ~answered) and found.late > 80
    assert np.count_nonzero(log.answers.states == 0) == 1  # the zero
    assert not any(topic.missing for topic in log.messages.values())
    assert main(['replay', str(bag)]) == 0
    said = capsys.readouterr().out
    assert f'identical: {answered.sum()} commands' in said
    assert f'{N + 1 - answered.sum()} states were not answered' in said
    with_late = replayed.again(
        log._replace(used=None), recording.read(bag).history, configure(log.config)
    )
    assert with_late.differing.any()  # it takes what the bag says


def test_a_reference_that_is_too_old_is_replayed(tmp_path):
    """60 ms without references: the fault begins at the state at which the last is 51 ms old."""
    bag = live(tmp_path / 'bag', {100: 60, 170: -5, 200: Controller.clear_fault}, skipped=SKIPPED)
    assert recording.read(bag).history.statuses[-2].fault == 'reference_stale'
    found = again(bag)
    assert not found.differing.any()
    log = recording.read(bag).log
    patient = config.changed(log.config, {'safety.reference_timeout': 1.0})
    other = replayed.instead(log, recording.read(bag).history, configure(patient))
    assert other.differing[152:170].any() and not other.differing[:120].any()


def test_after_half_a_second_without_answers_the_controller_begins_again(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), 'N', 700)
    bag = live(tmp_path / 'bag', {}, skipped={*range(50, 600)})
    found = again(bag)
    assert found.known.sum() == 151 and not found.differing.any()


def test_another_law_answers_the_states_that_were_answered(tmp_path):
    bag = live(tmp_path / 'bag', {100: 7}, skipped=SKIPPED)
    log, past, _ = recording.read(bag)
    same = replayed.instead(log, past, configure(log.config))
    assert same.known.sum() == N + 1 - len(SKIPPED) and not same.differing.any()
    smc = replayed.instead(log, past, configure(config.changed(log.config, {'law': 'smc'})))
    assert np.array_equal(np.isfinite(smc.torque[:, 0]), same.known) and smc.differing.any()


def test_a_controller_that_took_over_is_replayed(tmp_path):
    assert not again(live(tmp_path / 'bag', {}, common=False)).differing.any()


def test_a_bag_that_begins_while_the_law_runs_tells_nothing_of_it(tmp_path, capsys):
    bag = live(tmp_path / 'bag', {}, common=False, since=205)
    assert main(['replay', str(bag)]) == 0
    said = capsys.readouterr().out
    assert 'not compared: the bag begins while the controller ran' in said
    assert 'commands differ' in said and 'identical' not in said
    log = recording.read(bag).log
    answered = ~np.isnan(log.answer[:, 0])
    assert answered.all() and log.messages['effort_controller/commands'].missing == 0


def test_what_cannot_be_explained_is_counted(tmp_path, capsys):
    def sabotage(controller):
        controller.law.reset_memory()

    bag = live(tmp_path / 'bag', {300: sabotage})
    assert main(['replay', str(bag)]) == 1
    out = capsys.readouterr().out
    assert f'of {N + 1} commands differ, by up to' in out and 'from t = 0.300 s on' in out


def test_another_law_is_drawn_beside_the_recorded_one(simulated, capsys):
    bag = simulated()
    assert main(['replay', str(bag), '--law', 'smc']) == 0
    picture = bag / 'replay_smc.png'
    assert picture.read_bytes().startswith(b'\x89PNG')
    first = capsys.readouterr().out
    log = recording.read(bag).log
    values = config.changed(log.config, {'law': 'smc'})
    torque = replayed.instead(log, recording.read(bag).history, configure(values)).torque
    largest = np.abs(torque - log.command).max(axis=0)
    (row,) = (line.split() for line in first.splitlines() if line.split()[0] == 'max')
    assert row[1:] == [f'{value:.3f}' for value in largest]
    assert main(['replay', str(bag), '--law', 'smc']) == 2
    assert 'nothing is overwritten' in capsys.readouterr().err


def test_the_same_law_instead_gives_the_recorded_commands(simulated):
    bag = simulated(law='s_smc')
    log, past, _ = recording.read(bag)
    found = replayed.instead(log, past, configure(log.config))
    assert not found.differing.any()
    assert_same_in_parts(found, log, past, configure(log.config), obeyed=False)


def test_a_law_of_ones_own_is_replayed_and_tried(simulated, tmp_path, capsys):
    words = ['--set', f'custom_laws=[{EXAMPLE}]', '--law', 'example_law']
    words += ['--figure', str(tmp_path / 'own.pdf')]
    bag = simulated(custom_laws=[str(EXAMPLE)], law='example_law')
    assert main(['replay', str(bag), '--trust']) == 0
    assert 'identical: 301 commands' in capsys.readouterr().out
    assert main(['replay', str(bag), *words]) == 0
    assert (tmp_path / 'own.pdf').read_bytes().startswith(b'%PDF')
    maxima = capsys.readouterr().out.partition('max')[2].splitlines()[0].split()
    assert maxima == ['0.000'] * 3


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--set', 'circle.radius=1'], 'circle.radius does not change the torques'),
        (['--law', 'smd'], "unknown law 'smd'"),
        (['--set', 's_fotsmc.H=1'], "unknown parameter 's_fotsmc.H'"),
        (['--set', 's_fotsmc.G=.nan'], 's_fotsmc.G must be finite'),
        (['--law', 'smc', '--set', 'law=pid'], '--law is smc'),
        (['--law', 'smc', '--figure', 'torques.doc'], 'unknown picture format'),
        (['--law', 'smc', '--figure', '/dev/null/torques.png'], 'cannot write'),
    ],
)
def test_bad_words_cost_one_line(words, message, simulated, capsys):
    bag = simulated()
    assert main(['replay', str(bag), *words]) == 2
    out, err = capsys.readouterr()
    assert out == '' and message in err and err.count('\n') == 1
    assert not list(bag.glob('*.png'))


def test_a_bag_of_others_does_not_say_its_law(tmp_path, capsys):
    values = config.resolve('paper_circle')
    rest = np.tile(trajectory_of(values).sample(0.0).position, (50, 1))
    write_foreign(tmp_path / 'bag', streams(rest, rest))
    assert main(['replay', str(tmp_path / 'bag')]) == 2
    assert 'does not say which law ran' in capsys.readouterr().err
    assert main(['replay', str(tmp_path / 'bag'), '--law', 'smc']) == 0


BLIND = {
    'filter': {'estimator.kind': 'filter'},
    'levant': {'estimator.kind': 'levant'},
    'kalman': {'estimator.kind': 'kalman', 'estimator.velocities': False},
}


def blind(bag, fields, **unknown):
    """A bag as of hardware that does not measure all: fields are missing, or NaN."""
    directory = bag.with_name('blind')
    with BagWriter(directory, topics.RECORDED, recording.read(bag).history.facts) as writer:
        for topic, stream in content(bag / 'bag_0.mcap').items():
            for log_time, data in stream:
                if topic == topics.JOINT_STATES.name:
                    state = deserialize_message(data, JointState)
                    layout = layouts.joint_state(tuple(state.name), fields)
                    known = {field: getattr(state, field) for field in fields} | unknown
                    data = layout.records(1, log_time, **known).tobytes()
                writer.write(topic, log_time, data)
    return directory


@pytest.mark.parametrize('unknown', [{}, {'velocity': np.nan}], ids=['missing', 'NaN'])
@pytest.mark.parametrize('kind', BLIND)
def test_positions_alone_are_replayed_where_they_were_enough(kind, unknown, simulated, capsys):
    bag = blind(simulated(**BLIND[kind]), ('position', *unknown, 'effort'), **unknown)
    assert main(['replay', str(bag)]) == 0
    out, err = capsys.readouterr()
    assert 'identical: 301 commands' in out and 'have no velocities' in err
    assert main(['analyze', str(bag)]) == 0
    assert 'nan' not in capsys.readouterr().out


def test_states_without_a_reference_are_told_once(simulated, monkeypatch, capsys):
    measured = simulated(**{'safety.reference_timeout': 0.05})
    bag = measured.with_name('cut')
    monkeypatch.setattr('parallel_robot.analysis.replay.bag_replay.SECONDS', 0.12)  # of a window
    with BagWriter(bag, topics.RECORDED, recording.read(measured).history.facts) as writer:
        for topic, stream in content(measured / 'bag_0.mcap').items():
            for log_time, data in stream[:100] if topic == topics.REFERENCE.name else stream:
                writer.write(topic, log_time, data)
    main(['replay', str(bag)])
    (line,) = (each for each in capsys.readouterr().err.splitlines() if 'no reference' in each)
    log = recording.read(bag).log
    assert (~log.referenced).sum() > 100 and f'{(~log.referenced).sum()} states, from t = ' in line


@pytest.mark.parametrize('unknown', [{}, {'effort': [0.0, np.nan] * 3}], ids=['missing', 'NaN'])
def test_without_efforts_torques_are_those_commanded(unknown, simulated, capsys):
    measured = simulated()
    bag = blind(measured, ('position', 'velocity', *unknown), **unknown)
    whole, log = recording.read(measured).log, recording.read(bag).log
    assert np.array_equal(log.effort, whole.effort) and whole.has_efforts and not log.has_efforts
    frame = pr.load(bag).to_frame()
    assert frame.filter(like='effort_nm').isna().all(axis=None)
    pandas.testing.assert_frame_equal(frame, pr.export(bag))
    assert main(['replay', str(bag)]) == 0
    out, err = capsys.readouterr()
    assert 'identical: 301 commands' in out and 'have no efforts: torques are those comm' in err
    assert main(['analyze', str(bag)]) == 0
    assert 'nan' not in capsys.readouterr().out
    lags = [
        timing.evaluate(each, recording.read(path).history).lag
        for each, path in ((whole, measured), (log, bag))
    ]
    assert [*map(len, lags)] == [300, 0]  # nobody knows which command acted
    assert rehearse.motors_braked(log, 0.0, 0.3).text.startswith('the bag does not tell')


def test_without_velocities_that_were_used_a_bag_is_analysed_and_no_more(simulated, capsys):
    bag = blind(simulated(), ('position', 'effort'))
    assert main(['analyze', str(bag)]) == 0
    capsys.readouterr()
    assert main(['replay', str(bag)]) == 2
    err = capsys.readouterr().err.splitlines()[-1]
    assert 'the bag has no velocities, which estimator.kind auto takes; --set estimator' in err
    assert main(['replay', str(bag), '--set', 'estimator.kind=levant']) == 0  # as that line says


WORDS = ([], ['--law', 'smc'], ['--set', 's_fotsmc.G=12'], ['--from', '0.1', '--to', '0.22'])


@pytest.mark.parametrize('words', WORDS, ids=' '.join)
def test_a_bag_in_windows_is_replayed_as_at_once(words, simulated, tmp_path, capsys, monkeypatch):
    bag, said = (
        simulated(hazards=['states_lost at 0.1 for 0.01', 'commands_lost at 0.2 for 0.02']),
        [],
    )
    monkeypatch.setattr(indexed_reader, 'LARGE', 1)
    for seconds in (30.0, 0.07):
        monkeypatch.setattr('parallel_robot.analysis.replay.bag_replay.SECONDS', seconds)
        picture = tmp_path / f'{seconds}.png'
        code = main(['replay', str(bag), *words, '--figure', str(picture)])
        out, err = capsys.readouterr()
        said.append((code, out.replace(str(picture), ''), err))
        assert picture.exists()
    assert said[0] == said[1] and said[0][0] == 0


def test_no_state_in_any_window_is_told_as_at_once(simulated, capsys):
    assert main(['replay', str(simulated()), '--from', '7']) == 2
    assert 'its states go from t = 0.000 s to 0.300 s' in capsys.readouterr().err
