"""Gears that are springs: closed forms, MuJoCo, energy, and the same wherever the plant runs."""

import mujoco
import numpy as np
import pytest
from assembly import make_plant
from geometry import ROBOT, kinetic_energy

from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import kernel, read_row, write_row
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.registry import resolve, robot_of
from parallel_robot_sim.configuration import assemble_plant, configure, configure_plant
from parallel_robot_sim.drive_step import rotors
from parallel_robot_sim.ideal_torque import torque_of
from parallel_robot_sim.motions import untrue
from parallel_robot_sim.noise_and_delay import sample_at
from parallel_robot_sim.plant import step
from parallel_robot_sim.plant_replay import UnderCommands

H = 1e-3  # s
FREE = {
    'friction.viscous': 0.0, 'friction.coulomb': 0.0, 'disturbance.amplitude': 0.0,
    'plant.torque_limit': 1e6, 'plant.substeps': 40,
}  # fmt: skip
K, J, INERTIA = np.array([100.0, 80.0]), np.array([0.01, 0.02]), np.array([0.03, 0.05])


def axes(**more):
    keys = {
        'joints': ['first', 'second'], 'true_robot.inertia': INERTIA.tolist(),
        'robot.inertia': INERTIA.tolist(), 'robot.lower': -1e3, 'robot.upper': 1e3,
        'true_robot.lower': -1e3, 'true_robot.upper': 1e3, 'plant.initial_pose': [0.0, 0.0],
        'trajectory.shape': 'hold', 'hold.pose': [0.0, 0.0],
        'compliance.stiffness': K.tolist(), 'compliance.rotor_inertia': J.tolist(),
    }  # fmt: skip
    return config.resolve('axes_step', FREE | keys | more)


@kernel
def _course(setup, state, torques, period, found):
    """Joints, their rates, rotors and theirs, coordinates and theirs, one row a sample."""
    for k in range(len(torques)):
        joints = setup.measure(setup.robot, state.coordinates, state.rate)
        angle, speed = joints.position, joints.velocity
        if setup.imperfections.on and setup.imperfections.drive.on:
            angle, speed = rotors(setup, joints, sample_at(state.time, period))
        n = len(angle)
        write_row(found[k], 0, joints.position)
        write_row(found[k], n, joints.velocity)
        write_row(found[k], 2 * n, angle)
        write_row(found[k], 3 * n, speed)
        write_row(found[k], 4 * n, state.coordinates)
        write_row(found[k], 4 * n + len(state.rate), state.rate)
        state = step(setup, state, read_row(torques, k, state.torque), period)


def course(values, torques):
    """Joints [rad], rates [rad/s], rotors and theirs, coordinates and theirs under torques."""
    plant = make_plant(values)
    n, c = torques.shape[1], len(plant.state.rate)
    found = np.empty((len(torques), 4 * n + 2 * c))
    _course(plant.setup, plant.state, torques, H, found)
    return np.hsplit(found, [n, 2 * n, 3 * n, 4 * n, 4 * n + c])


def nearly(found, expected, share=1e-6):
    assert np.abs(found - expected).max() < share * np.abs(expected).max()


def test_a_rotor_on_a_locked_joint_swings_with_its_closed_form():
    values = axes(**{'true_robot.inertia': 1e12})
    torques = np.tile([2.0, -1.0], (500, 1))
    joints, _, angle, speed, *_ = course(values, torques)
    w, t = np.sqrt(K / J), np.arange(500)[:, np.newaxis] * H
    nearly(angle, torques / K * (1.0 - np.cos(w * t)))
    nearly(speed, torques / K * w * np.sin(w * t))
    assert np.abs(joints).max() < 1e-9


def test_damping_of_a_gear_has_its_closed_form():
    damping = np.array([0.2, 0.5])
    values = axes(**{'true_robot.inertia': 1e12, 'compliance.damping': damping.tolist()})
    angle = course(values, np.tile([2.0, -1.0], (500, 1)))[2]
    decay, t = damping / (2.0 * J), np.arange(500)[:, np.newaxis] * H
    w = np.sqrt(K / J - decay**2)
    swing = np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    nearly(angle, np.array([2.0, -1.0]) / K * (1.0 - swing))


