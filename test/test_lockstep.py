"""Real nodes in lockstep: nothing hurries, and the bytes are those of the simulation."""

import math
from contextlib import ExitStack

import pytest
from bags import content
from domain_coordinator import domain_id
from foreign_laws import made

from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_model.messages.topics import TELEMETRY

pytest_plugins = ['ros_fixtures']

COMMAND_LINE = 'parallel_robot.cli.command_line'
FULL = ('joint_states', 'reference', 'effort_controller/commands')
SLOW = ('pose', 'pose_reference', 'controller/answered', *(each.name for each in TELEMETRY))
LATCHED = ('controller/active_law', 'controller/status')


def streams(bag):
    """(log time, payload) of every message, by topic."""
    (file,) = bag.glob('*.mcap')
    return content(file)


def test_lockstep_gives_the_bytes_of_the_simulation(launch, tmp_path):
    words = ('paper_circle', '--duration', '0.5', '--out')
    with ExitStack() as stack:
        processes = []
        for name in ('first', 'second'):  # at once: what one does to the other's load is no matter
            environment = {
                'ROS_DOMAIN_ID': str(stack.enter_context(domain_id())),
                'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            }
            process = launch(COMMAND_LINE, 'run', *words, name, '--time-mode', 'lockstep',
                             **environment)  # fmt: skip
            processes.append(process)
        for process in processes:
            assert process.wait() == 0, process.stderr
    assert main(['simulate', *words, str(tmp_path / 'third')]) == 0
    first, second, third = (streams(tmp_path / name) for name in ('first', 'second', 'third'))
    counts = {topic: len(stream) for topic, stream in first.items()}
    assert counts == {
        **dict.fromkeys(FULL, 501), **dict.fromkeys(SLOW, 51), **dict.fromkeys(LATCHED, 1)
    }  # fmt: skip
    for topic in first:
        assert first[topic] == second[topic] == third[topic]
    assert main(['replay', str(tmp_path / 'first')]) == 0


IMPERFECT = {
    'seed': 3, 'sensor.position_noise': 1e-5, 'sensor.differentiate': True,
    'sensor.delay': 1e-3, 'sensor.jitter': 1e-3, 'actuator.lag': [1e-3, 2e-3, 3e-3],
    'actuator.delay': 1e-3, 'actuator.noise': 0.1, 'disturbance.noise': 0.1,
    'disturbance.bandwidth': 20.0, 'estimator.kind': 'filter',
    'estimator.delay': 'identify', 'lock_in.frequency': 100.0, 'lock_in.torque': 20.0,
    'lock_in.start': 0.05, 'lock_in.duration': 0.2,
}  # fmt: skip
OLD = {
    'seed': 3, 'sensor.position_noise': 1e-5, 'sensor.velocity_noise': 0.01,
    'sensor.delay': 0.023, 'sensor.stamp': 'measured', 'disturbance.noise': 0.1,
    'law': 'observer_s_fotsmc', 'approach.duration': 0.2, 'estimator.delay': 1e-3,
}  # fmt: skip


LEARNING = {
    'circle.radius': 0.001, 'circle.rate': 20.0 * math.pi, 'repetition.gain': 0.5,
    'repetition.cutoff': 50.0, 'repetition.wait': 0.02, 'law': 'lqg_tracking',
}  # fmt: skip
SELDOM = {'period': 0.008}  # as drives with 125 Hz; t = 0 is not at 1 s


@pytest.mark.parametrize('changes', [IMPERFECT, OLD, SELDOM, LEARNING])
def test_an_imperfect_robot_gives_the_bytes_of_the_simulation(changes, launch, domain, tmp_path):
    words = ['paper_circle', '--duration', '0.3', '--out']
    sets = [word for key, value in changes.items() for word in ('--set', f'{key}={value}')]
    process = launch(COMMAND_LINE, 'run', *words, 'nodes', '--time-mode', 'lockstep', *sets)
    assert process.wait() == 0, process.stderr
    assert main(['simulate', *words, str(tmp_path / 'simulated'), *sets]) == 0
    nodes, simulated = streams(tmp_path / 'nodes'), streams(tmp_path / 'simulated')
    assert nodes == simulated
    assert len(nodes['joint_states']) == round(0.3 / changes.get('period', 1e-3)) + 1
    assert main(['replay', str(tmp_path / 'nodes')]) == 0


def test_a_law_in_c_gives_the_bytes_of_the_simulation(launch, domain, tmp_path):
    words = ('paper_circle', '--duration', '0.3', '--law', str(made(tmp_path / 'c_law.so')))
    process = launch(COMMAND_LINE, 'run', *words, '--out', 'nodes', '--time-mode', 'lockstep')
    assert process.wait() == 0, process.stderr
    assert main(['simulate', *words, '--out', str(tmp_path / 'simulated')]) == 0
    nodes, simulated = streams(tmp_path / 'nodes'), streams(tmp_path / 'simulated')
    assert nodes == simulated and len(nodes['effort_controller/commands']) == 301


@pytest.mark.usefixtures('page_alone')
def test_two_robots_share_a_domain(launch, domain, tmp_path):
    runs = {
        name: launch(COMMAND_LINE, 'run', 'paper_circle', '--duration', 0.2, '--out', name,
                     '--time-mode', 'lockstep', '--namespace', space)
        for name, space in {'first': 'left', 'second': 'cell/right'}.items()
    }  # fmt: skip
    for process in runs.values():
        assert process.wait() == 0, process.stderr
    bags = [tmp_path / name for name in ('simulated', *runs)]
    assert main(['simulate', 'paper_circle', '--duration', '0.2', '--out', str(bags[0])]) == 0
    first, second, third = map(streams, bags)
    assert first == second == third and len(first['joint_states']) == 201
    past = recording.read(tmp_path / 'second').history
    assert {node.rpartition('/')[0] for node in past.parameters} == {'/cell/right'}
    for words in ('analyze',), ('replay',), ('report', '--out', str(tmp_path / 'report')):
        assert main([*words[:1], str(tmp_path / 'second'), *words[1:]]) == 0
