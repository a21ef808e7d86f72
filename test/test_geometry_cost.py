"""What geometry alone costs, against closed forms and a run that follows its joints."""

import numpy as np
import pytest

import parallel_robot as pr
from parallel_robot.cli.command_line import main
from parallel_robot.studies.calm import least_error
from parallel_robot_control.configuration import resolve
from parallel_robot_sim.configuration import configure


def cost(scenario, **changes):
    return least_error(configure(resolve(scenario, {'duration': 2.0} | changes))).geometry


def test_the_exact_robot_costs_nothing():
    assert cost('paper_circle') < 1e-12


def test_a_longer_link_of_an_arm_moves_the_tip_along_the_link():
    """x = l1 u(q1) + l2 u(q1 + q2): a longer l1 moves the tip by as much."""
    assert cost('serial_2r_circle', **{'true_robot.l1': 0.3007}) == pytest.approx(7e-4, rel=1e-9)


def test_a_zero_angle_of_a_shoulder_turns_the_arm():
    """A chord of the angle, at the distance of the tip from the shoulder."""
    found = cost('serial_2r_circle', **{'sensor.zero_angle': [0.01, 0.0]})
    times = np.arange(1.0, 2.0, 0.02)  # the second half
    path = np.array([0.3, 0.3]) + 0.05 * np.column_stack(
        [np.cos(np.pi / 3.0 * times), np.sin(np.pi / 3.0 * times)]
    )
    chord = 2.0 * np.sin(0.005) * np.sqrt(np.mean(np.sum(path**2, axis=1)))
    assert found == pytest.approx(chord, rel=1e-3)


def test_a_moved_base_moves_the_platform_as_much():
    moved = {'true_robot.base_x': [3e-4, 1.0003, 0.5003]}
    assert cost('paper_circle', **moved) == pytest.approx(3e-4, rel=1e-6)


def test_zero_angles_of_axes_are_their_errors_unless_they_are_known():
    zero = {'sensor.zero_angle': [1e-3, 0.0, 0.0, 0.0, 2e-3]}
    assert cost('axes_step', **zero) == pytest.approx(1e-3, rel=1e-12)  # of five joints
    known = {'estimator.zero_angle': zero['sensor.zero_angle']}
    assert cost('axes_step', **zero, **known) == 0.0


def test_a_law_that_holds_its_joints_has_that_error():
    wrong = {'true_robot.l2': 0.6004, 'sensor.zero_angle': [3e-4, -2e-4, 1e-4]}
    run = pr.simulate('paper_circle', law='observer_s_fotsmc', duration=4, **wrong)
    expected = cost('paper_circle', duration=4.0, **wrong)
    assert pr.metrics(run)['xy_rms_m'] == pytest.approx(expected, rel=0.02)


def test_the_table_has_a_line_for_it(capsys):
    wrong = {'true_robot.base_y': [1e-4, 1e-4, 0.8661254]}
    frame = pr.limit('paper_circle', duration=1, **wrong)
    assert frame.geometry_m[0] == pytest.approx(1e-4, rel=1e-3)
    words = ['--duration', '1', '--set', 'true_robot.base_y=[1e-4, 1e-4, 0.8661254]']
    assert main(['limit', 'paper_circle', *words]) == 0
    [line] = [line for line in capsys.readouterr().out.splitlines() if 'geometry as it is' in line]
    assert float(line.split()[-1]) == pytest.approx(100.0, rel=1e-3)  # in µm
