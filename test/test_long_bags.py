"""A bag that is read in windows has the figures of the same bag that is read as a whole."""

import json

import numpy as np
import pytest
from assembly import simulated
from bags import MS, content, write_foreign
from test_timing import FACTS, NOTHING, N, loop

from parallel_robot.analysis import evaluated_bag, quantiles, running_metrics, timing
from parallel_robot.analysis.evaluated_bag import evaluate
from parallel_robot.analysis.motion_alone import MotionAlone
from parallel_robot.analysis.quantiles import Quantiles
from parallel_robot.analysis.running_timing import RunningTiming
from parallel_robot.bags import indexed_reader, recording, run_log, simulation_bag, window_streams
from parallel_robot.bags.bag_view import BagView
from parallel_robot.bags.bag_writer import BagWriter
from parallel_robot.cli.command_line import main
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import JOINT_STATES, REFERENCE, Topic

WINDOW = 0.43  # s


@pytest.fixture
def windows(monkeypatch):
    """Bags are read in short windows from here on."""

    def begin():
        for module in (window_streams, recording):
            monkeypatch.setattr(module, 'SLACK', 200 * MS)
        monkeypatch.setattr(indexed_reader, 'LARGE', 1)
        monkeypatch.setattr(evaluated_bag, 'WINDOW', WINDOW)

    return begin


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return simulation(tmp_path_factory.mktemp('long') / 'bag')


def simulation(path, **values):
    given = {'duration': 4.0, 'time_mode': 'lockstep'} | values
    resolved = config.resolve('paper_circle', given)
    simulation_bag.write(path, resolved, simulated(resolved))
    return path


def assert_alike(found, wanted):
    """Numbers in nested tuples agree up to rounding."""
    assert type(found) is type(wanted)
    if isinstance(wanted, tuple):
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
    assert len(long.log.time) < len(whole.log.time)
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
    assert found.metrics.window.asked == (part != (None, None))
    assert found.metrics.effort.excess_chattering_nm > 0.0


def test_a_motion_that_comes_to_rest(bag, tmp_path, windows):
    """Its figures are of the time before; where its halves begin is known at the end alone."""
    found = content(bag / 'bag_0.mcap')
    stops = found[REFERENCE.name][3000][1]
    rests = [
        (time, data if k < 3000 else data[:4] + stamped(data, stops))
        for k, (time, data) in enumerate(found[REFERENCE.name])
    ]
    whole = assert_same(
        windows, changed(tmp_path / 'bag', bag, found | {REFERENCE.name: rests})
    )
    assert whole.metrics.window.rests and whole.metrics.duration_s == pytest.approx(3.0)


def stamped(message, other):
    """The content of another message, with the stamp of this one and no rates."""
    layout = layouts.joint_trajectory(JOINTS) if False else None
    return other[4:] if layout is None else b''


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


def test_laws_that_are_switched_and_a_fault(tmp_path, windows):
    path = simulation(
        tmp_path / 'bag', **{'hazard.scenario': 'x'} if False else {'law': 'pid'}
    )
    assert_same(windows, path)
