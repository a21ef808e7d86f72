"""Bags of joint states alone: the robot and the noise of its sensors are told by them."""

import json
from contextlib import ExitStack

import numpy as np
import pytest
from bags import JOINTS, MS, START, STORE, content, streams, write_foreign

import parallel_robot as pr
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.live.bag_source import open_bag
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages.topics import COMMANDS, JOINT_STATES, REFERENCE


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """A bag that excites, with all topics and of its joint states alone."""
    folder = tmp_path_factory.mktemp('bags')
    run = pr.simulate('excitation', law='pid', duration=4, **{'sensor.position_noise': 1e-6})
    pr.save(run, folder / 'whole')
    [file] = (folder / 'whole').glob('*.mcap')
    states = content(file)[JOINT_STATES.name]
    write_foreign(folder / 'states', {JOINT_STATES: states})
    return folder / 'whole', folder / 'states'


def test_joint_states_alone_identify_as_the_whole_bag_does(bags):
    whole, alone = (pr.identify(bag) for bag in bags)
    assert 'robot.mp' in alone.values
    for key, value in whole.values.items():
        if not key.startswith('estimator'):  # a reference says where the robot is to rest
            np.testing.assert_allclose(alone.values[key], value, rtol=1e-3, err_msg=key)


def test_the_run_has_neither_references_nor_commands(bags):
    log = recording.read(bags[1], motion_only=True).log
    assert np.isnan(log.reference_position).all() and not log.referenced.any()
    assert not len(log.command) and {REFERENCE.name, COMMANDS.name}.isdisjoint(log.messages)
    assert np.isfinite(log.position).all() and len(log.position) == 4001


def test_a_robot_at_rest_tells_its_noise(tmp_path):
    noise = 1e-5 * np.random.default_rng(0).normal(size=(2000, 3))
    found = streams(np.ones((2000, 3)), 1.0 + noise)
    write_foreign(tmp_path / 'bag', {JOINT_STATES: found[JOINT_STATES]})
    rest = pr.sensor_noise(tmp_path / 'bag')
    np.testing.assert_allclose(rest.position, 1e-5, rtol=0.1)


def test_without_efforts_or_commands_there_is_no_torque(tmp_path, capsys):
    way = np.sin(0.01 * np.arange(2000))[:, np.newaxis] * np.ones(3)
    found = streams(way, way)
    write_foreign(tmp_path / 'bag', {JOINT_STATES: found[JOINT_STATES]})
    assert main(['identify', str(tmp_path / 'bag')]) == 2
    error = capsys.readouterr().err
    assert 'effort' in error and error.count('\n') == 1


@pytest.mark.parametrize(
    ('field', 'told'), [('velocity', 'velocity'), ('effort', 'effort'), (None, 'names')]
)
@pytest.mark.parametrize('command', ['analyze', 'export', 'identify', 'report'])
def test_states_without_positions_cost_one_line(tmp_path, capsys, command, field, told):
    none, way = np.zeros(0), np.sin(0.01 * np.arange(200))
    state = STORE.types['sensor_msgs/msg/JointState']
    head, time = map(STORE.types.get, ('std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
    found = []
    for k, angle in enumerate(way):
        numbers = {'position': none, 'velocity': none, 'effort': none}
        numbers |= {field: np.full(3, angle)} if field else {}
        message = state(head(time(5, k * MS), ''), list(JOINTS), **numbers)
        found.append((START + k * MS, STORE.serialize_cdr(message, state.__msgtype__)))
    write_foreign(tmp_path / 'bag', {JOINT_STATES: found})
    out = [] if command in ('analyze', 'identify') else ['--out', str(tmp_path / 'out.csv')]
    assert main([command, str(tmp_path / 'bag'), *out]) == 2
    output, error = capsys.readouterr()
    told = 'no messages on reference' if command == 'report' else f'have {told} alone, no position'
    assert told in error and error.count('\n') == 1 and not output
    assert not (tmp_path / 'out.csv').exists()


def test_what_needs_a_reference_says_so(bags):
    with pytest.raises(BagError, match='no messages on reference'):
        recording.read(bags[1])


def test_joint_states_alone_are_exported_analysed_and_shown(tmp_path, capsys):
    count = 300
    position = (
        np.tile([1.4132, 3.2876, -0.5166], (count, 1)) + 1e-4 * np.arange(count)[:, np.newaxis]
    )
    found = streams(position, position, np.full((count, 3), 0.5))
    write_foreign(tmp_path / 'bag', {JOINT_STATES: found[JOINT_STATES]})
    bag = str(tmp_path / 'bag')
    assert main(['export', bag, '--out', str(tmp_path / 'run.csv')]) == 0
    err = capsys.readouterr().err
    assert 'no messages on reference' in err and 'no messages on effort_controller/commands' in err
    table = np.genfromtxt(tmp_path / 'run.csv', delimiter=',', names=True)
    assert (
        np.isfinite(table['platform_x_m']).all() and np.isfinite(table['joint1_effort_nm']).all()
    )
    for name in ('platform_reference_x_m', 'platform_error_m', 'joint1_reference_position_rad'):
        assert np.isnan(table[name]).all()
    assert main(['analyze', bag]) == 0
    out = capsys.readouterr().out
    assert '300 states in 0.299 s, one in 1 ms: no reference' in out and '0.5000' in out
    words = ['--json', str(tmp_path / 'x.json'), '--figure', str(tmp_path / 'x.svg')]
    assert main(['analyze', bag, *words]) == 0
    assert json.loads((tmp_path / 'x.json').read_text())['states'] == 300
    assert '<svg' in (tmp_path / 'x.svg').read_text()
    capsys.readouterr()
    assert main(['replay', bag, '--law', 'pid']) == 2
    assert 'simulate follows the joints that export writes' in capsys.readouterr().err
    assert main(['report', bag, '--out', str(tmp_path / 'report')]) == 2
    assert 'no messages on reference' in capsys.readouterr().err
    with ExitStack() as stack:
        assert open_bag(stack, tmp_path / 'bag', False).look()


def test_states_and_references_without_commands_are_analysed(tmp_path, capsys):
    position = np.tile([1.4132, 3.2876, -0.5166], (300, 1)) + 1e-4 * np.arange(300)[:, np.newaxis]
    found = streams(position + 1e-3, position, np.full((300, 3), 0.5))
    del found[COMMANDS]
    write_foreign(tmp_path / 'bag', found)
    words = ['analyze', str(tmp_path / 'bag'), '--json', str(tmp_path / 'run.json')]
    assert main(words) == 0
    result = json.loads((tmp_path / 'run.json').read_text())
    assert (
        result['torque']['max_nm'] == 0.5
        and 'effort_controller/commands' not in result['messages']
    )
    assert 'no messages on effort_controller/commands' in capsys.readouterr().err


def test_a_motion_of_others_cannot_be_run_again(bags, capsys):
    assert main(['rerun', str(bags[1])]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'does not say what experiment made it' in error
