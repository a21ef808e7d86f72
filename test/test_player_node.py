"""The player as a real process."""

import signal

import pytest
from assembly import simulated
from bags import STORE
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from parallel_robot.bags.writing import simulation_bag
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts, topics

pytest_plugins = ['ros_fixtures']

PLAYER = 'parallel_robot.bags.player_node'


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Half a second of the paper's circle."""
    path = tmp_path_factory.mktemp('player') / 'bag'
    values = config.resolve('paper_circle', {'duration': 0.5})
    simulation_bag.write(path, values, [simulated(values)])
    return path


def call(peer, process, name):
    return peer.call(Trigger, f'player/{name}', Trigger.Request(), process)


def assign(peer, process, **values):
    parameters = [Parameter(key, value=value).to_parameter_msg() for key, value in values.items()]
    request = SetParametersAtomically.Request(parameters=parameters)
    return peer.call(
        SetParametersAtomically, 'player/set_parameters_atomically', request, process
    ).result


def stamp(message):
    return message.sec + message.nanosec * 1e-9


@pytest.mark.parametrize('words', [['--rate', '5'], ['--fast']], ids=' '.join)
def test_a_bag_is_played_whole_and_in_order(words, bag, launch, peer):
    states, laws = peer.listen(topics.JOINT_STATES), peer.listen(topics.ACTIVE_LAW)
    process = launch(PLAYER, bag, '--pause', *words)
    peer.meet('player', process)
    call(peer, process, 'resume')
    peer.until(lambda: len(states) == 501 and laws)
    assert process.wait() == 0
    milliseconds = [round(stamp(state.header.stamp) * 1e3) for state in states]
    assert milliseconds == list(range(1000, 1501))
    assert [law.data for law in laws] == ['s_fotsmc']


def test_pause_step_seek_and_a_clock_that_stands(bag, launch, peer):
    states, clocks = peer.listen(topics.JOINT_STATES), []
    peer.node.create_subscription(Clock, '/clock', clocks.append, 10)
    words = ['--pause', '--clock', '--topics', 'joint_states']
    process = launch(PLAYER, bag, *words, '--ros-args', '-p', 'period:=0.001')
    peer.meet('player', process)
    peer.until(lambda: len(clocks) > 5)
    assert {stamp(clock.clock) for clock in clocks} == {1.0}
    assert call(peer, process, 'step').message.startswith('paused at')
    peer.until(lambda: len(states) == 1)
    assert assign(peer, process, position=0.3).successful
    refused = assign(peer, process, position=7)
    assert not refused.successful and '0.5 s long' in refused.reason
    peer.until(lambda: stamp(clocks[-1].clock) == 1.3)
    call(peer, process, 'resume')
    peer.until(lambda: stamp(states[-1].header.stamp) == 1.5)
    assert len(states) == 202


def test_a_rate_is_set_while_it_plays(bag, launch, peer):
    states = peer.listen(topics.JOINT_STATES)
    process = launch(PLAYER, bag, '--pause', '--rate', '0.001')
    peer.meet('player', process)
    for wrong, reason in (
        ({'rate': 0.0}, 'rate must be from 0.001 to 1000, not 0'),
        ({'rate': 'much'}, "rate must be a number, not 'much'"),
        ({'rate': 2.0, 'position': 9.0}, '0.5 s long'),
        ({'rate': 2.0, 'pause': True}, "unknown parameter 'pause'"),
    ):
        refused = assign(peer, process, **wrong)
        assert not refused.successful and reason in refused.reason
    call(peer, process, 'resume')
    peer.until(lambda: states)  # the next one would come after a second
    assert assign(peer, process, rate=5).successful
    peer.until(lambda: len(states) == 501)
    assert process.wait() == 0


def test_a_player_that_keeps_no_time_has_no_rate(bag, launch, peer):
    process = launch(PLAYER, bag, '--pause', '--fast')
    refused = assign(peer, process, rate=2.0)
    assert not refused.successful and '--fast' in refused.reason


def test_a_step_is_a_sample_of_the_loop(bag, launch, peer):
    states, commands = peer.listen(topics.JOINT_STATES), peer.listen(topics.COMMANDS)
    process = launch(PLAYER, bag, '--pause')
    peer.meet('player', process)
    for count in (1, 2, 3):
        assert call(peer, process, 'step').success
        peer.until(lambda: len(states) >= count and len(commands) >= count)  # noqa: B023
    assert len(states) == len(commands) == 3


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_it_ends_in_order(number, bag, launch, peer):
    process = launch(PLAYER, bag, '--loop')
    peer.see('/player')
    assert process.end(number) == 0 and 'Traceback' not in process.stderr


def test_types_that_are_not_installed_are_left_out(launch, peer, tmp_path):
    text = layouts.text_message('here')
    path = tmp_path / 'bag'
    definition = {'nobody_msgs/msg/Odd': STORE.fielddefs['std_msgs/msg/String']}
    STORE.register(definition)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, kind in (('/odd', 'nobody_msgs/msg/Odd'), ('/text', 'std_msgs/msg/String')):
            writer.write(writer.add_connection(name, kind, typestore=STORE), 1, text)
    process = launch(PLAYER, path)
    assert process.wait() == 0
    (line,) = [line for line in process.stderr.splitlines() if 'WARN' in line]
    assert line.endswith('/odd is left out: no type nobody_msgs/msg/Odd is installed')


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['nowhere'], 'nowhere does not exist'),
        (['BAG', '--rate', '0'], '--rate must be from 0.001 to 1000, not 0'),
        (['BAG', '--rate', 'x'], "--rate: a number is wanted, not 'x'"),
        (['BAG', '--start', '9'], 'the bag is 0.5 s long; it has no moment 9 s'),
        (['BAG', '--topics', 'poes'], "unknown topic '/poes'; did you mean '/pose'?"),
        (['BAG', '--ros-args', '-p', 'rate:=2.0'], "unknown parameter 'rate'"),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_wrong_input_costs_one_line(words, message, bag, launch, domain):
    process = launch(PLAYER, *(bag if word == 'BAG' else word for word in words))
    assert process.wait() == 2
    assert process.stderr.count('\n') == 1 and message in process.stderr
