"""A bag is read at one go, with all that is wanted of it."""

import numpy as np
import pytest
from bags import START, streams, table_of, write_foreign

from parallel_robot.analysis.export import export
from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.bags import bag_reader
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.python import notebook
from parallel_robot_control.messages import telemetry_layouts
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR, SLIDING_VARIABLE


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    bag = tmp_path_factory.mktemp('recording') / 'bag'
    assert main(['simulate', 'paper_circle', '--duration', '0.2', '--out', str(bag)]) == 0
    return bag


@pytest.mark.parametrize(
    'reader',
    [
        lambda bag: recording.read(bag, (*topics.TELEMETRY,)),
        lambda bag: read_runs([bag]),
        table_of,
        notebook.load,
        lambda bag: export(bag, foxglove=bag.with_name('copy')),
        lambda bag: main(['analyze', str(bag)]),
        lambda bag: main(['replay', str(bag)]),
    ],
)
def test_the_file_is_walked_once(reader, bag, monkeypatch):
    walks, joined = [], bag_reader._joined

    def counted(*words):
        walks.append(words)
        return joined(*words)

    monkeypatch.setattr(bag_reader, '_joined', counted)
    reader(bag)
    assert len(walks) == 1


def test_telemetry_is_there_if_it_is_asked_for(bag):
    log, past, extra = recording.read(bag, (CROSS_COUPLING_ERROR, SLIDING_VARIABLE))
    assert {*extra} == {CROSS_COUPLING_ERROR, SLIDING_VARIABLE}
    for samples in extra.values():
        np.testing.assert_array_equal(samples.stamps, log.stamps[::10])
        assert samples.numbers['position'].any()
    without = recording.read(bag)
    assert without.extra == {} and without.history == past
    assert without.log.messages == log.messages


def test_telemetry_that_is_not_ours_is_left_out_and_counted(tmp_path):
    zeros = np.zeros((20, 3))
    layout = telemetry_layouts(('a', 'b', 'c'))[CROSS_COUPLING_ERROR]
    found = streams(zeros, zeros) | {
        CROSS_COUPLING_ERROR: [(START, layout.encode(START))],
        SLIDING_VARIABLE: [(START, bytes(20))],
    }
    write_foreign(tmp_path / 'bag', found)
    log, _, extra = recording.read(tmp_path / 'bag', (CROSS_COUPLING_ERROR, SLIDING_VARIABLE))
    assert extra == {}
    assert log.messages[CROSS_COUPLING_ERROR.name].count == 1
    assert log.messages[SLIDING_VARIABLE.name].count == 1
