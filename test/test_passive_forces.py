"""What acts in a machine beside motors and weight, against MuJoCo's model of the same text."""

import mujoco
import numpy as np
import pytest
from reading import Evaluated, InMujoco, made, read

from parallel_robot.cli.command_line import main
from parallel_robot_model.configuration import config_files
from parallel_robot_model.mechanisms.description import mjcf_fields
from parallel_robot_model.mechanisms.joint_kinds import BALL, SLIDE

RNG = np.random.default_rng(3)
NEW = int(mujoco.__version__.split('.')[0]) >= 4  # polynomials, rotors and delays of actuators


def arm(upper='', fore='', body='', beside='', motors='<motor joint="s"/><motor joint="e"/>'):
    return (
        f'<mujoco>{beside}<worldbody><body name="u"><joint name="s" axis="0 1 0" {upper}/>'
        '<geom type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="2"/>'
        f'<body name="f" pos=".5 0 0" {body}><joint name="e" axis="0.6 0.8 0" {fore}/>'
        '<geom type="capsule" size=".05" fromto="0 0 0 .4 0 .1" mass="1"/></body></body>'
        f'</worldbody><actuator>{motors}</actuator></mujoco>'
    )


TENDON = (
    '<tendon><fixed name="t" stiffness="4" springlength="0.05 0.1" damping="2" {}>'
    '<joint joint="s" coef="1"/><joint joint="e" coef="-2"/></fixed></tendon>'
)
ARMS = {
    'springs': arm('stiffness="3" springref="20"', 'stiffness="2"'),
    'gravcomp': arm(body='gravcomp="0.7"'),
    'tendon': arm(beside=TENDON.format('')),
}
NEW_ARMS = {
    'tendon with inertia': arm(beside=TENDON.format('armature="2"')),
    'springs off': arm('stiffness="3"', beside='<option><flag spring="disable"/></option>'),
    'dampers off': arm(
        beside='<option><flag damper="disable"/></option>' + TENDON.format('armature="2"')
    ),
    'no gravcomp without springs and dampers': arm(
        body='gravcomp="0.7"',
        beside='<option><flag spring="disable" damper="disable"/></option>',
    ),
    'polynomials': arm('damping="0 0.8 0.2" stiffness="1 5 2"', 'damping="0 0 0.3"'),
    'rotors': arm(
        motors='<motor joint="s" gear="50" armature="1e-4" damping="0 0.001"/>'
        '<motor joint="e" gear="-20" armature="1e-4"/>'
    ),
    'a motor on a tendon': arm(
        beside=TENDON.format('armature="0.1"'),
        motors='<motor joint="s"/><motor joint="e"/>'
        '<motor tendon="t" gear="3" armature="0.1" damping="0.2 0.1"/>',
    ),
}


@pytest.mark.parametrize('text', [*ARMS.values(), *(NEW_ARMS.values() if NEW else ())])
def test_forces_and_inertia_are_those_of_mujoco(text):
    machine = made(text)
    for _ in range(6):
        q, velocity = RNG.uniform(-1, 1, 2), RNG.normal(size=2)
        ours, theirs = Evaluated(machine, q, velocity), InMujoco(text, q, velocity)
        np.testing.assert_allclose(ours.M, theirs.M, rtol=1e-12, atol=1e-13)
        passive = theirs.force - theirs.data.qfrc_passive - machine.viscous * velocity
        np.testing.assert_allclose(ours.force, passive, rtol=1e-11, atol=1e-11)


def test_linear_damping_of_a_motor_is_viscous_friction_and_a_lag_is_a_lag():
    if not NEW:
        pytest.skip('older releases have neither')
    machine = made(
        arm(
            'damping="0.25"',
            motors='<motor joint="s" gear="50" damping="0.001"/>'
            '<general joint="e" dyntype="filter" dynprm="0.05" gainprm="60" ctrlrange="-1 1"/>'
            '<motor joint="e" name="late" delay="0.004" nsample="6"/>',
        )
    )
    assert machine.viscous == pytest.approx((2.75, 0.0))
    assert machine.lag == (0.0, 0.05) and machine.delay == 0.004


