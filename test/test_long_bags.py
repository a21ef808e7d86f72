"""A bag that is read in windows has the figures of the same bag that is read as a whole."""

import json
import shutil

import numpy as np
import pytest
from assembly import simulated
from bags import MS, content, write_foreign
from test_timing import FACTS, NOTHING, N, loop

from parallel_robot.analysis import evaluated_bag, recorded_motions, thinned, timing
from parallel_robot.analysis.evaluated_bag import evaluate
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.bags import columns, indexed_reader
from parallel_robot.bags.bag_reader import BagView
from parallel_robot.bags.files import mcap_reader
from parallel_robot.bags.run import recorded_robot, recording
from parallel_robot.bags.writing import recovery, simulation_bag
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot.cli.command_line import main
from parallel_robot_control.messages import Status, status_message
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import JOINT_STATES, REFERENCE, Topic

WINDOW = 0.43  # s
STAMPED = 12  # bytes of a message up to the end of its stamp
NAMES = ('whole', 'long')


@pytest.fixture
def windows(monkeypatch):
    """Bags are read in short windows from here on."""

    def begin():
        for module in (indexed_reader, recording):
            monkeypatch.setattr(module, 'SLACK', 200 * MS)
        monkeypatch.setattr(indexed_reader, 'LARGE', 1)
        for module in (evaluated_bag, thinned):
            monkeypatch.setattr(module, 'WINDOW', WINDOW)
        monkeypatch.setattr(columns, 'BLOCK', 321)
        monkeypatch.setattr(columns, 'SMALL', 1 << 10)
        monkeypatch.setattr(evaluated_bag, 'LONG', 1.0)
        monkeypatch.setattr(evaluated_bag, 'SMALL', 0)

    return begin


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return simulation(tmp_path_factory.mktemp('long') / 'bag')


def simulation(path, **values):
    given = {'duration': 4.0, 'time_mode': 'lockstep'} | values
    resolved = config.resolve('paper_circle', given)
    simulation_bag.write(path, resolved, [simulated(resolved)])
    return path


def assert_alike(found, wanted):
    """Numbers in nested tuples agree up to rounding."""
    if isinstance(wanted, Metrics):
        found, wanted = (tuple(vars(each).values()) for each in (found, wanted))
    if isinstance(wanted, dict):
        assert found.keys() == wanted.keys()
        found, wanted = (tuple(each.values()) for each in (found, wanted))
    if isinstance(wanted, tuple):
        assert type(found) is type(wanted)
        for one, other in zip(found, wanted, strict=True):
            assert_alike(one, other)
    elif isinstance(wanted, float):
        assert found == pytest.approx(wanted, rel=1e-12, nan_ok=True)
    else:
        assert found == wanted


def both(windows, bag, part=(None, None), view=None):
    """Figures of a bag read as a whole, and in windows, with their warnings."""
    view, texts = view or BagView(whole=True), ([], [])
    whole = evaluate(bag, view=view, part=part, warn=texts[0].append)
    windows()
    return whole, evaluate(bag, view=view, part=part, warn=texts[1].append), texts


def assert_same(windows, bag, part=(None, None), view=None):
    """All that is told of a bag is the same."""
    whole, long, (texts, others) = both(windows, bag, part, view)
    assert isinstance(long.log.time, np.memmap) and not isinstance(whole.log.time, np.memmap)
    assert_alike(long.metrics, whole.metrics)
    assert timing.as_json(long.timing) == timing.as_json(whole.timing)
    assert long.log.messages == whole.log.messages and [*long.log.messages] == [
        *whole.log.messages
    ]
    assert long.past == whole.past and long.last == whole.last
    assert long.parts == whole.parts and long.remarks == whole.remarks
    assert [one.stretch for one in long.figures] == [one.stretch for one in whole.figures]
    for one, other in zip(long.figures, whole.figures, strict=True):
        assert_alike(one, other)
    assert {*others} == {*texts}
    assert np.isin(long.motion.time, whole.motion.time).all()
    for name in ('position', 'reference_position', 'effort'):
        values, others = (getattr(each.motion, name) for each in (whole, long))
        assert np.array_equal(values.max(axis=0), others.max(axis=0))
        assert np.array_equal(values.min(axis=0), others.min(axis=0)) or name == 'position'
    return whole


def changed(path, bag, messages):
    """A bag of the suite with the facts of another and these messages."""
    facts = recording.read(bag).history.facts
    entries = [(time, name, data) for name in messages for time, data in messages[name]]
    with BagWriter(path, topics.RECORDED, facts) as writer:
        for time, name, data in sorted(entries, key=lambda entry: entry[0]):
            writer.write(name, time, data)
    return path


@pytest.mark.parametrize('part', [(None, None), (0.7, 2.9), (None, 1.5), (2.0, None)])
def test_a_simulation_in_windows(part, bag, windows):
    found = assert_same(windows, bag, part)
    assert found.metrics.window.requested == (part != (None, None))
    assert found.metrics['excess_chattering_nm'] > 0.0