def test_two_masses_under_a_step_of_torque_have_their_closed_form():
    torques = np.tile([2.0, -1.0], (800, 1))
    joints, rates, angle, *_ = course(axes(), torques)
    w, t = np.sqrt(K * (1.0 / J + 1.0 / INERTIA)), np.arange(800)[:, np.newaxis] * H
    twist = torques / J / w**2 * (1.0 - np.cos(w * t))
    moved = K / INERTIA * torques / J / w**2 * (0.5 * t**2 - (1.0 - np.cos(w * t)) / w**2)
    nearly(joints, moved)
    nearly(angle - joints, twist, 1e-5)
    nearly(rates, K / INERTIA * torques / J / w**2 * (t - np.sin(w * t) / w))


def arm_in_mujoco(robot, pose, stiffness, damping, rotor):
    """The arm, its rotors beside it, each coupled to its joint by a tendon."""
    rotors_ = ''.join(
        f'<body><joint name="r{k}" axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{(f"{each} " * 3)}"/></body>'
        for k, each in enumerate(rotor)
    )
    gears = ''.join(
        f'<fixed stiffness="{stiffness[k]}" damping="{damping[k]}" springlength="0">'
        f'<joint joint="r{k}" coef="1"/><joint joint="q{k}" coef="-1"/></fixed>'
        for k in range(2)
    )
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option gravity="0 {-robot.gravity} 0" timestep="1e-4" integrator="RK4"/>
      <worldbody>{rotors_}<body><joint name="q0" axis="0 0 1"/>
        <inertial pos="{robot.lc1} 0 0" mass="{robot.m1}" diaginertia="{(f'{robot.I1} ' * 3)}"/>
        <body pos="{robot.l1} 0 0"><joint name="q1" axis="0 0 1"/>
          <inertial pos="{robot.lc2} 0 0" mass="{robot.m2}" diaginertia="{(f'{robot.I2} ' * 3)}"/>
          <body pos="{robot.l2} 0 0">
            <inertial pos="0 0 0" mass="{robot.mp}" diaginertia="0 0 0"/></body>
        </body></body></worldbody>
      <tendon>{gears}</tendon></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[:] = [*pose, *pose]
    return model, data


@pytest.mark.parametrize('torque', [(0.0, 0.0), (12.0, -5.0)])
def test_an_arm_with_soft_gears_moves_as_in_mujoco(torque):
    """Free from rest, so that it swings under gravity, and under a step of torque."""
    stiffness, damping, rotor = [900.0, 500.0], [0.5, 0.2], [0.1, 0.05]
    keys = {
        'compliance.stiffness': stiffness, 'compliance.damping': damping,
        'compliance.rotor_inertia': rotor,
    }  # fmt: skip
    values = config.resolve('serial_2r_circle', FREE | keys)
    joints, rates, angle, *_ = course(values, np.tile(torque, (400, 1)))
    model, data = arm_in_mujoco(robot_of(values).parameters, joints[0], stiffness, damping, rotor)
    data.qfrc_applied[:2] = torque
    for k in range(400):
        found = np.concatenate((angle[k], joints[k], rates[k]))
        expected = np.concatenate((data.qpos, data.qvel[2:]))
        assert np.abs(found - expected).max() < 1e-6 * max(1.0, np.abs(expected).max()), k
        mujoco.mj_step(model, data, 10)
    assert np.abs(joints[-1] - joints[0]).max() > 0.5 and np.abs(angle - joints).max() > 0.01


def test_the_legs_of_a_parallel_robot_keep_their_energy():
    """A push, then nothing: what robot, rotors and springs have together stays."""
    stiffness, rotor = np.array([500.0, 700.0, 900.0]), np.array([0.2, 0.3, 0.1])
    keys = {'compliance.stiffness': stiffness.tolist(), 'compliance.rotor_inertia': rotor.tolist()}
    values = config.resolve('paper_circle', FREE | keys)
    torques = np.zeros((400, 3))
    torques[:50] = [6.0, -4.0, 5.0]
    joints, _, angle, speed, pose, rate = course(values, torques)
    bodies = [kinetic_energy(ROBOT, *each) for each in zip(pose[50:], rate[50:], strict=True)]
    drives = 0.5 * speed**2 @ rotor + 0.5 * (angle - joints) ** 2 @ stiffness
    after = bodies + drives[50:]
    assert after[0] > 0.1 and np.ptp(after) < 1e-6 * after[0]
    assert np.ptp(bodies) > 1e-2 * after[0]
    assert np.abs(angle - joints)[50:].max() > 5e-3


