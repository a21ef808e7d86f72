"""Machines of descriptions: who is driven, held, closed; homes, tools, doubts."""

import math

import mujoco
import numpy as np
import pytest
from machine_files import ARM, INERTIAL, five_bar, joint, link, mjcf, urdf
from reading import Evaluated, InMujoco, made

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.mechanisms.description.machine import machine, read
from parallel_robot_model.mechanisms.description.parts import independent
from parallel_robot_model.robots.registry import resolve

BALL = ('ball.x', 'ball.y', 'ball.z')  # of ARM, which nothing drives


def hexapod(rod='0 0 1', drives=6, off=0.0):
    """Six rods on universal joints that push a platform on balls: 6-UPS, made as 6-SPS."""
    base, top, height = 0.6, 0.35, 0.7
    legs, closures, motors, sites = '', '', '', ''
    for i in range(6):
        a = math.radians((10, 110, 130, 230, 250, 350)[i])
        p = math.radians((50, 70, 170, 190, 290, 310)[i])
        foot = np.array([base * math.cos(a), base * math.sin(a), 0])
        head = np.array([top * math.cos(p), top * math.sin(p), height])
        z = (head - foot) / np.linalg.norm(head - foot)
        x = np.cross([0.3, 0.5, 1], z)
        axes = np.vstack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x))])
        if rod == '1 0 0':  # the rod lies along the x axis of its body
            axes = np.vstack([z, axes[0]])
        elif rod == '1 1 0':  # between two axes
            axes = np.vstack([z - axes[0], z + axes[0]]) / math.sqrt(2)
        legs += f"""
        <body pos="{foot[0]} {foot[1]} 0" xyaxes="{' '.join(map(str, axes.flatten()))}">
          <joint name="ball{i}" type="ball"/>{on_rod(rod, 0.05, 1.5, off)}
          <body><joint name="push{i}" type="slide" axis="{rod}" damping="3"/>
            {on_rod(rod, 0.1, 1)}
            <site name="head{i}" pos="{' '.join(str(v) for v in reach(rod, head - foot))}"/>
          </body>
        </body>"""
        sites += f'<site name="seat{i}" pos="{head[0]} {head[1]} 0"/>'
        closures += f'<connect site1="head{i}" site2="seat{i}"/>'
        motors += f'<motor joint="push{i}"/>' if i < drives else ''
    platform = f"""<body name="top" pos="0 0 {height}">
      <joint type="slide" name="x" axis="1 0 0"/><joint type="slide" name="y" axis="0 1 0"/>
      <joint type="slide" name="z" axis="0 0 1"/><joint type="ball" name="turn"/>
      <inertial pos="0 0 0.1" mass="8" diaginertia="0.3 0.3 0.5"/>{sites}</body>"""
    return mjcf(
        legs + platform,
        f'<equality>{closures}</equality><actuator>{motors}</actuator>',
        '<compiler inertiafromgeom="false"/>',
    )


def on_rod(rod, length, mass, off=0.0):
    """The inertia of a rod, its centre on its axis, or off it."""
    x, y, z = reach(rod, np.array([length, 0, 0])) + off * np.array([0, 1, 0])
    return f'<inertial pos="{x} {y} {z}" mass="{mass}" diaginertia="0.01 0.02 0.02"/>'


def reach(rod, way):
    direction = np.array([float(word) for word in rod.split()])
    return np.linalg.norm(way) * direction / np.linalg.norm(direction)


