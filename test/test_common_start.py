"""The common start: which stamps a node takes, and that it takes one once."""

import time

import pytest

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import WAIT, LoopParameters
from parallel_robot_model.nodes.parameters import CommonStart

SECOND = 10**9  # ns


def common_start(time_mode='lockstep', start_stamp=WAIT):
    values = config.resolve('paper_circle', {'time_mode': time_mode, 'start_stamp': start_stamp})
    return CommonStart(group(values, LoopParameters, ''))


def test_a_stamp_is_taken_once_and_may_be_sent_twice():
    start = common_start()
    start.check(SECOND)
    assert start.take(SECOND)
    start.check(SECOND)
    assert not start.take(SECOND)
    with pytest.raises(InputError, match='the node does not wait for a start'):
        start.check(2 * SECOND)


@pytest.mark.parametrize('stamp', [0, -SECOND, SECOND + 1, 1.0, '1', None, [SECOND]])
def test_a_stamp_is_on_the_grid_of_the_period(stamp):
    with pytest.raises(InputError, match='must be a whole multiple of the period in ns'):
        common_start().check(stamp)


@pytest.mark.parametrize('own', [0, SECOND])
def test_a_node_with_a_start_of_its_own_takes_none(own):
    with pytest.raises(InputError, match='the node does not wait for a start'):
        common_start(start_stamp=own).check(2 * SECOND)


def test_in_wall_time_a_stamp_lies_ahead():
    now = time.time_ns() // SECOND * SECOND
    common_start('wall').check(now + 100 * SECOND)
    with pytest.raises(InputError, match='lies in the past'):
        common_start('wall').check(now - SECOND)
    common_start().check(now - SECOND)  # in lockstep any time will do
