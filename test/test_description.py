"""Descriptions in MJCF, URDF and SDF, read: against MuJoCo, and refused in one line."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from machine_files import ARM, INERTIAL, five_bar, joint, link, mjcf, urdf
from reading import Evaluated, InMujoco, made

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.mechanisms.description.machine import read

BALL = ['ball.x', 'ball.y', 'ball.z']
RNG = np.random.default_rng(7)


def robot(*parts):
    return f'<robot name="r">{"".join(parts)}</robot>'


def sdf(*parts, world=''):
    model = f'<model name="m">{"".join(parts)}</model>'
    return f'<sdf version="1.9"><world name="w">{world}{model}</world></sdf>'


def sdf_link(name, pose='0 0 0 0 0 0', of=''):
    return (
        f'<link name="{name}"><pose{of}>{pose}</pose><inertial><pose>0.1 0 0 0.1 0 0</pose>'
        '<mass>2</mass><inertia><ixx>0.01</ixx><iyy>0.02</iyy><izz>0.02</izz></inertia>'
        '</inertial></link>'
    )


def sdf_joint(name, parent, child, kind='revolute', axis='0 0 1', more=''):
    axes = f'<axis><xyz>{axis}</xyz>{more}</axis>' if axis else ''
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>'
        f'{axes}</joint>'
    )


def test_a_tree_of_hinges_slides_and_balls_is_that_of_mujoco():
    arm = made(ARM, actuated=['pan', 'tilt', 'slide', *BALL])
    qpos = [0.3, 0.5, 0.2, 0.9, 0.1, 0.3, 0.2]
    at_home, there = Evaluated(arm), InMujoco(ARM, qpos)
    np.testing.assert_allclose(at_home.M, there.M, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(at_home.force, there.force, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(at_home.pose[:3], there.site('tool'), rtol=1e-13)
    assert arm.tool == 'tool' and arm.home_moved == 0.0


def test_moving_it_gives_the_forces_of_mujoco():
    text = ARM.replace('<joint name="ball" type="ball" pos="0 0.02 0"/>', '').replace(
        ' 0.9 0.1 0.3 0.2"', '"'
    )
    arm, velocity = made(text), RNG.normal(size=3)
    for q in RNG.uniform(-1, 1, (5, 3)):
        moving, there = Evaluated(arm, q, velocity), InMujoco(text, q, velocity)
        np.testing.assert_allclose(moving.M, there.M, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(moving.force, there.force, rtol=1e-11, atol=1e-12)


def test_limits_friction_and_actuators_of_mjcf():
    with pytest.raises(InputError, match=r'no actuator that was read drives ball\.x, ball\.z'):
        made(ARM)
    arm = made(ARM, held=BALL)
    assert arm.actuated == ('pan', 'tilt', 'slide') and arm.held == tuple(BALL)
    assert arm.units == ('rad', 'rad', 'm')
    assert arm.viscous == (0.3, 0, 0) and arm.coulomb == (0.2, 0, 0)
    np.testing.assert_allclose(arm.lower, (-np.pi / 2, -np.inf, -0.2))
    np.testing.assert_allclose(arm.upper, (np.pi / 2, np.inf, 0.3))
    assert arm.effort == (40, 40, np.inf) and arm.velocity == (np.inf,) * 3
    assert 'servos are taken for motors, their gains left out: tilt' in arm.warnings


@pytest.mark.skipif(
    int(mujoco.__version__.split('.')[0]) < 4, reason='it turned the inertias of URDF wrongly'
)
def test_urdf_is_that_of_mujoco():
    compiler = '<mujoco><compiler fusestatic="true" discardvisual="true" balanceinertia="false"/>'
    text = urdf().replace('<link name="base"/>', f'{compiler}</mujoco><link name="base"/>')
    text = text[: text.index('<visual>')] + text[text.index('</visual>') + 9 :]
    arm, velocity = made(text), RNG.normal(size=2)
    for q in RNG.uniform(-1, 1, (5, 2)):
        moving, there = Evaluated(arm, q, velocity), InMujoco(text, q, velocity)
        np.testing.assert_allclose(moving.M, there.M, rtol=1e-12)
        np.testing.assert_allclose(moving.force, there.force, rtol=1e-11, atol=1e-12)
    assert arm.lower == (-1, 0) and arm.upper == (2, 0.4)
    assert arm.effort == (50, np.inf) and arm.velocity == (3, np.inf)
    assert arm.viscous == (0.4, 0) and arm.coulomb == (0.1, 0)


def test_mimic_follows_with_ratio_and_offset():
    more = link('third') + joint(
        'follower', 'second', 'third', xyz='0.2 0 0',
        more='<mimic joint="shoulder" multiplier="-2" offset="0.3"/>',
    )  # fmt: skip
    arm = made(urdf(more))
    assert arm.actuated == ('shoulder', 'stroke') and arm.passive == ('follower',)
    for q in ((0.2, 0.1), (0.5, 0.3)):
        moved = Evaluated(arm, q)
        assert moved.all[2] == pytest.approx(0.3 - 2 * q[0], abs=1e-14)
        np.testing.assert_allclose(moved.W[2], (-2, 0), atol=1e-14)


def test_ends_of_urdf_transmissions_and_interfaces_are_actuated():
    transmission = '<transmission name="t"><joint name="stroke"/></transmission>'
    assert made(urdf(transmission), held=['shoulder']).actuated == ('stroke',)
    control = (
        '<ros2_control name="c" type="system"><joint name="shoulder"><command_interface '
        'name="effort"/></joint><joint name="stroke"><state_interface name="position"/></joint>'
        '</ros2_control>'
    )
    assert made(urdf(control), held=['stroke']).actuated == ('shoulder',)


def urdf_five_bar(closing, last=''):
    """The five-bar of `machine_files` in URDF."""
    legs = ''
    for name, x, first, second in (('left', -0.2, 100, -60), ('right', 0.2, 80, 60)):
        legs += link(name) + link(f'{name}_outer', 0.5)
        legs += joint(name, 'base', name, xyz=f'{x} 0 0').replace(
            '<origin ', f'<origin rpy="0 0 {np.radians(first)}" '
        )
        legs += joint(f'{name}_elbow', name, f'{name}_outer', xyz='0.3 0 0').replace(
            '<origin ', f'<origin rpy="0 0 {np.radians(second)}" '
        )
    return robot('<link name="base"/>', legs, last, closing)


END = '<link name="{0}_end"/>' + joint('{0}_bolt', '{0}_outer', '{0}_end', 'fixed', '0.3 0 0')
ENDS = END.replace('{0}', 'left') + END.replace('{0}', 'right')
MOTORS = '<name_mot joint="left"/><name_mot joint="right"/>'
CLOSINGS = {
    'closed_loop 3d': ENDS + '<closed_loop first="left_end" second="right_bolt" type="3d"/>',
    'constraint': '<constraint name="c" type="revolute"><parent link="left_outer"/>'
    '<parent_origin xyz="0.3 0 0"/><parent_axis xyz="0 0 1"/><child link="right_outer"/>'
    '<child_origin xyz="0.3 0 0"/><child_axis xyz="0 0 1"/></constraint>',
    'spherical constraint': '<constraint name="c" type="spherical"><parent link="left_outer"/>'
    '<parent_origin xyz="0.3 0 0"/><child link="right_outer"/><child_origin xyz="0.3 0 0"/>'
    '</constraint>',
    'loop': '<loop name="c" type="revolute"><predecessor link="left_outer">'
    '<origin xyz="0.3 0 0"/></predecessor><successor link="right_outer"><origin xyz="0.3 0 0"/>'
    '</successor><axis xyz="0 0 1"/></loop>',
    'two parents': '<link name="pin"/>'
    + joint('pin', 'left_outer', 'pin', 'fixed', '0.3 0 0')
    + joint('other', 'right_outer', 'pin', 'continuous', '0.3 0 0'),
    'universal constraint': '<constraint name="c" type="universal"><parent link="left_outer"/>'
    '<parent_origin xyz="0.3 0 0"/><parent_axis xyz="0 0 1"/><child link="right_outer"/>'
    '<child_origin xyz="0.3 0 0"/><child_axis xyz="1 0 0"/></constraint>',
}


@pytest.mark.parametrize('closing', CLOSINGS)
def test_every_way_to_close_a_loop_of_urdf_makes_the_same_five_bar(closing):
    bar = made(urdf_five_bar(CLOSINGS[closing], MOTORS))
    assert bar.actuated == ('left', 'right')
    reference = urdf_five_bar(CLOSINGS['closed_loop 3d'], MOTORS)
    q, velocity = (0.1, -0.2), (0.5, 0.8)
    found, expected = Evaluated(bar, q, velocity), Evaluated(made(reference), q, velocity)
    np.testing.assert_allclose(found.M, expected.M, rtol=1e-10)
    np.testing.assert_allclose(found.force, expected.force, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize('kind', ['xml', 'yaml'])
def test_the_ways_of_the_page_make_it_too(tmp_path, kind):
    page = (Path(__file__).parents[1] / 'docs' / 'machines.md').read_text()
    [example] = re.findall(rf'```{kind}\n(.*?)```', page, re.DOTALL)[:1]
    file = tmp_path / 'my_robot.urdf'
    if kind == 'yaml':
        file.with_suffix('.yaml').write_text(example)
    closing = example if kind == 'xml' else ''
    file.write_text(urdf_five_bar(closing, ENDS + (MOTORS if closing else '')))
    bar = made(robot_file.text_of(file))
    assert bar.actuated == ('left', 'right') and len(bar.mechanism.closure) == 2
    reference = made(urdf_five_bar(CLOSINGS['closed_loop 3d'], MOTORS))
    found, expected = (Evaluated(each, (0.1, -0.2), (0.5, 0.8)) for each in (bar, reference))
    np.testing.assert_allclose(found.M, expected.M, rtol=1e-10)


@pytest.mark.parametrize(
    'closure',
    [
        '<connect site1="a" site2="b"/>',
        '<connect body1="left_outer" body2="right_outer" anchor="0.3 0 0"/>',
    ],
)
def test_a_five_bar_is_that_of_mujoco(closure):
    text = five_bar(closure).replace(
        '<body pos="0.3 0 0" euler="0 0 -60">',
        '<body name="left_outer" pos="0.3 0 0" euler="0 0 -60">',
    )
    text = text.replace('<body pos="0.3 0 0" euler="0 0 60">',
                        '<body name="right_outer" pos="0.3 0 0" euler="0 0 60">')  # fmt: skip
    bar = made(text)
    at_home = Evaluated(bar)
    assert len(bar.mechanism.closure) == 2
    if 'site1' in closure:
        assert bar.home_moved == pytest.approx(0.0446, abs=1e-4)
        assert any('open by 0.0446 m at home' in doubt for doubt in bar.warnings)
    there = InMujoco(text, at_home.all)
    np.testing.assert_allclose(at_home.W, there.follow([0, 2]), atol=1e-12)
    W = at_home.W
    np.testing.assert_allclose(at_home.M, W.T @ there.M @ W, rtol=1e-12)


def test_a_weld_is_that_of_mujoco():
    """A platform on a hinge and two slides is welded to an arm; its three joints follow."""
    text = mjcf(
        f"""
        <body name="arm"><joint name="a"/>{INERTIAL.format(0.1, 1)}
          <body pos="0.3 0 0" euler="0 0 50"><joint name="b"/>{INERTIAL.format(0.1, 1)}
            <body name="hand" pos="0.3 0 0"><joint name="c"/>{INERTIAL.format(0, 1)}</body>
          </body>
        </body>
        <body name="plate" pos="0.2 0.4 0" euler="0 0 20">
          <joint name="x" type="slide" axis="1 0 0"/>
          <joint name="y" type="slide" axis="0 1 0"/><joint name="turn"/>{INERTIAL.format(0, 2)}
        </body>""",
        '<equality><weld body1="hand" body2="plate" anchor="0.1 0.2 0"/></equality><actuator>'
        '<motor joint="a"/><motor joint="b"/><motor joint="c"/></actuator>',
    )
    machine = made(text, tool='plate')
    assert machine.home_moved < 1e-12 and machine.passive == ('x', 'y', 'turn')
    assert machine.coordinates == (('x', 'm'), ('y', 'm'), ('phi', 'rad'))
    for q in ((0, 0, 0), (0.4, -0.3, 0.2)):
        there = Evaluated(machine, q)
        full = InMujoco(text, there.all)
        np.testing.assert_allclose(there.M, there.W.T @ full.M @ there.W, rtol=1e-11)
        np.testing.assert_allclose(full.closures @ there.W, 0, atol=1e-11)


def test_a_coupling_of_joints_is_that_of_mujoco():
    text = ARM.replace('</keyframe>', '</keyframe><equality><joint joint1="slide" joint2="tilt" '
                       'polycoef="0.02 -0.1 0 0 0"/></equality>').replace(
        '<motor joint="slide"/>', '')  # fmt: skip
    arm = made(text, held=BALL)
    assert arm.passive == ('slide',)
    q = (0.2, 0.7)
    expected = 0.1 + 0.02 - 0.1 * (0.7 - np.radians(20))
    assert Evaluated(arm, q).all[2] == pytest.approx(expected, abs=1e-14)


def test_sdf_is_its_urdf():
    arm = made(
        sdf(
            sdf_link('base'),
            sdf_joint('fix', 'world', 'base', 'fixed', ''),
            sdf_link('one', '0.1 0.2 0.3 0.4 0 0'),
            sdf_joint('hinge', 'base', 'one', axis='0 1 0', more='<limit><lower>-1</lower>'
                      '<upper>1e16</upper><effort>-1</effort></limit>'),
            sdf_link('two', '0.3 0 0 0 0.2 0', ' relative_to="one"'),
            sdf_joint('slide', 'two', 'one', 'prismatic', '1 0 0',
                      '<limit><lower>0</lower><upper>2</upper></limit>'),
            world='<gravity>0 0 -5</gravity>',
        )
    )  # fmt: skip
    inertial = (
        '<inertial><origin xyz="0.1 0 0" rpy="0.1 0 0"/><mass value="2"/><inertia ixx="0.01" '
        'iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    # the joint carries its parent, so its frame is that of the body `one`
    text = robot(
        '<link name="base"/>',
        *(f'<link name="{name}">{inertial}</link>' for name in ('one', 'two')),
        joint('hinge', 'base', 'one', 'continuous', '0.1 0.2 0.3', '0 1 0').replace(
            '<origin ', '<origin rpy="0.4 0 0" '
        ),
        joint('slide', 'one', 'two', 'prismatic', '0.3 0 0', f'{-np.cos(0.2)} 0 {-np.sin(0.2)}',
              '<limit lower="0" upper="2" effort="1" velocity="1"/>').replace(
            '<origin ', '<origin rpy="0 0.2 0" '
        ),
    )  # fmt: skip
    same = made(text)
    assert arm.names == ('hinge', 'slide') and arm.mechanism.gravity[2] == -5
    assert arm.lower == (-1, 0) and arm.upper == (np.inf, 2)
    for q in RNG.uniform(-1, 1, (3, 2)):
        np.testing.assert_allclose(Evaluated(arm, q).M, Evaluated(same, q).M, rtol=1e-12)


def test_a_loop_of_sdf_closes_at_its_zero():
    """A four-bar whose corners are those of a square; the last joint has a pose of its own."""
    corners = {'a': '0 0 0', 'b': '0 1 0', 'c': '1 1 0'}
    links = [sdf_link(name, f'{at} 0 0 0') for name, at in corners.items()]
    joints = [
        sdf_joint(f'to_{child}', parent, child)
        for parent, child in (('world', 'a'), ('a', 'b'), ('b', 'c'))
    ]
    end = sdf_joint('end', 'world', 'c').replace('<axis>', '<pose>0 -1 0 0 0 0</pose><axis>')
    bar = made(sdf(*links, *joints, end), actuated=['to_a'])
    assert bar.home_moved < 1e-15 and len(bar.passive) == 2
    turned = Evaluated(bar, [0.3])
    np.testing.assert_allclose(dict(zip(bar.names, turned.all, strict=True))['to_b'], -0.3)


def test_a_joint_of_sdf_may_carry_its_parent():
    """Whether a joint names its links in one order or the other is no other machine."""
    links = sdf_link('a'), sdf_link('b', '0.2 0.1 0 0.3 0.2 0.1')
    base = sdf_joint('base', 'world', 'a')
    cross = '<axis2><xyz>0.6 0.8 0</xyz></axis2></joint>'
    one, other = (
        sdf_joint('cross', parent, child, 'universal', '1 0 0').replace('</joint>', cross)
        for parent, child in ('ab', 'ba')
    )
    pose = '<pose relative_to="b">0.1 0 0 0.5 0 0</pose><axis>'
    actuated = ['base', 'cross.1', 'cross.2']
    there = made(sdf(*links, base, one.replace('<axis>', pose)), actuated=actuated)
    back = made(sdf(*links, base, other.replace('<axis>', pose)), actuated=actuated)
    assert there.names == ('base', 'cross.1', 'cross.2')
    assert back.names == ('base', 'cross.2', 'cross.1')
    signs = np.diag((1, -1, -1))  # at zero both axes are where they were
    found, expected = Evaluated(back, (0.1, 0, 0)), Evaluated(there, (0.1, 0, 0))
    np.testing.assert_allclose(found.M, signs @ expected.M @ signs, rtol=1e-12)


@pytest.mark.parametrize(('version', 'axis'), [('1.4', 'x'), ('1.5', 'y'), ('1.10', 'y')])
def test_axes_of_old_sdf_are_seen_from_the_model(version, axis):
    turned = sdf_link('a', '0 0 0 0 0 1.5707963267948966')
    text = sdf(turned, sdf_joint('j', 'world', 'a', axis='1 0 0'))
    found = made(text.replace('version="1.9"', f'version="{version}"'))
    motion = found.mechanism.rotation[0] @ found.mechanism.axis[0]
    np.testing.assert_allclose(motion, np.eye(3)['xyz'.index(axis)], atol=1e-12)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (mjcf('<body name="b"><freejoint/><geom size="1"/></body>'), "body 'b' floats"),
        (mjcf('<body name="b"><joint/><geom type="mesh" mesh="m"/></body>'),
         "body 'b' has no inertial, and that of its mesh 'm'"),
        (mjcf('<body name="b"><joint/><geom/></body>', options='<default><geom type="mesh" '
              'mesh="m"/></default>'), "body 'b' has no inertial"),
        (mjcf('<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/></body>'),
         'inertia must satisfy A . B >= C'),
        (mjcf('<body><joint name="a"/><geom size="1"/></body><body><joint name="a"/></body>'),
         "repeated name 'a' in joint"),
        (mjcf('<body><joint name="a"/><geom size="1" mass="-1"/></body>'), 'mass'),
        (mjcf('<body><joint/><inertial pos="0 0 0" mass="nan" diaginertia="1 1 1"/></body>'),
         "line 1: <inertial> mass='nan' is not a number"),
        (mjcf('<body><joint/><geom size="1"/></body>', '<actuator><motor joint="x"/></actuator>'),
         "unknown transmission target|'x'"),
        (mjcf('<composite type="cable"/>'), 'composite.* flexible'),
        (mjcf('<attach model="m" body="b" prefix="p"/>'), 'attach.* attaches another model'),
        (mjcf('<replicate count="999"><replicate count="2"><body/></replicate></replicate>'),
         'makes more than 1000 copies'),
        (mjcf('<include file="x.xml"/>'), 'include.* not resolved'),
        (mjcf('<body foo="1"/>'), "unrecognized attribute: 'foo'"),
        (ARM.replace('</keyframe>', '</keyframe><equality><joint joint1="slide" joint2="tilt" '
                     'polycoef="0 1 2 0 0"/></equality>'), 'is not linear'),
        (robot(), 'has no links'),
        (robot(link('a'), link('a')), "line 2: link 'a' stands twice"),
        (robot('<link/>'), 'line 1: <link> has no name'),
        (robot(link('a'), joint('j', 'a', 'b')), "joint 'j' names an unknown link 'b'"),
        (robot(link('a'), joint('j', 'a', 'a')), "joint 'j' joins the link 'a' with itself"),
        (robot(link('a'), link('b'), joint('j', 'a', 'b', 'floating')), "joint 'j' floats"),
        (robot(link('a'), link('b'), joint('j', 'a', 'b', 'planar')), "'j' slides in a plane"),
        (robot(link('a'), link('b'), joint('j', 'a', 'b', 'screw')), "unknown type 'screw'"),
        (robot(link('a'), link('b'), joint('j', 'a', 'b', axis='0 0 0')), 'axis of zeros'),
        (robot(link('a'), link('b'), joint('j', 'a', 'b', xyz='1 2')),
         "<origin> xyz='1 2' must be 3 finite numbers"),
        (robot(link('a'), link('b', 'inf'), joint('j', 'a', 'b')), "value='inf' must be a finite"),
        (robot(link('a'), link('b', -1), joint('j', 'a', 'b')), "'b' has a negative mass, -1"),
        (robot(link('a'), link('b'), joint('j', 'a', 'b'), joint('k', 'b', 'a')),
         'carry each other in a circle: a, b'),
        (robot(link('a'), '<transmission><joint name="j"/></transmission>'),
         "joint 'j' names an unknown joint 'j'"),
        (robot(link('a'), link('b'), joint('j', 'a', 'b', more='<mimic joint="x"/>')),
         "joint 'j' names an unknown joint 'x'"),
        (robot(link('a'), '<closed_loop first="a" second="x" type="6d"/>'),
         "unknown link or joint 'x'"),
        (robot(link('a'), '<closed_loop first="a" second="a" type="5d"/>'), "'5d' must be 3d"),
        (robot(link('a'), '<joint_type joint="x" type="FIXED"/>'), "unknown joint 'x'"),
        (robot(link('a'), '<constraint name="c" type="x"><parent link="a"/><child link="a"/>'
               '</constraint>'), "unknown type 'x'"),
        (robot(link('a'), link('b', 1e300), joint('j', 'a', 'b')), "'b' has a number that is not"),
        (robot(link('a'), link('b'), joint('j', 'a', 'b', xyz='1e12 0 0')), 'not below 1e.09'),
        (sdf(), 'has no links'),
        (sdf(sdf_link('a'), sdf_joint('j', 'a', 'b')), "'j' names an unknown link or frame 'b'"),
        (sdf(sdf_link('a'), sdf_joint('j', 'world', 'a', 'gearbox')), "unknown type 'gearbox'"),
        (sdf(sdf_link('a'), sdf_joint('j', 'world', 'a', axis='')), "joint 'j' has no axis"),
        (sdf(sdf_link('a', of=' relative_to="b"'), sdf_link('b', of=' relative_to="a"')),
         'pose that is relative to itself'),
        (sdf(sdf_link('a', of=' relative_to="x"')), "link 'a' names an unknown frame 'x'"),
        (sdf(sdf_link('a', '1 2 3')), "pose='1 2 3' must be 6 finite numbers"),
        (sdf(world='<model name="n"/>'), 'has 2 models that move; keep one of n, m'),
        (sdf(world='<include><uri>model://x</uri></include>'), 'include.* another file'),
        (sdf(world='<population name="p"/>'), 'population.* another file'),
        (sdf(sdf_link('a').replace('<mass>2', '<mass>-2')), "link 'a' has a negative mass, -2"),
        (sdf(sdf_link('a').replace('<inertial>', '<inertial auto="true">')),
         "link 'a' has an inertia that follows from its shapes"),
        (sdf(sdf_link('a'), sdf_joint('j', 'a', 'a')), "joint 'j' joins the link 'a' with itself"),
        (sdf(sdf_link('a'), '<model name="n"/>'), "model 'n' is a model in a model"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_in_one_line(text, reason):
    with pytest.raises(InputError, match=reason) as caught:
        read(text, 'robot.xml')
    assert 'robot.xml' in str(caught.value) and '\n' not in str(caught.value)


def test_shapes_give_inertia_where_none_is_written():
    text = mjcf(
        '<body><joint name="j" axis="0 1 0"/><geom type="box" size="0.1 0.2 0.3" pos="0.5 0 0" '
        'density="500"/><geom type="mesh" mesh="m" mass="0"/></body>'
    )
    mass = 500 * 0.2 * 0.4 * 0.6
    inertia = mass * (0.5**2 + (0.2**2 + 0.6**2) / 12)
    assert Evaluated(made(text)).M[0, 0] == pytest.approx(inertia, rel=1e-12)


def test_inactive_equalities_and_tendons_are_told():
    text = five_bar().replace('site2="b"/>', 'site2="b" active="false"/>')
    bar = made(text, held=('left_elbow', 'right_elbow'))
    assert bar.passive == () and any('is not active' in doubt for doubt in bar.warnings)
    text = ARM.replace('<motor joint="slide"/>', '<motor name="t" tendon="t"/>').replace(
        '</worldbody>', '</worldbody><tendon><fixed name="t"><joint joint="slide" coef="1"/>'
        '<joint joint="pan" coef="1"/></fixed></tendon>')  # fmt: skip
    arm = made(text, held=['slide', *BALL])
    assert 'actuators that drive no single joint are left out: t' in arm.warnings


def test_without_mujoco_urdf_is_read_and_mjcf_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'mujoco', None)
    assert made(urdf()).actuated == ('shoulder', 'stroke')
    with pytest.raises(InputError, match='mujoco is not installed; pip install mujoco'):
        read(ARM)


def test_names_of_mujoco_are_kept():
    model = mujoco.MjModel.from_xml_string(ARM)
    description = read(ARM)
    assert [body.name for body in description.bodies] == [
        model.body(i).name for i in range(1, model.nbody)
    ]
    assert {'world', 'fork', 'tool'} <= {*description.frames}
