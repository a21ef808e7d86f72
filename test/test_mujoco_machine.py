"""Described machines against MuJoCo's own model of their file."""

import numpy as np
import pytest
from mjcf_features import free_platform

from parallel_robot.cli.command_line import main
from parallel_robot.studies import verification
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.mechanisms import closure_solver, closures, dynamics
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.mujoco_machine import MujocoMachine, built
from parallel_robot_sim.mujoco_simulator import MujocoSimulator, simulator_of

mujoco = pytest.importorskip('mujoco')
URDF = """
<robot name="one">
  <link name="base"/>
  <link name="link"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint" type="continuous"><parent link="base"/><child link="link"/>
    <axis xyz="0 0 1"/></joint>
</robot>
"""


def verify(*words):
    return main(['verify', *words])


@pytest.fixture(params=['five_bar', 'delta', 'delta_rl5', 'hexapod', 'arm6'])
def machine(request):
    """A machine with random masses, near the pose of its scenario."""
    values = resolve(f'{request.param}_circle')
    robot = robot_of(values)
    links, random = len(robot.parameters.mass_factor), np.random.default_rng(0)
    parameters = robot.parameters._replace(
        mass_factor=tuple(random.uniform(0.8, 1.2, links)),
        spread_factor=tuple(random.uniform(0.9, 1.1, 3 * links)),
        centre_shift=tuple(random.normal(0.0, 0.01, 3 * links)),
        armature=tuple(random.uniform(0.5, 1.5) * each for each in robot.parameters.armature),
        payload=0.3,
    )
    return robot._replace(parameters=parameters), np.array(values['plant.initial_pose'])


def test_accelerations_are_those_of_mujoco(machine):
    robot, pose = machine
    mechanism, made = boxed(robot.module.mechanism(robot.parameters))
    n, random = len(mechanism.actuated), np.random.default_rng(1)
    model, *_ = built(robot.module, robot.parameters, [0.0] * n, 1e-4)
    data = mujoco.MjData(model)
    data.qpos = robot.module.posture(robot.parameters, pose)
    found = np.zeros(n)
    velocity, torque = random.normal(size=(2, n))
    assert (
        closure_solver.close(mechanism, made, data.qpos[mechanism.actuated])
        == closure_solver.FOUND
    )
    closures.joint_rates(mechanism, made, velocity)
    data.qvel = made.rate
    data.qfrc_applied[mechanism.actuated] = torque
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max(initial=0.0) < 1e-12  # the loops of the file are closed
    dynamics.free_acceleration(mechanism, made, velocity, torque, found)
    size = np.abs(found).max()
    assert np.abs(data.qacc[mechanism.actuated] - found).max() < 1e-6 * size


def test_poses_are_those_of_mujoco(machine):
    robot, pose = machine
    made = MujocoMachine(robot, pose, [0.0] * len(pose))
    assert np.allclose(made.pose, pose, atol=1e-10)


@pytest.mark.parametrize('name', ['five_bar', 'hexapod'])
def test_a_machine_moves_as_in_mujoco(name, capsys):
    """Gravity takes half of what the motors of the hexapod have."""
    words = '--set', f'robot_model={name}', '--robots', '2', '--duration', '0.1'
    assert verify(*words) == 0
    row = capsys.readouterr().out.splitlines()[-1].strip()
    assert row.startswith(name) and row.endswith('  agrees')


def test_a_mass_that_is_a_thousandth_off_is_found(monkeypatch, capsys):
    def wrong(robot, *others):
        factor = tuple(1.001 * np.array(robot.parameters.mass_factor))
        parameters = robot.parameters._replace(mass_factor=factor)
        return MujocoMachine(robot._replace(parameters=parameters), *others)

    monkeypatch.setattr(verification, 'MujocoMachine', wrong)
    words = '--set', 'robot_model=five_bar', '--robots', '1', '--duration', '0.1'
    assert verify(*words) == 1
    assert 'more than 1e-09' in capsys.readouterr().out


def test_a_machine_is_one_machine(capsys):
    assert verify('--set', 'robot_model=five_bar') == 0
    wanted = 'five_bar: its functions agree with each other'
    assert capsys.readouterr().out.splitlines()[1:] == [wanted]


def test_both_engines_move_a_machine_alike():
    values = resolve('five_bar_circle') | {
        **{'plant.integrator': 'rk4', 'plant.substeps': 10, 'actuator.delay': 0.002},
        **{'friction.coulomb': [0.0] * 2, 'actuator.lag': [0.003] * 2},
        'true_robot.payload': 0.02,
    }
    ours, theirs = (
        simulator_of(configure_plant(values | {'plant.engine': engine}))
        for engine in ('analytic', 'mujoco')
    )
    assert isinstance(theirs, MujocoSimulator)
    begin = ours.pose.copy()
    for k in range(300):
        torque = 0.02 * np.sin(8 * np.pi * 0.001 * k * np.arange(1, 3))
        ours.advance(torque)
        theirs.advance(torque)
    assert np.abs(ours.pose - begin).max() > 1e-3
    assert np.abs(ours.pose - theirs.pose).max() < 1e-9
    assert np.array_equal(ours.state.torque, theirs.state.torque)


@pytest.mark.parametrize(
    ('words', 'wanted'),
    [
        (['robot_model=serial_2r', '--robots', '1'], 'serial_2r is not described by a file'),
        (['robot_model=five_bar', '--duration', '1'], 'no --duration without --robots'),
    ],
)
def test_wrong_words_cost_one_line(words, wanted, capsys):
    assert verify('--set', *words) == 2
    error = capsys.readouterr().err
    assert wanted in error and error.count('\n') == 1


def test_a_body_that_floats_by_a_joint_without_a_name_has_the_joints_of_the_suite(tmp_path):
    path = tmp_path / 'plate.xml'
    path.write_text(free_platform())
    values = resolve('paper_circle', {'robot_model': str(path), 'plant.engine': 'mujoco'})
    assert '<freejoint/>' in values['robot_description']
    robot = robot_of(values)
    machine = robot.module.machine(robot.parameters)
    model, *_ = built(robot.module, robot.parameters, [0.0] * len(machine.actuated), 1e-4)
    assert tuple(model.joint(i).name for i in range(model.njnt)) == machine.names


def test_what_mujoco_cannot_read_is_refused(tmp_path):
    path = tmp_path / 'one.urdf'
    path.write_text(URDF)
    robot = robot_of(resolve('paper_circle', {'robot_model': str(path)}))
    with pytest.raises(InputError, match='only MJCF can be built in MuJoCo, not <robot>'):
        MujocoMachine(robot, np.zeros(1), [0.0])


def test_a_geometry_that_mujoco_would_not_have_is_refused():
    shift = [0.0, 1e-3, *[0.0] * 16]
    values = resolve('five_bar_circle', {'plant.engine': 'mujoco', 'true_robot.shift': shift})
    with pytest.raises(InputError, match='shift must be zero where MuJoCo computes'):
        simulator_of(configure_plant(values))
