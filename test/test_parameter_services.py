"""What a request may be before a node looks at it, and that it is taken as a whole."""

import contextlib

import pytest
import rclpy
import yaml
from assembly import simulated
from rcl_interfaces import srv
from rcl_interfaces.msg import Parameter as Message
from rcl_interfaces.msg import ParameterType, ParameterValue
from rclpy.parameter import (
    Parameter,
    get_parameter_value,
    parameter_dict_from_yaml_file,
    parameter_value_to_python,
)

from parallel_robot.analysis.monitor_node import MonitorNode
from parallel_robot.bags.player import PlayerOptions
from parallel_robot.bags.player_node import PlayerNode
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.bags.writing.recorder_node import RecorderNode
from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes import parameters
from parallel_robot_model.processes import realtime
from parallel_robot_sim.plant_node import PlantNode
from trajectory_gen.trajectory_node import TrajectoryNode

pytest_plugins = ['ros_fixtures']


@pytest.fixture
def service(node):
    """Parameter services of a controller."""
    return node(ControllerNode, topics.COMMANDS)[0]._parameter_service


def put(service, *messages):
    """Results of a request to set parameters."""
    request = srv.SetParameters.Request(parameters=messages)
    return service._set_parameters_callback(request, srv.SetParameters.Response()).results


def text(name, value):
    return Message(name=name, value=ParameterValue(type=4, string_value=value))


WRONG = {
    'no type': (
        [Message(name='law', value=ParameterValue(type=10))],
        "'law' has a value of unknown type 10",
    ),
    'not set': (
        [Message(name='smc.z', value=ParameterValue(type=0))],
        "'smc.z' has a value of unknown type 0",
    ),
    'long text': ([text('law', 10**7 * 'x')], "'law' has a value longer than 4096"),
    'long texts': (
        [Message(name='law', value=ParameterValue(type=9, string_array_value=['x' * 3000] * 2))],
        "'law' has a value longer than 4096",
    ),
    'long name': ([text('x' * 300, '')], 'a name of 300 characters; at most 256 are read'),
    'many': ([text('law', '')] * 100_000, '100001 parameters in one request; at most 1000 are'),
    'twice': ([text('law', 'smc'), text('law', 'pid')], "'law' is named twice"),
    'like one of ROS': ([text('use_sim_times', 'x')], "unknown parameter 'use_sim_times'"),
    'of a group of ROS': ([text('qos_overrides./x', 'x')], "unknown parameter 'qos_overrides./x'"),
    'read only': ([text('time_mode', 'later')], 'time_mode is fixed at the start of the node'),
    'of ROS, wrong': ([text('use_sim_time', 'x')], ''),
}


@pytest.mark.parametrize('wrong', WRONG)
def test_a_request_that_cannot_be_is_refused_as_a_whole(wrong, service):
    messages, reason = WRONG[wrong]
    before = service._get_node().get_parameter('smc.z').value
    good = Parameter('smc.z', value=0.5).to_parameter_msg()
    results = put(service, good, *messages)
    assert not any(result.successful for result in results) and len(results) <= 1000
    assert all(result.reason.startswith(reason) for result in results)
    assert service._get_node().get_parameter('smc.z').value == before


def bag(path):
    """A tenth of a second of the paper's circle."""
    values = config.resolve('paper_circle', {'duration': 0.1})
    simulation_bag.write(path, values, [simulated(values)])
    return path


STARTED = {
    'trajectory': lambda _: TrajectoryNode(),
    'plant': lambda _: PlantNode(),
    'controller': lambda _: ControllerNode(),
    'recorder': lambda _: RecorderNode(),
    'monitor': lambda _: MonitorNode(),
    'player': lambda path: PlayerNode(**PlayerOptions(str(bag(path)))._asdict()),
}
GIVEN = {  # to every node, as the launch file does; YAML makes false, a text and a number of them
    'recorder.out': "'2026'",
    'realtime': "'off'",
    'excitation.sine': '[0.00007, 0.0, 0.0]',
    'safety.damping': '[0.00007, 0.00001, 0.00002]',
    's_fotsmc.g': '0.00007',
}


