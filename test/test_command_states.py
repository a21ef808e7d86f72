"""Which command answers which state: what the controller recorded, beside what the bag holds."""

import numpy as np
import pytest

from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot.bags.run import matching

MS = 1_000_000  # ns
COUNT, EACH = 1003, 10  # commands, records in a message
STATES = np.append(np.arange(1, COUNT), 0) * MS  # the last one answers no state
TORQUES = np.random.default_rng(2).normal(size=(COUNT, 3))
TORQUES[-1] = 0.0
ROWS = np.hstack([STATES[:, np.newaxis] + [0, 1, 2], TORQUES.view(np.int64)])


def messages(rows=ROWS):
    """Messages of records, each with what came since the last one."""
    for begin in range(0, len(rows), EACH):
        data = rows[begin:][:EACH].reshape(1, -1)
        yield Samples((), np.array([begin]), np.zeros(1, int), {'data': data})


def recorded(parts, torques):
    """What some messages say of commands, one a millisecond."""
    commands = Samples((), np.arange(len(torques)) * MS, np.zeros(len(torques)), {'data': torques})
    return matching.recorded_answers(parts, commands)


def test_each_command_comes_with_its_times():
    found = recorded([*messages()][::-1], TORQUES)  # in whatever order they were read
    assert np.array_equal(found.states, STATES)
    assert np.array_equal(found.references, STATES + 1)
    assert np.array_equal(found.acts, STATES + 2)
    assert np.array_equal(found.torque, TORQUES)
    assert len(found.lost) == len(found.gaps) == 0


def test_messages_of_the_same_time_keep_the_order_of_their_states():
    found = recorded([part._replace(log_times=np.zeros(1, int)) for part in messages()], TORQUES)
    assert np.array_equal(found.states[:-3], STATES[:-3])


@pytest.mark.parametrize('lost', [1, 40])
def test_commands_that_are_lost_are_counted_and_known(lost):
    found = recorded([*messages()], np.delete(TORQUES, np.s_[620 : 620 + lost], axis=0))
    assert (len(found.lost), len(found.gaps)) == (lost, 0)
    assert np.array_equal(found.torque, TORQUES)


def test_records_that_are_lost_leave_gaps():
    found = recorded([*messages()][:20] + [*messages()][21:60] + [*messages()][63:], TORQUES)
    assert (len(found.lost), len(found.gaps)) == (0, 2)


@pytest.mark.parametrize(('begin', 'end'), [(3, COUNT), (0, COUNT - 15), (14, COUNT - 1)])
def test_a_bag_that_begins_or_ends_in_the_midst_lacks_nothing(begin, end):
    found = recorded([*messages()][1:-1], TORQUES[begin:end])
    assert (len(found.lost), len(found.gaps)) == (0, 0)


def test_torques_that_stand_still_are_no_loss():
    torques = np.where(np.arange(COUNT)[:, np.newaxis] % 300 < 200, 1.5, TORQUES)
    rows = np.hstack([ROWS[:, :3], torques.view(np.int64)])
    found = recorded([*messages(rows)], torques)
    assert np.array_equal(found.torque, torques) and (len(found.lost), len(found.gaps)) == (0, 0)


def test_torques_that_no_robot_can_have_are_none():
    torques = TORQUES.copy()
    torques[5] = np.inf
    rows = np.hstack([ROWS[:, :3], torques.view(np.int64)])
    assert np.isnan(recorded([*messages(rows)], TORQUES).torque[5]).all()


@pytest.mark.parametrize(
    'rows',
    [ROWS[:, :3], ROWS[:, :5], np.hstack([ROWS[:, :3], TORQUES[::-1].copy().view(np.int64) + 1])],
    ids=['stamps alone', 'fewer joints', 'other commands'],
)
def test_what_is_not_of_these_commands_says_nothing(rows):
    assert recorded([*messages(rows)], TORQUES) is None