@pytest.mark.parametrize(('rod', 'spin'), [('0 0 1', 'z'), ('1 0 0', 'x'), ('1 1 0', 'x')])
def test_rods_between_balls_do_not_spin(rod, spin):
    text = hexapod(rod)
    stage = made(text)
    assert stage.held == tuple(f'ball{i}.{spin}' for i in range(6))
    assert stage.actuated == tuple(f'push{i}' for i in range(6)) and stage.units == ('m',) * 6
    assert len(stage.passive) == 18 and stage.tool == 'top'
    names = ('x', 'y', 'z', 'rx', 'ry', 'rz')
    assert stage.coordinates == tuple((n, 'rad' if 'r' in n else 'm') for n in names)
    assert any('ball0.' in line and 'held' in line for line in stage.remarks)
    at_home = Evaluated(stage)
    there = InMujoco(text, of_home(text))
    driven, held = ([stage.names.index(n) for n in of] for of in (stage.actuated, stage.held))
    np.testing.assert_allclose(at_home.W, there.follow(driven, held), atol=1e-9)
    np.testing.assert_allclose(at_home.M, at_home.W.T @ there.M @ at_home.W, rtol=1e-10)
    np.testing.assert_allclose(at_home.gravity, at_home.W.T @ there.force, rtol=1e-9)


def test_joints_that_nothing_drives_are_refused_where_masses_move_with_them():
    cart = mjcf(
        '<body name="cart"><joint name="slider" type="slide" axis="1 0 0"/><geom size="0.1"/>'
        '<body><joint name="pole" axis="0 1 0"/><geom size=".05" type="capsule" '
        'fromto="0 0 0 0 0 0.6"/>{}</body></body>',
        '<actuator><motor joint="slider"/></actuator>',
    )
    second = (
        '<body pos="0 0 0.6"><joint name="top" axis="0 1 0"/><geom size=".1" pos="0 0 1"/></body>'
    )
    for text, names in ((cart, 'pole'), (cart.replace('{}', second), 'pole, top')):
        text = text.replace('{}', '')
        with pytest.raises(InputError, match=f'that was read drives {names}, and masses move'):
            made(text)
        assert made(text, held=names.split(', ')).held == tuple(names.split(', '))
    swinging = mjcf(f'<body><joint name="a"/>{INERTIAL.format(0.1, 1)}<body pos="0.2 0 0">'
                    f'<joint name="b"/>{INERTIAL.format(0.1, 1)}</body></body>',
                    '<actuator><motor joint="a"/></actuator>',
                    '<option gravity="0 0 0"/>')  # fmt: skip
    with pytest.raises(InputError, match='drives b,'):
        made(swinging)


def test_a_rod_that_swings_about_its_ends_does_not_spin():
    assert made(hexapod(off=0.005)).held
    with pytest.raises(InputError, match=r'drives ball0\.z, ball1\.z, ball2\.z, '):
        made(hexapod(off=0.05))


def of_home(text):
    return mujoco.MjModel.from_xml_string(text).qpos0


def test_too_few_drives_are_refused_with_names():
    reason = '12 freedoms, but 5 actuated: .* actuate 1 more, or hold them, of push5'
    with pytest.raises(InputError, match=reason):
        made(hexapod(drives=5))
    assert made(hexapod(drives=5), held=['push5']).held[-1] == 'push5'
    with pytest.raises(InputError, match=r'2 freedoms, but 1 actuated.* of left_elbow, right'):
        made(five_bar(actuators=('left',)))


def test_too_many_drives_are_refused_with_names():
    reason = '3 actuated joints, but the loops leave 2 of them free; drop 1 of left, right, left_'
    with pytest.raises(InputError, match=reason):
        made(five_bar(actuators=('left', 'right', 'left_elbow')))
    with pytest.raises(InputError, match='1 actuated joint, but the loops leave 0 of them free'):
        made(five_bar(actuators=('left',)), held=['right', 'right_elbow'])


def test_drives_must_be_named_where_loops_have_none():
    reason = 'names no actuators: name those joints in actuated that are driven, of left, left_e'
    with pytest.raises(InputError, match=reason):
        made(five_bar(actuators=()))
    assert made(five_bar(actuators=()), actuated=['right', 'left']).actuated == ('right', 'left')


def test_names_of_actuators_stand_for_their_joints():
    assert made(five_bar(), actuated=['m_right', 'left']).actuated == ('right', 'left')
    with pytest.raises(UnknownNameError, match="unknown joint 'lefd'; did you mean 'left'"):
        made(five_bar(), actuated=['lefd'])
    with pytest.raises(InputError, match='stand twice in left, m_left'):
        made(five_bar(), actuated=['left', 'm_left'])
    with pytest.raises(InputError, match='held: left is actuated'):
        made(five_bar(), held=['left'])