def test_a_window_of_one_state(bag, windows, monkeypatch):
    whole = evaluate(bag)
    windows()
    monkeypatch.setattr(evaluated_bag, 'WINDOW', 0.5)
    assert_alike(evaluate(bag).metrics, whole.metrics)


def test_a_motion_that_comes_to_rest(bag, tmp_path, windows):
    """Its figures are of the time before; where its halves begin is known at the end alone."""
    found = content(bag / 'bag_0.mcap')
    _, end = found[REFERENCE.name][3000]
    rests = [
        (time, data if k < 3000 else data[:STAMPED] + end[STAMPED:])
        for k, (time, data) in enumerate(found[REFERENCE.name])
    ]
    whole = assert_same(windows, changed(tmp_path / 'bag', bag, found | {REFERENCE.name: rests}))
    assert whole.metrics.window.rests and whole.metrics.duration_s == pytest.approx(3.0)


LOST = {
    'states': (JOINT_STATES, {*range(428, 433), *range(2000, 2600)}),
    'references': (REFERENCE, {*range(850, 870), *range(3000, 3700)}),
    'commands': (topics.COMMANDS, {*range(855, 865), 3999}),
    'records': (topics.ANSWERED, {43, 201, 202}),
}


@pytest.mark.parametrize('lost', LOST)
def test_lost_messages(lost, bag, tmp_path, windows):
    found = content(bag / 'bag_0.mcap')
    topic, rows = LOST[lost]
    kept = [entry for k, entry in enumerate(found[topic.name]) if k not in rows]
    assert_same(windows, changed(tmp_path / 'bag', bag, found | {topic.name: kept}))


def test_laws_that_are_switched(bag, tmp_path, windows):
    found = content(bag / 'bag_0.mcap')
    times = [time for time, _ in found[JOINT_STATES.name]]
    told = [
        (times[k], status_message(times[k], Status(law, None, 0)))
        for k, law in ((1100, 'smc'), (1105, 'pid'), (2500, 's_fotsmc'))
    ]
    statuses = {topics.STATUS.name: found[topics.STATUS.name] + told}
    whole = assert_same(windows, changed(tmp_path / 'bag', bag, found | statuses))
    assert [one.stretch.law for one in whole.figures] == ['s_fotsmc', 'pid', 's_fotsmc']


def test_motors_at_their_limit(tmp_path, windows):
    assert assert_same(
        windows, simulation(tmp_path / 'bag', **{'plant.torque_limit': 1.5})
    ).saturated


def test_a_fault(tmp_path, windows):
    """The bag is one of hazards: it is read as a whole."""
    hazards = [{'what': 'commands_lost', 'at': 1.0, 'for': 0.5}]
    whole, long, _ = both(windows, simulation(tmp_path / 'bag', hazards=hazards))
    assert_alike(long.metrics, whole.metrics)
    assert timing.as_json(long.timing) == timing.as_json(whole.timing)


def test_a_robot_that_is_not_as_it_is_taken_to_be(tmp_path, windows):
    """What is true and what is seen are two motions; loads act."""
    loads = {'disturbance.noise': 0.1, 'disturbance.bandwidth': 20.0, 'friction.coulomb': 0.05}
    path = simulation(tmp_path / 'bag', **{'true_robot.l1': 0.2501, **loads})
    whole = assert_same(windows, path)
    assert whole.metrics.seen is not None and whole.metrics['excess_chattering_nm'] > 0.0


@pytest.mark.parametrize(
    'values',
    [
        {'sensor.position_noise': 1e-6},
        {'sensor.delay': 0.002, 'sensor.jitter': 0.001, 'sensor.resolution': 1e-5},
        {'sensor.position_noise': 1e-6, 'true_robot.l1': 0.2501, 'disturbance.noise': 0.1},
    ],
)
def test_a_plant_that_moves_again(values, tmp_path, windows):
    whole = assert_same(windows, simulation(tmp_path / 'bag', **values))
    assert whole.metrics.source == 'true' and whole.metrics.seen is not None
    assert not whole.remarks and whole.metrics['excess_chattering_nm'] > 0.0


@pytest.mark.parametrize('lost', ['states', 'commands', 'another plant'])
def test_a_plant_that_cannot_move_again_in_windows(lost, tmp_path, windows, monkeypatch):
    """The bag is read as a whole; one that is too large has no true motion."""
    noisy = simulation(tmp_path / 'noisy', **{'sensor.position_noise': 1e-6})
    found = content(next(noisy.glob('*.mcap')))
    if lost == 'another plant':
        monkeypatch.setattr(recorded_motions, 'SAME', 0.0)
        monkeypatch.setattr(recorded_motions, 'FEW', -1.0)
        path = noisy
    else:
        topic, rows = LOST[lost]
        kept = [entry for k, entry in enumerate(found[topic.name]) if k not in rows]
        path = changed(tmp_path / 'bag', noisy, found | {topic.name: kept})
    whole, long, _ = both(windows, path)
    assert_alike(long.metrics, whole.metrics)
    assert len(long.log.time) == len(whole.log.time) or lost == 'states'
    read = recorded_robot.read
    monkeypatch.setattr(recorded_robot, 'read', lambda *a, **b: read(*a, memory=1 << 20, **b))
    if lost != 'states':
        seen = evaluate(path)
        assert seen.metrics.source == 'seen' and 'too long for its plant' in seen.remarks[0]
        assert_alike(seen.metrics.seen.values, whole.metrics.seen.values)


