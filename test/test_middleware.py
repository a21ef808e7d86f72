"""The transport is chosen before rclpy starts, unless the user has chosen one."""

import os

import pytest
from rclpy._rclpy_pybind11 import RCLError

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.nodes import middleware
from parallel_robot_model.nodes.middleware import (
    DISCOVERY_RANGE,
    LOCALHOST_ONLY,
    PROFILES,
    TRANSPORTS,
    USER_PROFILES,
    USER_VARIABLES,
)


@pytest.fixture(autouse=True)
def _nothing_set(monkeypatch, tmp_path):
    for name in (DISCOVERY_RANGE, LOCALHOST_ONLY, *USER_VARIABLES):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)


def in_force(choice='udp'):
    """Text, and the variables that Fast DDS sees."""
    before = dict(os.environ)
    with middleware.chosen_transport(choice) as text:
        seen = {
            name: os.environ[name] for name in os.environ if os.environ[name] != before.get(name)
        }
        gone = {name: None for name in before if name not in os.environ}
    assert dict(os.environ) == before
    return text, seen | gone


@pytest.mark.parametrize('scope', [None, 'SUBNET', 'OFF', 'SYSTEM_DEFAULT'])
def test_beyond_this_host_udp_is_a_builtin_transport(scope, monkeypatch):
    if scope:
        monkeypatch.setenv(DISCOVERY_RANGE, scope)
    text, changes = in_force()
    assert text == 'rmw_fastrtps_cpp, UDP'
    assert changes.pop(PROFILES).endswith('config/middleware/udp.xml')
    assert changes == {TRANSPORTS: 'UDPv4'}


@pytest.mark.parametrize(
    'variables', [{DISCOVERY_RANGE: 'LOCALHOST'}, {LOCALHOST_ONLY: '1', DISCOVERY_RANGE: 'SUBNET'}]
)
def test_on_this_host_udp_takes_a_profile(variables, monkeypatch):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    text, changes = in_force()
    assert text == 'rmw_fastrtps_cpp, UDP'
    assert changes.pop(PROFILES).endswith('config/middleware/udp_localhost.xml')
    assert changes.pop(DISCOVERY_RANGE) == 'SYSTEM_DEFAULT'
    assert changes == dict.fromkeys(set(variables) & {LOCALHOST_ONLY})


def test_the_environment_is_as_before_after_an_error():
    with pytest.raises(InputError), middleware.chosen_transport('udp'):
        raise InputError('wrong')
    assert TRANSPORTS not in os.environ


@pytest.mark.parametrize('name', USER_VARIABLES)
@pytest.mark.parametrize('choice', ['udp', 'default'])
def test_what_the_user_has_set_stays(name, choice, monkeypatch):
    monkeypatch.setenv(name, 'something')
    assert in_force(choice) == (f'rmw_fastrtps_cpp, as {name} says', {})


def test_a_profile_of_the_user_in_the_current_directory_stays(tmp_path):
    (tmp_path / USER_PROFILES).write_text('<profiles/>')
    assert in_force() == (f'rmw_fastrtps_cpp, as {USER_PROFILES} says', {})


def test_the_default_and_other_middleware_stay_as_they_are(monkeypatch):
    assert in_force('default') == ('rmw_fastrtps_cpp, its default', {})
    monkeypatch.setattr(middleware, 'get_rmw_implementation_identifier', lambda: 'rmw_other')
    assert in_force() == ('rmw_other, its default', {})


FILES = {
    'all.yaml': '/**:\n  ros__parameters:\n    middleware: default\n',
    'one.yaml': 'ns:\n  plant:\n    ros__parameters: {law: smc, middleware: default}\n',
    'none.yaml': '/**:\n  ros__parameters: {law: smc}\n',
    'odd.yaml': '- 1\n',
    'broken.yaml': 'a: [',
    'empty.yaml': '',
}


@pytest.mark.parametrize(
    ('words', 'value'),
    [
        ('', 'udp'),
        ('--ros-args -p law:=smc', 'udp'),
        ('--ros-args -p middleware:=default', 'default'),
        ('--ros-args -p middleware:="default"', 'default'),
        ('--ros-args --param plant:middleware:=default', 'default'),
        ('--ros-args -p middleware:=default -p middleware:=udp', 'udp'),
        ('--ros-args -p middleware:=tcp', 'tcp'),  # the node refuses it
        ('--ros-args --params-file all.yaml', 'default'),
        ('--ros-args --params-file one.yaml', 'default'),
        ('--ros-args --params-file all.yaml --params-file none.yaml', 'default'),
        ('--ros-args --params-file all.yaml -p middleware:=udp', 'udp'),
        ('--ros-args --params-file odd.yaml', 'udp'),
        ('--ros-args --params-file broken.yaml', 'udp'),
        ('--ros-args --params-file empty.yaml', 'udp'),
        ('--ros-args --params-file missing.yaml', 'udp'),
        ('--ros-args -p', 'udp'),
    ],
)
def test_the_parameter_is_known_from_the_command_line(words, value, tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    assert middleware.requested_middleware(['node', *words.split()]) == value


def test_a_value_that_comes_too_late_is_refused():
    middleware.check_middleware('udp', 'udp')
    with pytest.raises(InputError, match='-p middleware:=default'):
        middleware.check_middleware('default', 'udp')


@pytest.mark.parametrize(
    ('said', 'hint'),
    [
        ("failed to initialize logging: Failed to create log directory '/x'", 'ROS_LOG_DIR'),
        ('error creating node: Unable to resolve peer nobody\n, at here', 'ROS_STATIC_PEERS'),
    ],
)
def test_a_middleware_that_does_not_start_says_why_in_one_line(said, hint):
    with pytest.raises(InputError) as caught, middleware.wrap_rcl_errors():
        raise RCLError(said)
    assert ' '.join(said.split()) in str(caught.value) and hint in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_log_without_a_place_is_told_before_rcl_does(monkeypatch):
    for name in middleware.LOG_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(InputError, match='set ROS_LOG_DIR'), middleware.wrap_rcl_errors():
        pass