@pytest.mark.parametrize(
    ('motor', 'expected'),
    [
        ('<motor joint="s" ctrlrange="0 60" ctrllimited="true"/>', (0, 60)),
        ('<motor joint="s" forcerange="-5 60" forcelimited="true"/>', (-5, 60)),
        ('<motor joint="s" gear="-2" ctrlrange="0 60" ctrllimited="true"/>', (-120, 0)),
        ('<general joint="s" gainprm="60" dyntype="filter" ctrlrange="-1 1"/>', (-60, 60)),
        ('<motor joint="s" ctrlrange="-6 6"/><motor joint="s" ctrlrange="0 9"/>', (-6, 15)),
        ('<motor joint="s" ctrlrange="-6 6"/><position joint="s" kp="9"/>', (-6, 6)),
    ],
)
def test_limits_of_motors_have_two_sides(motor, expected):
    machine = made(
        arm(motors=f'{motor}<motor joint="e"/>', beside='<compiler autolimits="true"/>')
    )
    assert (machine.least_effort[0], machine.effort[0]) == expected
    assert (machine.least_effort[1], machine.effort[1]) == (-np.inf, np.inf)
    model = mujoco.MjModel.from_xml_string(arm(motors=motor))
    data, found = mujoco.MjData(model), []
    for control in (-1e3, 1e3):
        data.ctrl[:] = control if 'position' not in motor else (control, 0.0)
        mujoco.mj_forward(model, data)
        if 'filter' in motor:
            data.act[:] = np.clip(control, -1, 1)
            mujoco.mj_forward(model, data)
        found.append(data.qfrc_actuator[0])
    assert sorted(found) == list(expected)


def test_what_the_file_switches_off_is_off():
    damper = 'damper' if NEW else 'passive'
    flags = f'<option><flag frictionloss="disable" {damper}="disable" limit="disable"/></option>'
    machine = made(arm('damping="2" frictionloss="3" range="-1 1" limited="true"', beside=flags))
    assert machine.viscous == (0, 0) and machine.coulomb == (0, 0)
    assert machine.lower == (-np.inf, -np.inf)
    flags = '<option><flag constraint="disable"/></option>'
    machine = made(arm('frictionloss="3" range="-1 1" limited="true"', beside=flags))
    assert machine.coulomb == (0, 0) and machine.lower == (-np.inf, -np.inf)
    off = '<option actuatorgroupdisable="2"/>'
    motors = '<motor joint="s"/><motor name="idle" joint="e" group="2"/>'
    assert made(arm(motors=motors, beside=off), held=['e']).actuated == ('s',)
    assert (
        'actuators are switched off by the file: idle'
        in read(arm(motors=motors, beside=off)).doubts
    )


def test_friction_of_a_tendon_of_one_joint_is_that_of_the_joint():
    one = (
        '<tendon><fixed name="t" frictionloss="0.4"><joint joint="e" coef="-3"/></fixed></tendon>'
    )
    assert made(arm(beside=one)).coulomb == pytest.approx((0.0, 1.2))
    two = TENDON.format('frictionloss="0.3"')
    left = "friction of tendon 't' is left out: 0.3 N m or N along it"
    assert left in made(arm(beside=two)).warnings


def _rod(first, second=''):
    """A crank, a rod between two balls, and a slider: the rod spins freely."""
    return (
        '<mujoco><worldbody><body name="crank"><joint name="c" axis="0.2 1 0.1"/>'
        '<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0" mass=".3"/>'
        f'<body name="rod" pos=".2 0 0"><joint name="b" type="ball" armature="{first}"/>'
        '<geom type="capsule" size="1e-3" fromto="0 0 0 .3 .1 -.2" mass=".1"/>'
        + (
            f'<body name="end" pos=".3 .1 -.2"><joint name="e" type="ball" armature="{second}"/>'
            '<geom size=".02" mass=".2"/><site name="s"/></body></body></body>'
            if second
            else '<site name="s" pos=".3 .1 -.2"/></body></body>'
        )
        + '<body name="slider" pos=".5 .1 -.2"><joint name="x" type="slide" axis="1 .3 .2"/>'
        '<geom size=".03" mass=".5"/><site name="t"/></body></worldbody>'
        f'<equality><{"weld" if second else "connect"} site1="s" site2="t"/></equality>'
        '<actuator><motor joint="c"/></actuator></mujoco>'
    )


