"""Bags of joint states alone: the robot and the noise of its sensors are told by them."""

import numpy as np
import pytest
from bags import content, streams, write_foreign

import parallel_robot as pr
from parallel_robot.bags import recording
from parallel_robot.cli.command_line import main
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
    rest = pr.identify(tmp_path / 'bag', rest=True)
    np.testing.assert_allclose(rest.position, 1e-5, rtol=0.1)


def test_without_efforts_or_commands_there_is_no_torque(tmp_path, capsys):
    way = np.sin(0.01 * np.arange(2000))[:, np.newaxis] * np.ones(3)
    found = streams(way, way)
    write_foreign(tmp_path / 'bag', {JOINT_STATES: found[JOINT_STATES]})
    assert main(['identify', str(tmp_path / 'bag')]) == 2
    error = capsys.readouterr().err
    assert 'effort' in error and error.count('\n') == 1


def test_what_needs_a_reference_says_so(bags):
    with pytest.raises(BagError, match='no messages on reference'):
        recording.read(bags[1])