def test_home_keeps_the_actuated_joints_if_it_can():
    bar = made(five_bar(), home={'left': 0.2, 'left_elbow': -0.3})
    start = bar.mechanism.home
    assert start[0] == 0.2 and start[2] == 0.0 and start[1] != -0.3
    again = made(five_bar(), home='left = 0.2, left_elbow=-0.3')
    np.testing.assert_array_equal(again.mechanism.home, start)


def test_home_moves_them_where_they_cannot_stay():
    bar = made(five_bar(), home='left=1, right=-1')
    assert bar.mechanism.home[0] < 0.9 and bar.home_moved > 0.3
    assert Evaluated(bar).all[0] == pytest.approx(bar.mechanism.home[0])


@pytest.mark.parametrize(
    ('home', 'reason'),
    [
        ('rest', "unknown keyframe 'rest' .known: home"),
        ('pan=x', "'pan=x' must be a joint and its position"),
        ('pan=1, tilt', "'tilt' must be a joint and its position"),
        ('pam=1', "unknown joint 'pam'; did you mean 'pan'"),
        ({'pan': math.inf}, 'pan must be a finite number'),
    ],
)
def test_wrong_homes_are_refused(home, reason):
    with pytest.raises(InputError, match=reason):
        made(ARM, home=home)


def test_keyframes_are_homes():
    arm = made(ARM, held=BALL)
    assert arm.mechanism.home[:3] == pytest.approx((0.3, 0.5, 0.2), abs=0)
    zero = made(ARM, held=BALL, home='pan=0')
    np.testing.assert_allclose(zero.mechanism.home[:3], (0, np.radians(20), 0.1))


def test_loops_that_cannot_close_are_refused():
    text = five_bar().replace('<body pos="0.2 0 0"', '<body pos="2 0 0"')
    with pytest.raises(InputError, match="'equality_0' stays open by 1"):
        made(text)


def four_bar(height):
    """A parallelogram; of height 0 it is flat, and singular."""
    pivots = {'crank': (-0.5, 0), 'follower': (0.5, 0)}
    length = math.hypot(0.2, height)
    angle = math.degrees(math.atan2(height, 0.2))
    legs = ''.join(
        f'<body pos="{x} {y} 0" euler="0 0 {angle}"><joint name="{name}"/>'
        f'{INERTIAL.format(0.1, 1)}'
        + (
            f'<body pos="{length} 0 0" euler="0 0 {-angle}"><joint name="coupler"/>'
            f'{INERTIAL.format(0.5, 1)}<site name="a" pos="1 0 0"/></body>'
            if name == 'crank'
            else f'<site name="b" pos="{length} 0 0"/>'
        )
        + '</body>'
        for name, (x, y) in pivots.items()
    )
    return mjcf(legs, '<equality><connect site1="a" site2="b"/></equality><actuator>'
                '<motor joint="crank"/></actuator>')  # fmt: skip


def test_singular_homes_are_refused():
    assert made(four_bar(0.2)).passive == ('coupler', 'follower')
    with pytest.raises(InputError, match=r'home is a singular posture: 1 closures .* 2 beside'):
        made(four_bar(0.0))


def test_the_tool_is_named_or_found():
    assert made(ARM, held=BALL, tool='rod').tool == 'rod'
    with pytest.raises(UnknownNameError, match="unknown site, body or link 'tol'; did you mean"):
        made(ARM, tool='tol')
    bar = made(five_bar())
    assert bar.tool == 'the point of equality_0' and 'tool taken is the point of' in bar.remarks[0]
    assert bar.coordinates == (('x', 'm'), ('y', 'm'))
    assert made(urdf()).tool == 'flange'
    assert made(urdf().replace('flange', 'plate')).tool == 'second'


