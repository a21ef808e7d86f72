"""What a request may be before a node looks at it, and that it is taken as a whole."""

import pytest
from rcl_interfaces import srv
from rcl_interfaces.msg import Parameter as Message
from rcl_interfaces.msg import ParameterValue
from rclpy.parameter import Parameter

from parallel_robot_base import topics
from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_ros import parameter_services as services

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


def test_what_was_dumped_can_be_loaded_again(service):
    """A value that is fixed and stays as it is is no change."""
    found = service._list_parameters_callback(
        srv.ListParameters.Request(), srv.ListParameters.Response()
    )
    request = srv.GetParameters.Request(names=found.result.names)
    values = service._get_parameters_callback(request, srv.GetParameters.Response()).values
    assert len(values) > 100
    dumped = [Message(name=n, value=v) for n, v in zip(request.names, values, strict=True)]
    result, *others = put(service, *dumped)
    assert result.successful, result.reason
    assert all(other == result for other in others)
    again = service._get_parameters_callback(request, srv.GetParameters.Response()).values
    assert again == values


@pytest.mark.parametrize('kind', ['Get', 'Describe', 'List'])
def test_a_question_that_is_too_long_is_not_looked_at(kind, service):
    names = ['law'] * (services.MOST_NAMES + 1)
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
