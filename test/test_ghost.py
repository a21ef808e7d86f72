"""The torques of another law, while the motion goes on."""

from itertools import pairwise

import numpy as np
import pytest

from parallel_robot.analysis.replay import replayed
from parallel_robot.analysis.replay.recorded_controller import RecordedController
from parallel_robot.analysis.replay.replayed import Ghost
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import changed, configure
from parallel_robot_control.contract import JointReference


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    found = tmp_path_factory.mktemp('bag') / 'bag'
    words = ['simulate', 'paper_circle', '--law', 's_fotsmc', '--duration', '0.5']
    assert main([*words, '--out', str(found)]) == 0
    return found


@pytest.mark.parametrize('law', ['smc', 's_fotsmc', 'observer_s_fotsmc'])
def test_in_parts_it_is_the_replay_of_the_whole(law, bag, monkeypatch):
    """The replay takes all states at once; here its controller takes over, as the ghost does."""
    monkeypatch.setattr(RecordedController, 'common_start', lambda *_: False)
    log, past, _ = recording.read(bag)
    configured = changed(configure(log.config), {'law': law})
    ghost = Ghost(configured)
    whole = replayed.instead(log, past, configured).torque
    found = []
    edges = [0, 1, 2, 40, 41, 200, len(log.stamps)]
    for first, stop in pairwise(edges):
        rows = slice(first, stop)
        references = JointReference(
            log.reference_position[rows],
            log.reference_velocity[rows],
            log.reference_acceleration[rows],
        )
        found.append(
            ghost.answer(
                log.stamps[rows],
                log.position[rows],
                log.velocity[rows],
                references,
                log.effort[rows],
            )
        )
    known = ~np.isnan(whole[:, 0])
    assert known.sum() > 400
    np.testing.assert_array_equal(np.concatenate(found)[known], whole[known])