def test_a_turning_frame_has_angles():
    turning = mjcf(f'<body><joint axis="0 0 1"/>{INERTIAL.format(0.1, 1)}</body>')
    assert made(turning).coordinates == (('rz', 'rad'),)
    scara = mjcf(
        f'<body><joint name="a"/>{INERTIAL.format(0.1, 1)}<body pos="0.3 0 0" euler="0 0 60">'
        f'<joint name="b"/>{INERTIAL.format(0.1, 1)}<body pos="0.3 0 0"><joint name="c"/>'
        f'<joint name="d" type="slide" axis="0 0 1"/>{INERTIAL.format(0, 1)}</body></body></body>'
    )
    names = made(scara).coordinates
    assert names == (('x', 'm'), ('y', 'm'), ('z', 'm'), ('rz', 'rad'))


def test_a_tool_with_other_motions_leaves_the_joints_as_pose():
    text = urdf(link('third') + joint('third', 'second', 'third', axis='1 0 0'))
    arm = made(text, tool='first')
    assert arm.coordinates == () and len(arm.mechanism.coordinate) == 0
    assert any('the pose is these joints' in line for line in arm.remarks)


def test_masses_scale_and_a_payload_is_carried():
    bar, heavy = made(five_bar()), made(five_bar(), mass_factor=1.5, payload=2.0)
    W = Evaluated(bar)
    tip = InMujoco(five_bar(), W.all)
    rate = np.zeros((3, 4))
    mujoco.mj_jacSite(tip.model, tip.data, rate, None, tip.model.site('a').id)
    moved = rate @ W.W
    np.testing.assert_allclose(Evaluated(heavy).M, 1.5 * W.M + 2 * moved.T @ moved, rtol=1e-11)


def stretched(limit='', more=''):
    """An arm that lies stretched along x and turns about y, with a lamp at its end."""
    return (
        f'<robot name="stretched"><link name="base"/>{link("upper")}'
        + joint('a', 'base', 'upper', axis='0 1 0')
        + link('fore').replace('<mass', '<origin xyz="0.3 0 0"/><mass')
        + joint('b', 'upper', 'fore', 'revolute', '0.4 0 0', '0 1 0', f'<limit {limit}/>')
        + '<link name="lamp"/>'
        + joint('bolt', 'fore', 'lamp', 'fixed', xyz='0.5 0 0')
        + f'{more}</robot>'
    )


def test_the_tool_is_what_is_fixed_to_the_end():
    arm = made(stretched())
    assert (
        arm.tool == 'lamp' and not arm.planar and any('no place' in line for line in arm.remarks)
    )
    assert [name for name, _ in arm.coordinates] == ['z', 'ry']
    more = '<link name="e"/>' + joint('nail', 'fore', 'e', 'fixed', xyz='0.1 0 0')
    assert made(stretched(more=more)).tool == 'fore'
    assert made(stretched(more=more.replace('"e"', '"left_fingertip"'))).tool == 'left_fingertip'


def test_gravity_below_the_limits_is_no_doubt():
    assert not any('gravity' in line for line in made(stretched('effort="3"')).warnings)


def test_speeds_of_a_file_are_the_limits():
    text = stretched('velocity="20"')
    found = resolve('paper_circle', {'robot_description': text, 'robot_model': 'stretched'})
    assert found['safety.speed_limit'] == [10.0, 20.0]
    assert found['trajectory.max_joint_speed'] == 20.0


def changed(joint, attributes):
    """The five-bar with more said of a joint."""
    return five_bar().replace(f'<joint name="{joint}"/>', f'<joint name="{joint}" {attributes}/>')