@pytest.mark.parametrize('rotors', [('1e-3',), ('1e-3', '4e-4')])
def test_rotors_of_balls_are_felt_as_in_mujoco_where_a_rod_spins_freely(rotors):
    text = _rod(*rotors)
    machine = made(text, tool='slider')
    held = [machine.names.index(name) for name in machine.held]
    theirs = InMujoco(text, mujoco.MjModel.from_xml_string(text).qpos0)
    A = theirs.closures
    free = np.linalg.svd(A)[2][np.linalg.matrix_rank(A, 1e-9) :].T  # with the spin of the rod
    motor = np.eye(len(theirs.M))[0]
    rate = free @ np.linalg.solve(free.T @ theirs.M @ free, free.T @ motor)
    assert len(held) == 1 and free.shape[1] == 2
    assert 1.0 / Evaluated(machine).M[0, 0] == pytest.approx(motor @ rate, rel=1e-6)


def test_the_force_of_a_medium_is_told():
    text = arm(beside='<option density="1000" viscosity="1"/>')
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0
    mujoco.mj_forward(model, data)
    told = [doubt for doubt in read(text).doubts if doubt.startswith('the forces of density')]
    assert len(told) == 1 and f'{np.abs(data.qfrc_fluid).max():.3g} N m at 1 rad/s' in told[0]


PLATFORM = """
<mujoco><worldbody>
  <body name="left" pos="-.2 0 0"><joint name="l" type="slide" axis="0 0 1"/>
    <geom size=".02" mass="1"/><site name="l1"/><site name="l2" pos="0 .1 0"/></body>
  <body name="plate" pos="-.2 0 .1" euler="0 0 30"><freejoint name="free"/>
    <geom type="box" size=".1 .1 .01" mass="2" pos=".05 0 0"/>
    <site name="p1" pos="0 0 -.1" euler="0 0 -30"/></body>
</worldbody>
<equality><weld site1="l1" site2="p1" {}/></equality>
<actuator><motor joint="l"/></actuator></mujoco>
"""


def test_a_body_that_floats_is_held_by_the_loops():
    plate = made(PLATFORM.format(''))
    kinds = {joint.name: joint.kind for joint in read(PLATFORM.format('')).joints}
    assert kinds['free'] == BALL and kinds['free.pz'] == SLIDE and plate.actuated == ('l',)
    assert pytest.approx(3.0) == Evaluated(plate).M
    np.testing.assert_allclose(Evaluated(plate).gravity, 3.0 * 9.81)


def test_a_weld_whose_torquescale_is_zero_is_a_point():
    whole, point = read(PLATFORM.format('')), read(PLATFORM.format('torquescale="0"'))
    assert whole.loops[0].turns and not point.loops[0].turns


def test_every_field_of_a_compiled_model_is_read_without_effect_or_told():
    model = mujoco.MjModel.from_xml_string(arm())
    names = mjcf_fields.fields(model)
    assert len(names) > 300 and 'opt.gravity' in names
    assert [line for line in mjcf_fields.unread(model) if 'newer' in line] == []


def test_a_field_of_a_release_that_is_newer_is_told(monkeypatch):
    monkeypatch.setattr(mjcf_fields, 'READ', mjcf_fields.READ.replace('body_gravcomp', ''))
    model = mujoco.MjModel.from_xml_string(arm())
    assert [*mjcf_fields.unread(model)] == [
        'fields that a newer MuJoCo has are not known: body_gravcomp'
    ]


def test_springs_that_yield_and_bodies_that_mocap_moves_are_told():
    text = arm(beside='').replace(
        '</worldbody>', '<body name="ghost" mocap="true"><geom size="1"/></body></worldbody>'
    )
    assert 'bodies that mocap moves stand still: ghost' in read(text).doubts


def test_travel_of_a_passive_joint_ends_a_motion(tmp_path, capsys):
    text = config_files.machine_path('five_bar').read_text(encoding='utf-8')
    narrow = '<joint name="left_elbow" range="-1.2 -1.0" limited="true"/>'
    file = tmp_path / 'narrow.xml'
    file.write_text(text.replace('<joint name="left_elbow"/>', narrow), encoding='utf-8')
    assert main(['simulate', str(file), '--out', str(tmp_path / 'out')]) == 2
    told = capsys.readouterr().err
    assert (
        'end of travel of a passive joint or a tendon' in told and not (tmp_path / 'out').exists()
    )
