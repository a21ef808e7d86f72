"""Processes that join a loop and leave: nothing of the loop is in shared memory, nothing stops."""

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import DescribeParameters, GetParameters
from ros_fixtures import SLOW_LOOP

from benchmarks.joins import TRANSIENT, joins
from parallel_robot.analysis.replay import replayed
from parallel_robot.bags.run import recording
from parallel_robot_control.configuration import configure
from parallel_robot_model.configuration import config
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

RAMP = 200.0  # N m/s, of SLOW_LOOP


@pytest.mark.endurance
def test_a_loop_that_ten_processes_join_goes_on_without_a_jump(compiled, domain, tmp_path):
    words = [word for key in SLOW_LOOP for word in ('--set', key.replace(':=', '='))]
    words += ['--set', 'plant.command_timeout=5']
    words += ['--set', 'safety.residual_limit=20']  # the disturbance is no obstacle
    for word in ('amplitude=[5, 5, 5]', 'phase=[1, 1, 1]', 'frequency=0.1'):
        words += ['--set', f'disturbance.{word}']  # under which the laws differ by 4 N m
    changes = ([], ['law=smc'], ['smc.z=18'], [], ['law=computed_torque'])
    bag = tmp_path / 'bag'
    found = joins(10, bag, *words, changes=changes, together=5)
    assert found.joins == 10 and not found.faults
    assert found.granted.startswith('rmw_fastrtps_cpp, UDP; ')
    log, past, _ = recording.read(bag)
    rows = np.flatnonzero((log.time > TRANSIENT) & ~np.isnan(log.answer).any(axis=1))
    steps = np.abs(np.diff(log.answer[rows], axis=0))
    ramp = RAMP * np.diff(log.time[rows])[:, np.newaxis]
    laws = {'law': 'computed_torque'}, {'law': 'smc'}, {'law': 'smc', 'smc.z': 18.0}
    demands = [demanded(log, past, law)[rows] for law in laws]
    assert steps.max() > 0.0
    assert np.all(steps <= ramp + np.abs(np.diff(demands, axis=1)).max(axis=0) + 1e-9)
    # A jump between the laws would be seen.
    assert np.ptp(demands, axis=0).max() > 3.0 > 2.0 * ramp.min()
    # The motors had the torques of these commands, and no others.
    answers = set(map(tuple, log.answer))
    assert all(tuple(torque) in answers for torque in log.effort[rows])


def demanded(log, past, law):
    """What a law would have asked for at each state, had it run [N m], shape (N, n)."""
    configuration = configure(config.changed(log.config, law))
    return replayed.instead(log, past, configuration).torque


@pytest.mark.parametrize(
    ('choice', 'text', 'shared'),
    [('udp', 'rmw_fastrtps_cpp, UDP', False), ('default', 'rmw_fastrtps_cpp, its default', True)],
)
def test_a_node_says_what_it_was_granted(choice, text, shared, launch, peer, tmp_path):
    file = tmp_path / 'parameters.yaml'
    file.write_text(f'/**:\n  ros__parameters:\n    middleware: {choice}\n    realtime: off\n')
    plant = launch(MODULES['plant'], '--ros-args', '--params-file', file)
    told = {}
    peer.node.create_subscription(
        DiagnosticArray,
        '/diagnostics',
        lambda array: told.update({item.key: item.value for item in array.status[0].values}),
        10,
    )
    peer.until(lambda: told or not plant.running)
    assert told['middleware'] == text and told['real-time priority'] == 'normal'

    names = ['granted.realtime', 'granted.middleware']
    request = GetParameters.Request(names=names)
    answer = peer.call(GetParameters, 'plant/get_parameters', request, plant)
    assert [value.string_value for value in answer.values] == ['normal', text]
    request = DescribeParameters.Request(names=names)
    answer = peer.call(DescribeParameters, 'plant/describe_parameters', request, plant)
    assert all(one.read_only and one.description for one in answer.descriptors)

    maps = Path(f'/proc/{plant._popen.pid}/maps').read_text()
    assert ('/dev/shm/fastrtps' in maps) == shared


def test_a_file_with_several_transports_is_refused(launch, domain, tmp_path):
    file = tmp_path / 'parameters.yaml'
    sections = ('plant', 'udp'), ('other', 'default')
    file.write_text(
        ''.join(f'{node}:\n  ros__parameters: {{middleware: {at}}}\n' for node, at in sections)
    )
    plant = launch(MODULES['plant'], '--ros-args', '--params-file', file)
    assert plant.wait() == 2
    assert plant.stderr == (
        'parallel_robot: middleware is udp, which was not known when the node chose default: '
        'set it by -p middleware:=udp\n'
    )


def test_the_strict_time_outs_are_a_parameter_file(launch, peer):
    file = config.directory() / 'hardware' / 'strict.yaml'
    plant = launch(MODULES['plant'], '--ros-args', '--params-file', file)
    names = ['plant.command_timeout', 'safety.state_timeout']
    request = GetParameters.Request(names=names)
    answer = peer.call(GetParameters, 'plant/get_parameters', request, plant)
    assert [value.double_value for value in answer.values] == [0.05, 0.02]