@pytest.mark.parametrize(
    ('text', 'doubt'),
    [
        (changed('left_elbow', 'frictionloss="1"'),
         'dry friction of passive joints [N m or N] is left out: left_elbow (1)'),
        (changed('left', 'range="40 60"'),
         'home is outside the travel of joints: left at 0'),
        (urdf().replace('lower="-1" upper="2"', 'lower="0" upper="0"'),
         'travel without an extent is taken for none: shoulder'),
        (urdf().replace('lower="-1" upper="2"', 'lower="-180" upper="90"'),
         'travel of shoulder ends at -180 rad: if that is in degrees, it must be -3.142 rad'),
        (urdf().replace('lower="-1" upper="2"', 'lower="0" upper="400"')
         .replace('"shoulder" type="revolute"', '"shoulder" type="prismatic"'),
         'travel of shoulder ends at 400 m: if that is in mm, it must be 0.4 m'),
        (urdf().replace('<mass value="2"/>', '<mass value="20000"/>'), "'second' weighs 20000"),
        (urdf().replace('<mass value="2"/>', '<mass value="1e-9"/>'), 'than 1e-06 kg: second'),
        (urdf().replace('ixx="0.02"', 'ixx="0.09"'), "body 'second': no body has moments"),
        (urdf('<loop_joint name="x"/>'), 'left out: <loop_joint> of <robot>, line '),
        (urdf(link('closing_1') + joint('c', 'first', 'closing_1', 'fixed')),
         'nothing closes the loops that links are named after: closing_1'),
        (urdf(link('stand')), 'links without a parent are fixed to the world: base, stand'),
        (stretched('effort="2.9"'),
         'gravity takes 2.943 N m at b at home, above its limit, 2.9 N m'),
    ],
)  # fmt: skip
def test_doubts_are_told(text, doubt):
    assert any(doubt in line for line in made(text).warnings)


@pytest.mark.parametrize('ends', ['lower="-6.3" upper="6.3"', 'lower="-1e16" upper="1e16"'])
def test_a_turn_to_both_sides_and_a_travel_without_end_are_no_degrees(ends):
    text = urdf().replace('lower="-1" upper="2"', ends)
    assert text != urdf() and not any('travel' in line for line in made(text).warnings)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (urdf().replace('lower="-1" upper="2"', 'lower="2" upper="-1"'),
         "the travel of joint 'shoulder' has its ends swapped: from 2 to -1"),
        (urdf(link('tip', 0).replace('0.01', '0') + joint('last', 'second', 'tip')),
         'nothing with a mass moves with joint last'),
        (urdf().replace('ixx="0.02"', 'ixx="-0.5"'), 'its inertia has the moment -0'),
        (mjcf('<body><joint name="b" type="ball"/><geom size="1"/></body>'),
         'no joint is actuated, of b.x, b.y, b.z'),
        (mjcf('<body><joint name="b" type="ball"/><geom size="1"/></body><body>'
              '<joint name="b.x"/><geom size="1"/></body>'), 'several joints of the name b.x'),
        (mjcf('<geom size="1"/>'), 'robot.xml has no joints that move'),
        (mjcf('<replicate count="201" offset="1 0 0"><body><joint/><geom size="1"/></body>'
              '</replicate>'), 'has 201 joints; 200 are possible'),
    ],
)  # fmt: skip
def test_impossible_machines_are_refused(text, reason):
    with pytest.raises(InputError, match=reason):
        made(text)


def test_a_leaf_without_mass_behind_others_is_no_harm():
    """Between two joints nothing needs a mass of its own."""
    text = urdf('<link name="cross"/>' + joint('cross', 'second', 'cross', axis='1 0 0')
                + link('tip') + joint('last', 'cross', 'tip', axis='0 1 0'))  # fmt: skip
    assert np.linalg.eigvalsh(Evaluated(made(text)).M)[0] > 0


def test_reading_twice_gives_the_same_bytes():
    for text, held in ((hexapod(), ()), (five_bar(), ()), (ARM, BALL), (urdf(), ())):
        first, again = (machine(read(text), held=held) for _ in range(2))
        one, other = ([*made.mechanism, *made.mechanism.elements] for made in (first, again))
        for a, b in zip(one, other, strict=True):
            assert isinstance(a, tuple) or np.asarray(a).tobytes() == np.asarray(b).tobytes()


def test_rows_are_chosen_by_length_and_the_first_of_equals():
    rows = np.array([[1, 0, 0], [1 + 1e-9, 0, 0], [0, 2, 0], [1, 1, 0], [0, 0, 0.5]])
    assert independent(rows, 3) == [0, 2, 4]
