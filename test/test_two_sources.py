"""Two sources of one number in a bag are compared, and a factor between them is told."""

import numpy as np
import pytest
from bags import JOINTS, streams, write_foreign

from parallel_robot.bags.run import recording, two_sources
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.units import HINGES
from parallel_robot_model.messages import layouts, topics

TIME = 1e-3 * np.arange(3000)
PHASE = np.array([0.0, 1.0, 2.5])
PERIODS = np.array([1.0, 1.3, 1.7])
REFERENCE = np.array([1.4132, 3.2876, -0.5166]) + 0.02 * np.sin(PERIODS * TIME[:, None] + PHASE)
TORQUE = 5.0 * np.cos(3.0 * PERIODS * TIME[:, None] + PHASE) + [1.0, -2.0, 0.5]


@pytest.fixture
def record(tmp_path):
    """Write a bag of others with these joints and efforts, and return its path."""

    def made(position=REFERENCE, effort=TORQUE):
        found = streams(REFERENCE, position, effort)
        data = layouts.float64_multi_array(3).records(len(TORQUE), data=np.roll(TORQUE, -1, 0))
        stamps = [stamp for stamp, _ in found[topics.COMMANDS]]
        found[topics.COMMANDS] = [
            (stamp, row.tobytes()) for stamp, row in zip(stamps, data, strict=True)
        ]
        write_foreign(tmp_path / 'bag', found)
        return tmp_path / 'bag'

    return made


def told(bag, word):
    return [line for line in recording.read(bag).log.warnings if word in line]


@pytest.mark.parametrize(
    ('change', 'line'),
    [
        (lambda e: 0.1 * e, 'efforts are 0.1 of the commands: currents'),
        (lambda e: 1000.0 * e, 'efforts are 1000 of the commands: are they in mN m?'),
        (lambda e: -e, 'efforts are -1 of the commands: is a sign wrong?'),
        (lambda e: e * [1, -1, 1], 'efforts of joint2 are -1 of the commands'),
        (lambda e: 0.8 * np.roll(e, 30, axis=0), 'efforts are 0.8 of the commands'),
        (lambda e: e[:, [1, 0, 2]], 'are the commands in the order joint2, joint1, joint3'),
        (lambda e: e * [0, 1, 1], 'efforts of joint1 are always 0, the commands are not'),
    ],
)
def test_efforts_that_are_no_commands_are_told_with_the_factor(record, change, line):
    [found] = told(record(effort=change(TORQUE)), 'commands')
    assert line in found


@pytest.mark.parametrize(
    'change',
    [
        lambda e: e + 0.02 * np.random.default_rng(1).normal(size=e.shape),
        lambda e: np.roll(e, 5, axis=0),
        lambda e: np.random.default_rng(1).permutation(e),  # of which nothing is clear
    ],
)
def test_efforts_with_noise_or_a_lag_are_the_commands(record, change):
    assert not told(record(effort=change(TORQUE)), 'commands')


@pytest.mark.parametrize(
    ('change', 'line'),
    [
        (np.degrees, 'joint1, joint2, joint3: 57.3 times the reference: are they in degrees?'),
        (np.radians, '0.0175 times the reference: are the references in degrees?'),
        (lambda p: 1000.0 * p, 'times the reference: are they in mrad?'),
        (lambda p: p * [1, 1, -1] + [0, 0, 0.4], 'joint3: -1 times the reference: is its sign'),
        (lambda p: p * [100, 1, 1], 'joint1: 100 times the reference: a gear'),
        (lambda p: p[:, [2, 0, 1]], 'in the order joint3, joint1, joint2: is --joints'),
        (lambda p: np.degrees(p[:1]) + 0.0 * p, '57.3 times the reference: are they in degrees?'),
    ],
)
def test_joints_in_another_unit_sign_or_order_than_the_reference_are_told(record, change, line):
    found = told(record(change(REFERENCE)), 'reference')
    assert any(line in each for each in found), found


def test_a_tracking_error_is_no_factor(record):
    """Late, with an offset and too small, as of a weak controller; or at rest beside it."""
    for position in (0.9 * np.roll(REFERENCE, 40, axis=0) + 0.1, REFERENCE[:1] + 0.0 * REFERENCE):
        difference = two_sources.positions(JOINTS, position, REFERENCE, 1e-3, HINGES)
        assert difference == two_sources.Contradiction()


def test_analyze_tells_the_factor_and_no_lag_of_commands_that_it_cannot_find(record, capsys):
    assert main(['analyze', str(record(effort=0.1 * TORQUE))]) == 0
    out, err = capsys.readouterr()
    assert err.count('efforts are 0.1 of the commands') == 1
    assert 'answered no state' not in out and 'real time' not in out