def test_a_very_stiff_gear_is_rigid():
    torques = 0.5 * np.sin(2.0 * np.pi * np.arange(300)[:, np.newaxis] * H * np.array([3.0, 5.0]))
    stiff = course(axes(**{'compliance.stiffness': 1e6, 'compliance.damping': 10.0}), torques)
    whole = {'true_robot.inertia': (INERTIA + J).tolist()}
    none = {'compliance.stiffness': 0.0, 'compliance.rotor_inertia': 0.0}
    rigid = course(axes(**whole, **none), torques)
    nearly(stiff[0], rigid[0], 1e-4)
    nearly(stiff[2], rigid[0], 1e-4)


@pytest.mark.parametrize(('scenario', 'stiffness', 'rotor'), [('delta_circle', 1e5, 0.01)])
def test_rotors_of_a_described_machine_are_its_armature(scenario, stiffness, rotor):
    """Falling and pushed: with stiff gears, as with that inertia in the joints."""
    values = resolve(scenario, FREE | {'plant.substeps': 1})
    n = len(values['joints'])
    torques = np.outer(np.sin(2.0 * np.pi * 5.0 * np.arange(100) * H), np.linspace(0.5, 1.0, n))
    gear = {
        'compliance.stiffness': stiffness, 'compliance.damping': 1.0,
        'compliance.rotor_inertia': rotor,
    }  # fmt: skip
    soft = course(values | gear, torques)
    armature = np.add(values['true_robot.armature'], rotor).tolist()
    rigid = course(values | {'true_robot.armature': armature}, torques)
    moved = np.abs(rigid[0] - rigid[0][0]).max()
    assert moved > 0.01 and np.abs(soft[0] - rigid[0]).max() < 1e-2 * moved
    assert 1e-7 < np.abs(soft[2] - soft[0]).max() < 1e-2 * moved


def test_joints_without_stiffness_stay_rigid():
    torques = np.tile([0.4, 0.4], (300, 1))
    one = {'compliance.stiffness': [100.0, 0.0], 'compliance.rotor_inertia': [0.01, 0.0]}
    joints, rates, angle, speed, *_ = course(axes(**one), torques)
    t = np.arange(300) * H
    nearly(joints[:, 1], 0.4 / INERTIA[1] * 0.5 * t**2)
    assert np.array_equal(angle[:, 1], joints[:, 1]) and np.array_equal(speed[:, 1], rates[:, 1])
    assert np.abs(angle[:, 0] - joints[:, 0]).max() > 1e-3


def test_a_joint_waits_until_the_rotor_has_crossed_half_the_play():
    play, torque = 0.02, 0.2
    torques = np.full((300, 2), torque)
    joints, _, angle, *_ = course(axes(**{'compliance.backlash': play}), torques)
    t = np.arange(300)[:, np.newaxis] * H
    free = torque / J * 0.5 * t**2
    inside = free < 0.5 * play
    assert not joints[inside].any() and (joints[free > 0.6 * play] > 0.0).all()
    nearly(angle[inside], free[inside])


def test_play_takes_no_energy_and_damping_gives_none():
    torques = np.zeros((600, 2))
    torques[:30] = [1.0, -2.0]

    def energy(damping):
        more = {'compliance.backlash': 0.01, 'compliance.damping': damping}
        joints, rates, angle, speed, *_ = course(axes(**more, **{'plant.substeps': 200}), torques)
        twist = np.abs(angle - joints)
        pressed = np.maximum(twist - 0.005, 0.0)
        assert twist[30:].min() < 0.004 and pressed.max() > 1e-4
        kinetic = 0.5 * rates**2 * INERTIA + 0.5 * speed**2 * J
        return (kinetic + 0.5 * K * pressed**2)[30:]

    kept, lost = energy(0.0), energy(0.5)
    assert (np.ptp(kept, axis=0) < 1e-4 * kept[0]).all()
    assert (lost[-1] < 0.9 * lost[0]).all() and (np.diff(lost, axis=0) <= 1e-6 * lost[0]).all()


@pytest.mark.parametrize('side', ['motor', 'joint'])
def test_sensors_are_at_the_motor_or_at_the_joint(side):
    values = axes(**{'compliance.sensor': side})
    torques = np.tile([2.0, -1.0], (100, 1))
    true, told, _ = UnderCommands(configure(values)).moved(torques)
    joints, _, angle, *_ = course(values, torques)
    assert np.array_equal(true, joints)
    assert np.array_equal(told, angle if side == 'motor' else joints)
    assert untrue(values) == (['compliance.stiffness'] if side == 'motor' else [])
    assert np.abs(angle - joints).max() > 1e-3


