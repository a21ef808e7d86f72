"""What strangers send over the wire to each node: it goes on, answers, and does not grow."""

import os
import random
import time

import pytest
from assembly import simulated
from rcl_interfaces import srv
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from parallel_robot.bags.writing import simulation_bag
from parallel_robot_control.laws import LAWS
from parallel_robot_model.configuration import config
from parallel_robot_model.nodes.connections import message_class
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

MORE = int(os.environ.get('HOSTILE', '1'))  # 10: as many as anybody would have patience for
CALLS, MESSAGES = 200 * MORE, 1000 * MORE
GROWTH = 20e6  # bytes
NODES = {
    **{name: MODULES[name] for name in ('trajectory', 'plant', 'controller', 'recorder')},
    'monitor': 'parallel_robot.analysis.monitor_node',
    'player': 'parallel_robot.bags.player_node',
}
KEYS = [
    'use_sim_times', 'use_sim_time', 'qos_overrides', 'qos_overrides./x', 'granted.x',
    'start_type_description_services', 'start_type_description_service', 'granted.realtime',
    '', '.', 'a.b', 'x' * 10_000, 'law', 'preset', 'start_stamp', 'scenario', 'period', 'smc.G',
    'position', 'rate',
]  # fmt: skip
JOINTS = ['joint1', 'joint2', 'joint3']
TEXTS = ['', 'x', 'true', '\x1b[2J', 'x' * 10_000, '../../x', '\u00e9', 'smc']
NUMBERS = [0.0, float('nan'), float('inf'), 1e308, -1.0]
SERVICES = {
    'set_parameters': srv.SetParameters,
    'set_parameters_atomically': srv.SetParametersAtomically,
    'get_parameters': srv.GetParameters,
    'get_parameter_types': srv.GetParameterTypes,
    'describe_parameters': srv.DescribeParameters,
    'list_parameters': srv.ListParameters,
}


def value(chance, kind=None):
    """A parameter value of any type, those that do not exist included."""
    count = chance.choice([0, 1, 3, 10])
    return ParameterValue(
        type=chance.choice([*range(12), 255]) if kind is None else kind,
        bool_value=chance.random() < 0.5,
        integer_value=chance.choice([0, 1, -1, 2**63 - 1, -(2**63)]),
        double_value=chance.choice(NUMBERS),
        string_value=chance.choice(TEXTS),
        bool_array_value=[True] * count,
        integer_array_value=[1] * count,
        double_array_value=[chance.choice(NUMBERS)] * count,
        string_array_value=[chance.choice(TEXTS)] * count,
        byte_array_value=[b'x'] * count,
    )


def request(chance, kind):
    """A request of a parameter service."""
    count = chance.choice([0, 1, 1, 1, 2, 5])
    keys = chance.choices(KEYS, k=count)
    if kind is srv.ListParameters:
        return kind.Request(prefixes=keys, depth=chance.choice([0, 1, 2**63]))
    if kind in (srv.SetParameters, srv.SetParametersAtomically):
        return kind.Request(parameters=[Parameter(name=k, value=value(chance)) for k in keys])
    return kind.Request(names=keys)


def message(chance, kind):
    """Bytes on a topic: mostly those that begin as a message of its type does."""
    good = serialize_message(kind())
    if kind is ParameterEvent and chance.random() < 0.5:
        changed = [Parameter(name=chance.choice(KEYS), value=value(chance))]
        return serialize_message(ParameterEvent(node='/controller', changed_parameters=changed))
    if kind is JointState and chance.random() < 0.1:
        return serialize_message(joint_state(chance))
    noise = chance.randbytes(chance.choice([0, 4, 8, 20, 100]))
    return good[:4] + noise if chance.random() < 0.7 else noise


def joint_state(chance):
    """A joint state with long texts in it, and numbers that are far off."""
    names = chance.choice([JOINTS, [f'{chance.random()}' + 'j' * 100_000]])
    state = JointState(name=names)
    state.position = state.velocity = [chance.choice(NUMBERS) for _ in names]
    state.header.frame_id = f'{chance.random()}' + chance.choice(['', 'f' * 100_000])
    return state


@pytest.fixture(params=NODES)
def victim(request, launch, peer, tmp_path):
    """A node in a process of its own: its name and process."""
    name = request.param
    words = []
    if name == 'player':
        values = config.resolve('paper_circle', {'duration': 0.1})
        simulation_bag.write(tmp_path / 'played', values, [simulated(values)])
        words = [tmp_path / 'played', '--pause']
    process = launch(NODES[name], *words, '--ros-args', '-p', 'recorder.out:=bag')
    peer.call(Trigger, f'{name}/ready', Trigger.Request(), process)
    return name, process


def test_nothing_on_the_wire_ends_a_node(victim, peer):
    begun = time.monotonic()
    name, process = victim
    chance = random.Random(name)

    def ask(service, sent):
        found = peer.call(SERVICES[service], f'{name}/{service}', sent, process)
        assert found is not None, process.stderr
        return found

    def call(count):
        for _ in range(count):
            service = chance.choice([*SERVICES])
            ask(service, request(chance, SERVICES[service]))

    def publish(topic, kind, count):
        qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = peer.node.create_publisher(kind, topic, qos)
        peer.until(publisher.get_subscription_count)
        for k in range(count):
            publisher.publish(message(chance, kind))
            if k % 20 == 0:
                ask('list_parameters', srv.ListParameters.Request())
        peer.node.destroy_publisher(publisher)

    peer.see(f'/{name}')
    topics = [
        (topic, message_class(types[0]))
        for topic, types in peer.node.get_subscriber_names_and_types_by_node(name, '/')
    ]
    for topic, kind in topics:
        publish(topic, kind, 100)
    call(50)
    for law in LAWS if name == 'controller' else ():  # which it would load by and by
        chosen = Parameter(name='law', value=ParameterValue(type=4, string_value=law))
        result = ask('set_parameters', srv.SetParameters.Request(parameters=[chosen])).results[0]
        assert result.successful, result.reason
    before = process.memory
    call(CALLS)
    for topic, kind in topics:  # the player has none
        publish(topic, kind, MESSAGES // len(topics))
    assert process.memory - before < GROWTH
    names = ask('list_parameters', srv.ListParameters.Request()).result.names
    values = ask('get_parameters', srv.GetParameters.Request(names=names)).values
    assert len(values) == len(names) > 10
    assert process.stderr.count('unforeseen') <= 1 + time.monotonic() - begun  # one a second
    assert process.end(2) == 0, process.stderr