@pytest.fixture(params=STARTED)
def any_service(request, domain, tmp_path, monkeypatch):
    """Parameter services of a node that was given some parameters, not all of them its own."""
    monkeypatch.chdir(tmp_path)
    words = [word for key, value in GIVEN.items() for word in ('-p', f'{key}:={value}')]
    rclpy.init(args=['--ros-args', *words, '--log-level', 'fatal'])
    with contextlib.ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        node = STARTED[request.param](tmp_path / 'bag')
        stack.callback(node.destroy_node)
        stack.callback(node.close)
        yield node._parameter_service


def dumped(service):
    """Name to value of every parameter."""
    found = service._list_parameters_callback(
        srv.ListParameters.Request(), srv.ListParameters.Response()
    )
    request = srv.GetParameters.Request(names=found.result.names)
    values = service._get_parameters_callback(request, srv.GetParameters.Response()).values
    return dict(zip(request.names, map(parameter_value_to_python, values), strict=True))


def test_what_was_dumped_can_be_loaded_again(any_service, tmp_path):
    """As `ros2 param dump` writes the file, and `ros2 param load` reads it."""
    before = dumped(any_service)
    file = tmp_path / 'dump.yaml'
    file.write_text(yaml.dump({'/**': {'ros__parameters': before}}, default_flow_style=False))
    results = put(any_service, *parameter_dict_from_yaml_file(str(file), True).values())
    assert len(results) == len(before)
    assert {result.reason for result in results if not result.successful} == set()
    assert dumped(any_service) == before


def test_a_node_that_hears_every_message_goes_before_normal_work():
    """Else requests wait behind its messages, on a busy machine for ever."""
    assert MonitorNode.priority == RecorderNode.priority == realtime.LISTENER > 0


def test_a_number_without_a_dot_is_a_number(service):
    """Which rclpy takes for a text."""
    assert get_parameter_value('7e-05').type == ParameterType.PARAMETER_STRING
    (result,) = put(service, text('s_fotsmc.g', '7e-05'))
    assert result.successful and dumped(service)['s_fotsmc.g'] == 7e-5
    (result,) = put(service, text('s_fotsmc.g', 'much'))
    assert result.reason == "s_fotsmc.g must be a number, not 'much'"


def test_a_refusal_names_what_is_wrong(any_service):
    """And nothing that could be set."""
    node = any_service._get_node()
    settable = {'plant': {'plant.steps': 5}, 'player': {'rate': 2.0}, 'controller': {'law': 'smc'}}
    own = [Parameter(k, value=v) for k, v in settable.get(node.get_name(), {}).items()]
    for key, reason in {
        'period': 'period is fixed at the start of the node',
        'start_stamp': 'start_stamp is set in a request of its own'
        if own
        else 'the node does not',
    }.items():
        changes = [*own, Parameter(key, value=2)]
        refused = node.set_parameters_atomically(changes)
        assert not refused.successful and refused.reason.startswith(reason)


@pytest.mark.parametrize('kind', ['Get', 'Describe', 'List'])
def test_a_question_that_is_too_long_is_not_looked_at(kind, service):
    names = ['law'] * (parameters.MAX_NAMES + 1)
    ask, field, answer = {
        'Get': ('get_parameters', 'names', 'values'),
        'Describe': ('describe_parameters', 'names', 'descriptors'),
        'List': ('list_parameters', 'prefixes', 'result'),
    }[kind]
    type_ = getattr(srv, f'{kind}Parameters')

    def call(count):
        request = type_.Request(**{field: names[:count]})
        found = getattr(service, f'_{ask}_callback')(request, type_.Response())
        return getattr(found, answer)

    assert call(len(names)) == getattr(type_.Response(), answer) != call(3)