def test_cogging_is_of_the_rotor_and_the_load_of_the_joint():
    more = {'disturbance.ripple': 0.3, 'disturbance.ripple_periods': 5.0}
    torque = np.array([40.0, 0.0])
    angle = course(axes(**{'true_robot.inertia': 1e12}, **more), np.tile(torque, (400, 1)))[2]
    w, expected = np.sqrt(K / J), np.zeros((400, 2))
    here, rate = np.zeros(2), np.zeros(2)
    for k in range(399):  # cogging is held over a period, in which the rotor swings about a rest
        rest = (torque - 0.3 * np.sin(5.0 * here)) / K
        cosine, sine, off = np.cos(w * H), np.sin(w * H), here - rest
        here, rate = rest + off * cosine + rate / w * sine, rate * cosine - off * w * sine
        expected[k + 1] = here
    nearly(angle, expected)
    joints, _, angle, *_ = course(axes(**{'disturbance.constant': -0.1}), np.zeros((50, 2)))
    assert (joints[2:] > angle[2:]).all() and (angle[2:] > 0.0).all()


def test_the_ideal_torque_turns_the_rotors_too():
    def ideal(**keys):
        made = configure(config.resolve('paper_circle', {'duration': 2.0, **keys}))
        return torque_of(made), made.trajectory.sample(np.abs(np.arange(2001) - 0.5) * H)

    gear = {'compliance.stiffness': [1e4, 1e4, 0.0], 'compliance.rotor_inertia': [0.1, 0.2, 0.3]}
    (rigid, motion), (soft, _) = ideal(), ideal(**gear)
    expected = [0.1, 0.2, 0.0] * motion.acceleration
    assert np.abs(expected).max() > 0.01
    np.testing.assert_allclose((soft - rigid)[1:], expected[1:], atol=1e-9)


def test_brakes_hold_rotors_and_joints():
    brakes = [{'what': 'brakes', 'at': 0.05, 'for': 0.05}]
    torques = np.tile([2.0, -1.0], (150, 1))
    joints, rates, angle, speed, *_ = course(axes(hazards=brakes), torques)
    assert (joints[51:101] == joints[51]).all() and (angle[51:101] == angle[51]).all()
    assert not rates[51:101].any() and not speed[51:101].any()
    assert np.abs(joints[149] - joints[100]).min() > 1e-3


def test_as_many_integration_steps_as_the_gear_needs():
    def steps(**more):
        values = axes(**{'plant.substeps': 1, **more})
        return assemble_plant(configure_plant(values)).setup.imperfections.drive.substeps

    w = np.sqrt(K * (1.0 / J + 1.0 / INERTIA)).max()
    assert steps() == int(np.ceil(w * H / 0.1)) and steps(**{'compliance.stiffness': 1e5}) > 20
    with pytest.raises(InputError, match=r'too stiff: .* integration steps in a period, at most'):
        steps(**{'compliance.stiffness': 1e12})


@pytest.mark.parametrize(
    ('settings', 'reason'),
    [
        (['stiffness=100'], 'compliance.rotor_inertia must be above 0 where compliance.stiffness'),
        (
            ['backlash=0.01'],
            'compliance.backlash must be 0 where compliance.stiffness is, not 0.01',
        ),
        (['backlash=[0,1,0]'], 'must be 0 where compliance.stiffness is, not 1 (joint 2)'),
        (['stiffness=-1'], 'compliance.stiffness must be at least 0 N m/rad'),
        (['stiffness=[1,2]'], 'compliance.stiffness must be a number or a list of 3'),
        (['sensor=link'], "unknown value of compliance.sensor 'link'"),
        (['stiffness=1e15', 'rotor_inertia=0.1'], 'compliance or stiction is too stiff'),
        (['stiffness=1e5', 'rotor_inertia=1e-310'], 'too stiff: inf rad/s need inf'),
    ],
)
def test_wrong_gears_cost_one_line(settings, reason, tmp_path, capsys):
    words = [word for each in settings for word in ('--set', f'compliance.{each}')]
    out = tmp_path / 'bag'
    assert main(['simulate', 'paper_circle', *words, '--duration', '1', '--out', str(out)]) == 2
    err = capsys.readouterr().err
    assert reason in err and err.count('\n') == 1 and not out.exists()


def test_mujoco_as_the_engine_has_no_gears():
    gear = {'compliance.stiffness': 100.0, 'compliance.rotor_inertia': 0.1}
    values = config.resolve('paper_circle', {'plant.engine': 'mujoco', **gear})
    with pytest.raises(InputError, match=r'need plant\.engine analytic'):
        assemble_plant(configure_plant(values))
