"""The fastest feasible speed of a motion against closed forms and the simulated plant."""

import json

import numpy as np
import pytest

from parallel_robot import simulate
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError, MotionError
from parallel_robot_model.configuration import config
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.fastest import fastest
from trajectory_gen.configuration import trajectory_of

STRONG = {'safety.torque_limit': 1e6, 'plant.torque_limit': 1e6}


def found(scenario='paper_circle', **changes):
    return fastest(configure(resolve(scenario, changes)))


def test_a_motion_that_runs_faster_has_scaled_derivatives():
    t = np.linspace(0.0, 2.0, 50)
    usual = trajectory_of(config.resolve('paper_line')).sample(3.0 * t)
    made = trajectory_of(config.resolve('paper_line', {'trajectory.speed_factor': 3.0}))
    fast = made.sample(t)
    assert made.span == 2.0
    for factor, name in ((1, 'pose'), (1, 'position'), (3, 'velocity'), (9, 'acceleration')):
        assert np.allclose(getattr(fast, name), factor * getattr(usual, name), rtol=1e-12)


def test_axes_are_limited_by_the_speed_of_the_quintic():
    made = found('axes_step', **STRONG)  # largest rate of the quintic: 15/8 way / duration
    assert abs(made.factor / (10.0 / (1.875 * 1.5 / 2.0)) - 1.0) < 2e-4
    assert 'axis1 is at 10 rad/s' in made.text and abs(made.span * made.factor - 2.0) < 1e-12


@pytest.mark.parametrize('way', [1.5, -1.5])
def test_axes_are_limited_by_torque_against_inertia_and_friction(way):
    made = found('axes_step', **{'safety.torque_limit': 5.0, 'trajectory.max_joint_speed': 1e3,
                                 'safety.speed_limit': 1e3, 'move.end': [way] * 5})  # fmt: skip
    u = np.linspace(0.0, 1.0, 20001)
    rate = 1.5 / 2.0 * 30.0 * u**2 * (1.0 - u) ** 2
    second = 1.5 / 4.0 * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
    k = made.factor  # axis 5 has the largest inertia and friction
    torque = np.abs(0.5 * k**2 * second + 0.8 * k * rate + 0.15 * np.sign(rate))
    assert abs(torque.max() - 5.0) < 2e-3 and 'axis5 is at 5 N m' in made.text


@pytest.mark.parametrize('scenario', ['paper_circle', 'serial_2r_circle'])
def test_at_the_fastest_speed_the_plant_needs_the_torque_of_the_limit(scenario):
    limit = {'paper_circle': 40.0, 'serial_2r_circle': 45.0}[scenario]
    made = found(scenario, **{'safety.torque_limit': limit})
    start = trajectory_of(resolve(scenario)).sample(0.0).pose[0]
    run = simulate(
        scenario, law='computed_torque', duration=2.0 * made.span,
        **{'trajectory.speed_factor': made.factor, 'plant.initial_pose': start},
    )  # fmt: skip
    later = np.abs(run.torque[len(run.time) // 2 :])
    assert 'N m' in made.text and abs(later.max() / limit - 1.0) < 0.05


def test_a_gear_that_resists_what_it_transmits_takes_its_share_of_the_torque():
    limits = {'safety.torque_limit': 5.0, 'trajectory.max_joint_speed': 1e3}
    made = found('axes_step', **limits, **{'safety.speed_limit': 1e3, 'friction.load': 0.25})
    u = np.linspace(0.0, 1.0, 20001)
    rate = 1.5 / 2.0 * 30.0 * u**2 * (1.0 - u) ** 2
    inertia = 0.5 * made.factor**2 * 1.5 / 4.0 * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)
    torque = inertia + 0.25 * np.abs(inertia) + 0.8 * made.factor * rate + 0.15 * np.sign(rate)
    assert abs(np.abs(torque).max() - 5.0) < 2e-3


def test_what_no_speed_helps_is_refused():
    with pytest.raises(InputError, match='stands still'):
        found(**{'trajectory.shape': 'hold'})
    with pytest.raises(InputError, match='do not hold shoulder'):
        found('serial_2r_circle', **{'safety.torque_limit': 1.0})
    with pytest.raises(MotionError, match=r'type 1|type 2|out of reach'):
        found(**{'circle.radius': 0.25, 'trajectory.max_condition': 3.0})


def test_a_motion_that_is_too_fast_is_run_at_a_share_of_its_fastest(tmp_path, capsys):
    words = ['paper_circle', '--set', 'circle.rate=1000.0', '--duration', '0.02']
    assert main(['simulate', *words, '--out', str(tmp_path / 'a')]) == 2
    assert 'above trajectory.max_joint_speed' in capsys.readouterr().err
    assert main(['show', *words[:3], '--fit-speed']) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith('fastest: trajectory.speed_factor 0.0')
    assert main(['show', *words[:3], '--fit-speed', '--format', 'json']) == 0
    found = capsys.readouterr()
    assert found.err == f'{line}\n' and json.loads(found.out)['law']['value']
    assert main(['simulate', *words, '--fit-speed', '0.5', '--out', str(tmp_path / 'b')]) == 0
    assert 'trajectory.speed_factor=0.0' in capsys.readouterr().err
    assert main(['simulate', *words, '--fit-speed', '2', '--out', str(tmp_path / 'c')]) == 2
    assert '--fit-speed must be a share above 0, up to 1, not 2' in capsys.readouterr().err
