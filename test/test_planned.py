"""A motion drawn before it runs."""

import numpy as np
import pytest

from parallel_robot.analysis.report.planned import figure_of_motion
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import simulate

SMOOTH = {'duration': 6.0, 'friction.coulomb': 0.0}


def drawn(scenario, **changes):
    made = configure(resolve(scenario, changes))
    return made, figure_of_motion(made).axes


def test_path_robot_and_joints_are_those_of_the_motion():
    made, (path, position, speed, torque) = drawn('paper_line', **SMOOTH)
    grid = np.linspace(0.0, 6.0, 6001)
    reference = made.trajectory.sample(grid)
    lines = {line.get_label(): line for line in path.lines}
    assert np.allclose(lines['path'].get_xydata(), 1e3 * reference.pose[:, :2])
    assert any(np.hypot(*np.ptp(line.get_xydata(), axis=0)) > 399 for line in path.lines)  # a link
    for axes, values in ((position, reference.position), (speed, reference.velocity)):
        for line, column in zip(axes.lines, values.T, strict=False):
            assert np.allclose(line.get_xydata(), np.stack([grid, column], axis=1))
    assert 'limit 10' in speed.get_title(loc='left') and 'limit 200' in torque.get_title(
        loc='left'
    )
    run = simulate(configure(resolve('paper_line', {
        **SMOOTH, 'law': 'computed_torque', 'plant.initial_pose': reference.pose[0],
    }))).run  # fmt: skip
    for line, effort in zip(torque.lines, run.effort.T, strict=False):
        assert np.abs(line.get_ydata() - effort)[100:-100].max() < 0.15


def test_limits_that_are_near_are_drawn_and_axes_have_no_path():
    _, (position, speed, torque) = drawn('axes_step', **{'safety.speed_limit': 1.5})
    assert len(position.lines) == len(torque.lines) == 5 and len(speed.lines) == 15
    assert {abs(line.get_ydata()[0]) for line in speed.lines[5:]} == {1.5}


@pytest.mark.parametrize(
    ('name', 'reason'),
    [('a.txt', 'picture format'), ('there.png', 'cannot write'), ('there.png/a.png', 'directory')],
)  # fmt: skip
def test_a_picture_that_cannot_be_written_costs_one_line(
    name, reason, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'there.png').write_bytes(b'mine')
    assert main(['show', 'paper_circle', '--plot', name]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and reason in error
    assert (tmp_path / 'there.png').read_bytes() == b'mine'