def test_bags_of_others(bag, tmp_path, windows):
    found = content(bag / 'bag_0.mcap')
    streams = {
        Topic('arm/states', JOINT_STATES.type): found[JOINT_STATES.name],
        Topic('arm/wanted', REFERENCE.type): found[REFERENCE.name],
        topics.COMMANDS: found[topics.COMMANDS.name],
    }
    write_foreign(tmp_path / 'bag', streams)
    view = BagView({JOINT_STATES.name: '/arm/states', REFERENCE.name: '/arm/wanted'}, whole=True)
    whole, long, _ = both(windows, tmp_path / 'bag', (0.5, None), view)
    assert_alike(long.metrics, whole.metrics)
    assert long.log.messages == whole.log.messages


@pytest.mark.parametrize('share', [0.4, 0.9, 1.0])
def test_a_bag_that_was_not_closed(share, bag, tmp_path, windows):
    (path,) = bag.glob('*.mcap')
    data = path.read_bytes()
    (tmp_path / 'cut').mkdir()
    (tmp_path / 'cut' / path.name).write_bytes(data[: round(share * len(data)) - 20])
    shutil.copy(bag / 'metadata.yaml', tmp_path / 'cut')
    whole = assert_same(windows, tmp_path / 'cut')
    recovery.recover(tmp_path / 'cut', tmp_path / 'recovered')
    assert_alike(evaluate(tmp_path / 'recovered').metrics, whole.metrics)


def test_a_bag_that_was_not_closed_is_walked_through_once(bag, tmp_path, monkeypatch):
    (path,) = bag.glob('*.mcap')
    data, file, walked = path.read_bytes(), tmp_path / 'cut.mcap', []
    walk = mcap_reader.index
    monkeypatch.setattr(mcap_reader, 'index', lambda *file: walked.append(1) or walk(*file))
    for count, share in enumerate((0.5, 0.9), 1):  # more has been written since
        file.write_bytes(data[: round(share * len(data))])
        seconds, states = recording.size(file)
        found = sum(len(each.log.time) for each in recording.chunks(file, 1.0))
        assert len(walked) == count and found == pytest.approx(states, abs=2)
        assert 1e3 * seconds == pytest.approx(states, abs=20)


@pytest.mark.parametrize('part', [(None, None), (1.0, 2.5)])
def test_joint_states_alone(part, bag, tmp_path, windows):
    states = content(bag / 'bag_0.mcap')[JOINT_STATES.name]
    write_foreign(tmp_path / 'bag', {JOINT_STATES: states})
    whole, long, _ = both(windows, tmp_path / 'bag', part)
    assert isinstance(long, MotionAlone) and long.parts() == whole.parts()


def test_a_part_without_states_costs_the_same_line(bag, windows):
    texts = []
    for _ in range(2):
        with pytest.raises(BagError) as error:
            evaluate(bag, view=BagView(whole=True), part=(7.0, 8.0))
        texts.append(str(error.value))
        windows()
    assert texts[0] == texts[1] and 'from t = 0.000 s to 4.000 s' in texts[0]


def test_the_command_tells_the_same(bag, tmp_path, windows, capsys):
    told = []
    for name in NAMES:
        words = ['--json', str(tmp_path / f'{name}.json'), '--figure', str(tmp_path / 'run.svg')]
        assert main(['analyze', str(bag), *words]) == 0
        told.append(capsys.readouterr().out)
        assert (tmp_path / 'run.svg').stat().st_size > 10_000
        (tmp_path / 'run.svg').unlink()
        windows()
    assert told[0] == told[1]
    whole, long = (json.loads((tmp_path / f'{name}.json').read_text()) for name in NAMES)
    assert whole['messages'] == long['messages'] and whole['timing'] == long['timing']


@pytest.mark.parametrize('skipped', [(), range(300, 400), range(200), range(800, N + 1)])
def test_lags_of_real_time(skipped, tmp_path, monkeypatch):
    lag = np.random.default_rng(1).integers(1, 5, N + 1)
    found, _ = loop(lag, skipped)
    write_foreign(tmp_path / 'bag', found)
    log = recording.read(tmp_path / 'bag').log
    log = log._replace(heard=log.stamps + 10**5 + 7 * np.arange(len(log.stamps)) % 1000)
    for facts in (FACTS, FACTS | {'start_stamp': '0'}):
        past = NOTHING._replace(facts=facts)
        monkeypatch.undo()
        whole = timing.as_json(timing.evaluate(log, past))
        monkeypatch.setattr(columns, 'BLOCK', 130)
        monkeypatch.setattr(columns, 'SMALL', 1 << 10)
        assert timing.as_json(timing.evaluate(log, past)) == whole
