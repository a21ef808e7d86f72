"""`period: auto`: a node takes the period with which the joint states come."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from ros_fixtures import until
from sensor_msgs.msg import JointState

from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.connections import FEW, period_of
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

MS = 10**6  # ns
START = 1_700_000_000 * 10**9  # ns
JOINTS, GRIPPER = ['gripper', 'joint3', 'joint1', 'joint2'], ['gripper']


@pytest.mark.parametrize('period', [0.5, 1, 1.25, 2, 4, 8, 20])
def test_the_period_is_that_of_stamps_with_jitter_and_gaps(period):
    """Each stamp is up to a tenth of the period late, at most 0.1 ms; every tenth is missing."""
    draw = np.random.default_rng(4)
    at = np.arange(round(600 / period)) * period
    at = (at + draw.uniform(0.0, min(0.1, 0.1 * period), len(at)))[draw.random(len(at)) > 0.1]
    found = period_of(START + (at * MS).astype(np.int64))
    assert found % 1000 == 0 and abs(found - period * MS) <= max(1000, 5e-4 * period * MS)


@pytest.mark.parametrize('missing', [0.3, 0.5, 0.6, 0.7])
@pytest.mark.parametrize('seed', range(5))
def test_the_period_is_found_where_most_stamps_are_missing(missing, seed):
    draw = np.random.default_rng(seed)
    at = (np.arange(900) + draw.uniform(0.0, 0.1, 900))[draw.random(900) > missing]
    assert abs(period_of(START + (at * MS).astype(np.int64)) - MS) <= 1000


@pytest.mark.parametrize('seed', range(20))
def test_the_period_is_found_beside_a_long_gap(seed):
    """Of 200 periods, in which one is easily counted too many."""
    draw = np.random.default_rng(seed)
    at = np.delete(np.arange(600) + draw.uniform(0.0, 0.1, 600), np.arange(300, 500))
    assert abs(period_of(START + (at * MS).astype(np.int64)) - MS) <= 1000


REAL = [
    np.array(line.split(','), np.int64)
    for line in Path(__file__).with_name('ros2_stamps.csv').read_text().splitlines()[1:]
]


@pytest.mark.parametrize('missing', [0.0, 0.05, 0.24])
@pytest.mark.parametrize('part', range(len(REAL)))
def test_the_period_is_that_of_the_real_broadcaster_in_every_window(part, missing):
    """With overruns, of which the mean of the steps made half the period, or 501.8 Hz."""
    rate, *steps = REAL[part].tolist()
    stamps = np.cumsum([START, *np.multiply(steps, 1000)])
    stamps = stamps[np.random.default_rng(part).random(len(stamps)) >= missing]
    windows = np.searchsorted(stamps, stamps + MS * 500) + 1
    found = {period_of(stamps[i:j]) for i, j in enumerate(windows) if j <= len(stamps)}
    assert found == {10**9 // rate}


@pytest.mark.parametrize('period', [3, 7, 9, 1000 / 300, 1000 / 144])
def test_a_rate_that_divides_another_one_is_told_as_it_is(period):
    """333.3 Hz are 3 ms, not a whole number of Hz; 300 Hz are."""
    at = np.arange(200) * period + np.random.default_rng(1).uniform(0.0, 0.1, 200)
    assert period_of(START + (at * MS).astype(np.int64)) == round(1000 * period) * 1000


def test_stamps_that_are_too_few_or_stand_tell_nothing():
    assert period_of(np.zeros(0, np.int64)) == period_of(np.full(1000, START)) == 0
    assert period_of(START + np.arange(400) * MS) == 0  # of 0.4 s
    assert period_of(START + np.arange(FEW) * 100 * MS) == 0
    assert period_of(START + np.arange(FEW + 1) * 100 * MS) == 100 * MS


def state(k, names=JOINTS, period=4 * MS):
    message = JointState(name=names, position=[0.0] * len(names))
    seconds, message.header.stamp.nanosec = divmod(START + k * period, 10**9)
    message.header.stamp.sec = seconds
    return message


@pytest.mark.parametrize('name', ['controller', 'trajectory'])
def test_a_node_waits_for_the_states_and_says_their_period(name, launch, peer):
    """Messages of a gripper come between them, twice as often."""
    process = launch(MODULES[name], '--ros-args', '-p', 'period:=auto')
    process.until(lambda: 'period auto: waits for /joint_states' in process.stderr)
    publisher = peer.publisher(topics.JOINT_STATES)
    stamps = itertools.count()

    def publish():
        k = next(stamps)
        for message in (
            state(2 * k, GRIPPER, 2 * MS),
            state(k),
            state(2 * k + 1, GRIPPER, 2 * MS),
        ):
            publisher.publish(message)
        peer.spin(0.001)

    until(lambda: 'period 0.004 s: joint states come at 250 Hz' in process.stderr, publish)
    request = GetParameters.Request(names=['period', 'granted.period'])
    answer = peer.call(GetParameters, f'{name}/get_parameters', request, process)
    number, text = map(parameter_value_to_python, answer.values)
    assert number == 0.004 and text == '0.004 s: joint states come at 250 Hz'


@pytest.mark.parametrize(
    ('first', 'then'), [('controller', 'trajectory'), ('trajectory', 'controller')]
)
def test_the_period_is_that_of_a_node_that_runs_already(first, then, launch, peer):
    """Of one that has about that of the states, whichever comes first."""
    known = launch(MODULES[first], '--ros-args', '-p', 'period:=0.00402')
    request = GetParameters.Request(names=['period'])
    peer.call(GetParameters, f'{first}/get_parameters', request, known)
    process = launch(MODULES[then], '--ros-args', '-p', 'period:=auto')
    publisher, stamps = peer.publisher(topics.JOINT_STATES), itertools.count()

    def publish():
        publisher.publish(state(next(stamps)))
        peer.spin(0.001)

    until(lambda: 'joint states come at 248.8 Hz' in process.stderr, publish)


@pytest.mark.parametrize(
    ('name', 'more', 'reason'),
    [('plant', [], 'of this node'), ('controller', ['-p', 'time_mode:=lockstep'], 'in lockstep')],
)
def test_without_states_to_wait_for_auto_is_refused(name, more, reason, launch, domain):
    process = launch(MODULES[name], '--ros-args', '-p', 'period:=auto', *more)
    assert process.wait() == 2
    assert process.stderr.splitlines() == [
        f"parallel_robot: period must be a number {reason}, not 'auto'"
    ]
