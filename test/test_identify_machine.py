"""A described machine identified from a noisy run, and an exciting motion for it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.studies.identification import bag_identification, base_parameters
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.configuration import configure

DOCS = Path(__file__).parents[1] / 'docs'
MASSES = [1.2, 0.9, 1.1, 1.05]  # of the links of the five-bar, relative
EXCITATION = {
    'trajectory.shape': 'excitation',
    'excitation.amplitude': 2,
    'excitation.period': 2.0,
}
TRUE = {
    'true_robot.mass_factor': MASSES,
    'true_robot.centre_shift': [0.004, 0.003, *[0.0] * 10],
    'friction.viscous': [0.0015, 0.0008],
    'friction.coulomb': [0.0005, 0.0005],  # that of the file hides the links in so slow a motion
    'sensor.position_noise': [1e-6] * 2,
    'sensor.velocity_noise': [1e-3] * 2,
}


def run(*words):
    return main([str(word) for word in words])


def words_of(changes):
    return [word for key, value in changes.items() for word in ('--set', f'{key}={value}')]


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """A run that excites the five-bar, and a circle."""
    folder = tmp_path_factory.mktemp('machine')
    excited, circle = folder / 'excited', folder / 'circle'
    run_of = ['simulate', 'five_bar_circle', '--law', 'pid', '--out']
    assert run(*run_of, excited, '--duration', 10, *words_of(TRUE | EXCITATION)) == 0
    assert run(*run_of, circle, '--duration', 2, *words_of(TRUE)) == 0
    return excited, circle


def test_a_run_with_noise_gives_the_torques_and_their_parameters(bags, tmp_path, capsys):
    excited, circle = bags
    out = tmp_path / 'robot.yaml'
    capsys.readouterr()
    words = ['identify', excited, '--validate', circle, '--out', out, '--format', 'json']
    assert run(*words) == 0
    found = json.loads(capsys.readouterr().out)
    for errors in found['torque_error_rms_nm'].values():
        assert errors['identified'] < 0.01 * errors['torque']
        assert errors['identified'] < 0.1 * errors['before']
    overrides = config.flat(yaml.safe_load(out.read_text()))
    robot = resolve('five_bar_circle', overrides)
    assert robot['robot.mass_factor'] != [1.0] * 4 and robot['robot.payload'] == 0.0


def test_the_file_is_the_same_to_the_byte_whatever_the_threads(bags, tmp_path):
    """Of another process each, as the number of threads is read where NumPy is loaded."""
    written = []
    for threads in ('1', '2'):
        out = tmp_path / threads
        words = [sys.executable, '-m', 'parallel_robot', 'identify', bags[0], '--out', out]
        environment = {**os.environ, 'OPENBLAS_NUM_THREADS': threads}
        subprocess.run(words, env=environment, check=True, capture_output=True)
        written.append(out.read_bytes())
    assert written[0] == written[1]


def test_bounds_of_the_command_are_told_when_they_act(bags, capsys):
    free = bag_identification.identify(bags[0])
    parameters = free.found.nominal.robot.parameters._replace(**free.found.robot.robot)
    mass = free.found.nominal.robot.module.mechanism(parameters).mass.sum()
    capsys.readouterr()
    assert run('identify', bags[0], '--bounds', f'mass={1.2 * mass}:') == 0
    assert f'bound active: mass from {1.2 * mass:.4g} to inf' in capsys.readouterr().out
    for words, message in (
        (['mass'], "--bounds takes NAME=LOW:HIGH, not 'mass'"),
        (['mass=a:b'], "--bounds takes NAME=LOW:HIGH, not 'mass=a:b'"),
        (['mas=1:2'], "'mas'"),
    ):
        assert run('identify', bags[0], '--bounds', *words) == 2
        error = capsys.readouterr().err
        assert message in error and error.count('\n') == 1


def test_intervals_cover_the_true_parameters(bags):
    found = bag_identification.identify(bags[0]).found
    truth = robot_of(recording.read(bags[0]).log.config, 'true_robot')
    values = base_parameters.linear_model(truth).values(truth.parameters)
    fit, n = found.fit, found.base.joints
    keys = ('viscous', 'coulomb')
    true = found.nominal.friction._replace(**{key: TRUE[f'friction.{key}'] for key in keys})
    wanted = found.base.of(values, true)
    covered = np.abs(fit.values - wanted) <= fit.interval * fit.standard_errors
    assert covered.mean() >= 0.8 and len(wanted) > 2 * n + 4


@pytest.mark.parametrize(
    ('scenario', 'unseen'),
    [
        (
            'delta_circle',
            ['Ixx[arm2]', 'Iyz[arm3]', 'my[arm2]', 'Izz[wrist1a.z]', 'mx[wrist1a.z]'],
        ),
        ('hexapod_circle', ['m[swing1]', 'm[swing6]']),
    ],
)
def test_what_moves_nothing_is_no_parameter(scenario, unseen):
    """An arm turns about its motor alone, a swing about a fixed point; a wrist has no mass."""
    trajectory = configure(resolve(scenario)).trajectory
    known = trajectory.sample(np.linspace(0.0, 5.0, 400))
    base = base_parameters.find(
        trajectory.robot, [known.position], len(known.position), known.pose[0]
    )
    first = [name.split()[0] for name in base.names]
    assert not set(unseen) & set(first) and len(first) > 30
    model = base_parameters.linear_model(trajectory.robot)
    rates = np.random.default_rng(4).normal(size=(2, *known.position.shape))
    torques = model.regressor(trajectory.robot.parameters, known.pose, known.position, *rates)
    assert np.linalg.cond(torques.reshape(-1, torques.shape[-1])[:, base.kept]) < 1e9


def test_axes_that_digits_turn_from_parallel_are_parallel(tmp_path):
    """1.5708 in place of a right angle makes no new parameter of a parallelogram."""
    text, kept = (DOCS / 'dvrk_psm.urdf').read_text(), []
    for k, right in enumerate(('1.570796326794897', '1.5708')):
        file = tmp_path / f'robot{k}.urdf'
        file.write_text(text.replace('1.570796326794897', right))
        robot = robot_of(resolve(str(file)))
        positions = 0.3 * np.random.default_rng(5).normal(size=(400, 3))
        kept.append(base_parameters.find(robot, [positions], 400, np.zeros(3)).kept)
    assert kept[0] == kept[1] and len(kept[0]) == 16


def test_a_motion_is_designed_for_a_machine(tmp_path, capsys):
    out = tmp_path / 'motion.yaml'
    words = ['identify', '--design', 'five_bar_circle', '--trials', 3, '--out', out]
    assert run(*words, *words_of({'trajectory.shape': 'excitation'})) == 0
    before, now = capsys.readouterr().out.splitlines()[1:3]
    assert float(now.split()[1]) >= float(before.split()[1]) > 0.0
    changes = config.flat(yaml.safe_load(out.read_text()))
    assert len(changes['excitation.sine']) == 10


PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial>
<origin xyz="0 0 -0.5"/><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0"
ixz="0" iyz="0"/></inertial></link><joint name="swing" type="revolute"><parent link="base"/>
<child link="rod"/><axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="0" velocity="9"/>
</joint></robot>"""


def test_a_limit_that_the_file_does_not_have_saturates_no_motor(tmp_path, capsys):
    """It is assumed to be 5.4 N m by default."""
    time = np.arange(0.0, 20.0, 0.01)
    angle = 2.0 * np.sin(2.0 * time) + 0.5 * np.sin(7.0 * time)
    bend = -8.0 * np.sin(2.0 * time) - 24.5 * np.sin(7.0 * time)
    table, robot = tmp_path / 'log.csv', tmp_path / 'pendulum.urdf'
    torque = 3.0 * (0.27 * bend + 9.81 * 0.5 * np.sin(angle))
    columns = np.column_stack([time, angle, torque])
    np.savetxt(table, columns, delimiter=',', header='t [s],q1 [rad],tau1 [N m]', comments='')
    robot.write_text(PENDULUM)
    assert run('identify', table, '--scenario', robot) == 0
    assert 'saturated' not in capsys.readouterr().err
    assert run('identify', table, '--scenario', robot, '--set', 'plant.torque_limit=5') == 2
    assert 'saturated' in capsys.readouterr().err
