"""What URDF and SDF say of motion is obeyed, or told with its line; nothing is lost in silence."""

import math
import re

import numpy as np
import pytest
from machine_files import joint, link, urdf
from reading import Evaluated, made
from test_description import robot, sdf, sdf_joint, sdf_link

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.mechanisms.description.machine import read

LIMIT = 'lower="-1" upper="2" effort="50" velocity="3"'  # of `urdf`
DYNAMICS = '<dynamics damping="0.4" friction="0.1"/>'
ALL = (-math.inf, math.inf)


def said(text, *words):
    """The description of a text, one of whose doubts has all the words."""
    found = read(text, 'robot.xml')
    assert any(all(word in line for word in words) for line in found.doubts), found.doubts
    return found


def shoulder(old, new):
    """The shoulder of the arm with other text."""
    text = urdf().replace(old, new)
    assert text != urdf()
    return text


def of(found, name='shoulder'):
    return next(each for each in found.joints if each.name == name)


def test_what_is_known_is_no_doubt():
    found = read(urdf(), 'robot.xml').doubts
    assert found == tuple(
        f'{key}=0 is taken for no limit: stroke' for key in ('effort', 'velocity')
    )


@pytest.mark.parametrize(
    ('old', 'new', 'words'),
    [
        ('friction="0.1"', 'fricton="0.1"',
         'left out: fricton of <dynamics> (did you mean friction?), line 26'),
        ('<origin xyz="0.1 0.2 0.3"', '<orgin xyz="0.1 0.2 0.3"',
         'left out: <orgin> of <joint> (did you mean origin?), line 24'),
        ('<mass value="3"/>', '<mass>3</mass>', 'left out: the text of <mass>, line 6'),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0" frame="base"/>', 'left out: frame of <axis>'),
        ('velocity="3"', 'velocity="3" acceleration="9" jerk="7" deceleration="8"',
         'left out: acceleration of <limit>, line 25'),
        (DYNAMICS, f'{DYNAMICS}<stiffness value="3"/>', 'left out: <stiffness> of <joint>'),
        (DYNAMICS, DYNAMICS * 2, 'left out: another <dynamics> of <joint>, line 26'),
        ('<link name="flange">', '<link name="flange"><mass value="1"/>',
         'left out: <mass> of <link>'),
        ('<robot name="arm">', '<robot name="arm"><gazebo reference="elbow"/>',
         '<gazebo> names neither link nor joint: elbow'),
        ('<robot name="arm">', '<robot name="arm"><gazebo reference="first"><turnGravityof/>'
         '</gazebo>', 'left out: <turnGravityof> of <gazebo> (did you mean turnGravityOff?)'),
    ],
)  # fmt: skip
def test_what_is_not_known_is_told_with_its_line(old, new, words):
    said(shoulder(old, new), words)


def test_a_mass_that_is_left_out_is_named_where_it_is_missed():
    text = urdf().replace('<mass value="2"/>', '<mass>2</mass>')
    with pytest.raises(
        InputError, match=r'joint stroke: .*; left out: the text of <mass>, line 19'
    ):
        made(text)


def test_many_of_a_kind_are_one_line():
    text = urdf().replace('<limit ', '<limit jerk="3" ')
    (line,) = [line for line in read(text, 'robot.xml').doubts if 'jerk' in line]
    assert line == 'left out: jerk of <limit>, line 25, 33'


def test_what_has_no_effect_on_motion_is_no_doubt():
    more = (
        '<gazebo reference="first"><mu1>0.3</mu1><kp>9</kp><selfCollide>1</selfCollide>'
        '<material>Gazebo/Red</material><sensor name="s"><gravity>3</gravity></sensor></gazebo>'
        '<material name="red"/><transmission name="t" type="T"><type>S</type><joint name="stroke">'
        '<hardwareInterface>E</hardwareInterface></joint><actuator name="m">'
        '<mechanicalReduction>50</mechanicalReduction></actuator></transmission>'
        '<ros2_control name="c" type="system"><hardware><plugin>p</plugin></hardware>'
        '<joint name="stroke"><param name="id">7</param><command_interface name="effort"/>'
        '<state_interface name="position"/></joint><sensor name="x"/></ros2_control>'
    )
    assert read(urdf(more), 'robot.xml').doubts == read(urdf(), 'robot.xml').doubts


class TestOrigins:
    QUATERNION = 'quat_xyzw="0.1 0.2 0.3 0.9273618495495703"'

    @pytest.mark.parametrize('rpy', ['0.1 0.2 0.3', '0.4 0.5 0.6'])  # of the inertia, of a joint
    def test_a_quaternion_turns(self, rpy):
        text = shoulder(f'rpy="{rpy}"', self.QUATERNION)
        found = said(text, 'quat_xyzw is read', 'ignore it: line')
        x, y, z, w = 0.1, 0.2, 0.3, 0.9273618495495703
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        rotation = np.eye(3) + 2 * w * cross + 2 * cross @ cross
        first = next(body for body in found.bodies if body.name == 'first')
        if rpy == '0.4 0.5 0.6':
            np.testing.assert_allclose(first.rotation, rotation, atol=1e-15)
        else:
            moments = np.array([[5, 1, 0.2], [1, 6, -0.4], [0.2, -0.4, 3]]) / 100
            np.testing.assert_allclose(first.inertia, rotation @ moments @ rotation.T, atol=1e-16)

    def test_two_ways_to_say_one_rotation_must_agree(self):
        both = f'rpy="0.4 0.5 0.6" {self.QUATERNION}'
        with pytest.raises(InputError, match='line 24: <origin> has an rpy and another quat_xyzw'):
            read(shoulder('rpy="0.4 0.5 0.6"', both), 'robot.xml')
        half = math.sqrt(0.5)
        same = f'rpy="0 0 {math.pi / 2}" quat_xyzw="0 0 {half} {half}"'
        said(shoulder('rpy="0.4 0.5 0.6"', same), 'quat_xyzw is read')

    def test_it_must_be_one(self):
        with pytest.raises(InputError, match='has a quaternion of length 2, not 1'):
            read(shoulder('rpy="0.4 0.5 0.6"', 'quat_xyzw="0 0 0 2"'), 'robot.xml')

    def test_of_sdf(self):
        half = math.sqrt(0.5)
        text = sdf(sdf_link('a', f'1 2 3 0 0 {half} {half}', ' rotation_format="quat_xyzw"'))
        body = read(text).bodies[1]
        np.testing.assert_allclose(body.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
        assert body.position.tolist() == [1, 2, 3]


class TestRotors:
    ROTOR = '<drake:rotor_inertia value="1e-4"/><drake:gear_ratio value="100"/>'

    @pytest.mark.parametrize(
        'inside', ['<actuator name="m">{}</actuator><joint name="stroke"/>',
                   '<joint name="stroke"/>{}']
    )  # fmt: skip
    def test_of_urdf(self, inside):
        text = urdf(f'<transmission name="t">{inside.format(self.ROTOR)}</transmission>')
        arm = made(text, actuated=['shoulder', 'stroke'])
        assert arm.mechanism.armature.tolist() == pytest.approx([0, 1e-4 * 100**2])
        added = Evaluated(arm).M - Evaluated(made(urdf())).M
        np.testing.assert_allclose(added, np.diag([0, 1]), atol=1e-14)

    def test_of_sdf(self):
        rotor = '<drake:rotor_inertia>2e-4</drake:rotor_inertia>'
        rotor += '<drake:gear_ratio>50</drake:gear_ratio>'
        hinge = sdf_joint('j', 'world', 'a').replace('</joint>', f'{rotor}</joint>')
        assert made(sdf(sdf_link('a'), hinge)).mechanism.armature == pytest.approx(0.5)


class TestSpringsAndWeight:
    def test_of_sdf(self):
        dynamics = (
            '<dynamics><spring_stiffness>30</spring_stiffness><spring_reference>0.2'
            '</spring_reference><damping>3</damping><friction>4</friction></dynamics>'
        )
        light = sdf_link('a').replace('<inertial>', '<gravity>false</gravity><inertial>')
        found = read(sdf(light, sdf_link('b'), sdf_joint('j', 'world', 'a', more=dynamics),
                         sdf_joint('k', 'a', 'b')))  # fmt: skip
        hinge = of(found, 'j')
        assert (hinge.stiffness, hinge.rest) == ((30,), 0.2)
        assert (hinge.damping, hinge.coulomb) == ((3,), 4)
        assert {body.name: body.lifted for body in found.bodies[1:]} == {'a': 1, 'b': 0}
        assert not any('left out' in line for line in found.doubts)
        weightless = sdf('<gravity>0</gravity>', sdf_link('a'), sdf_link('b'),
                         sdf_joint('k', 'a', 'b'))  # fmt: skip
        assert [body.lifted for body in read(weightless).bodies[1:]] == [1, 1]

    @pytest.mark.parametrize('off', ['<turnGravityOff>true</turnGravityOff>',
                                     '<gravity>0</gravity>'])  # fmt: skip
    def test_of_gazebo(self, off, tmp_path):
        file = tmp_path / 'arm.urdf'
        file.write_text(urdf(
            f'<gazebo reference="second">{off}<sensor name="s"/></gazebo><gazebo '
            'reference="stroke"><springStiffness>300</springStiffness><springReference>0.1'
            '</springReference><plugin name="p"/></gazebo>'
        ))  # fmt: skip
        found = read(robot_file.text_of(file))
        assert [body.lifted for body in found.bodies] == [0, 0, 0, 1]
        assert (of(found, 'stroke').stiffness, of(found, 'stroke').rest) == ((300,), 0.1)

    def test_what_is_off_is_no_doubt_and_what_is_on_is_told(self):
        off = '<enable_wind>0</enable_wind><velocity_decay><linear>0.0</linear></velocity_decay>'
        text = sdf(sdf_link('a').replace('<inertial>', f'{off}<inertial>'))
        assert not any('left out' in line for line in read(text).doubts)
        said(text.replace('0.0', '0.1'), 'left out: <velocity_decay> of <link>, line 1')

    def test_gravity_of_a_world(self):
        old = '<physics type="ode"><gravity>0 0 -3</gravity><ode><x>1</x></ode></physics>'
        assert read(sdf(sdf_link('a'), world=old)).gravity[2] == -3
        assert read(sdf(sdf_link('a'))).gravity[2] == -9.8


class TestLimits:
    @pytest.mark.parametrize(
        ('limit', 'ends', 'words'),
        [
            ('upper="1" effort="5" velocity="1"', (0, 1), 'missing is 0'),
            ('lower="-1" effort="5" velocity="1"', (-1, 0), 'missing is 0'),
            ('effort="5" velocity="1"', ALL, 'neither lower nor upper'),
            ('lower="-inf" upper="inf" effort="5" velocity="1"', ALL, 'effort=0'),
            ('lower="-1" upper="1" effort="-1" velocity="-1"', (-1, 1),
             'effort=-1 is taken for no limit: shoulder'),
            ('lower="-1" upper="1" effort="-50" velocity="1"', (-1, 1),
             'effort=-50 is taken for 50: shoulder'),
        ],
    )  # fmt: skip
    def test_ends_as_specified(self, limit, ends, words):
        hinge = of(said(shoulder(LIMIT, limit), words))
        assert (hinge.lower, hinge.upper) == ends
        effort = {'-1': math.inf, '-50': 50}.get(re.search('effort="(.*?)"', limit)[1], 5)
        assert hinge.effort == (-effort, effort)

    def test_a_missing_end_beyond_the_other_is_refused(self):
        with pytest.raises(InputError, match="joint 'shoulder' has no upper, which is then 0"):
            read(shoulder(LIMIT, 'lower="1" effort="5" velocity="1"'), 'robot.xml')

    def test_none_where_the_type_demands_some(self):
        hinge = of(said(shoulder(f'<limit {LIMIT}/>', ''), 'revolute without the <limit>'))
        assert (hinge.lower, hinge.upper) == ALL
        said(shoulder('type="revolute"', 'type="continuous"'), 'travel of a continuous joint')

    @pytest.mark.parametrize(
        ('soft', 'ends', 'words'),
        [
            ('soft_lower_limit="-0.5" soft_upper_limit="1.5" k_velocity="9"', (-0.5, 1.5),
             'travel in <safety_controller> is narrower than in <limit>, and taken: shoulder'),
            ('soft_lower_limit="-0.5" soft_upper_limit="1.5" k_velocity="9"', (-0.5, 1.5),
             'left out: k_velocity of <safety_controller>'),
            ('soft_lower_limit="-5" soft_upper_limit="1.5"', (-1, 1.5), 'narrower'),
            ('soft_upper_limit="1.5"', (0, 1.5), 'missing is 0'),
            ('soft_lower_limit="0" soft_upper_limit="0"', (-1, 2), 'without an extent'),
        ],
    )  # fmt: skip
    def test_soft_ones(self, soft, ends, words):
        text = shoulder(DYNAMICS, f'{DYNAMICS}<safety_controller {soft}/>')
        hinge = of(said(text, words))
        assert (hinge.lower, hinge.upper) == ends

    def test_those_that_allow_nothing_are_refused(self):
        soft = '<safety_controller soft_lower_limit="3" soft_upper_limit="4"/>'
        match = 'no travel that all its limits allow: 3 to 4 in <safety_controller>, -1 to 2 in'
        with pytest.raises(InputError, match=match):
            read(shoulder(DYNAMICS, DYNAMICS + soft), 'robot.xml')

    @staticmethod
    def control(interfaces, more=''):
        faces = ''.join(
            f'<command_interface name="{name}">'
            + ''.join(f'<param name="{key}">{value}</param>' for key, value in ends.items())
            + '</command_interface>'
            for name, ends in interfaces.items()
        )
        return urdf(f'<ros2_control name="c" type="system"><joint name="shoulder">{faces}{more}'
                    '</joint></ros2_control>')  # fmt: skip

    def test_of_ros2_control(self):
        position, velocity = {'min': -0.5, 'max': 9}, {'min': -1, 'max': 2}
        text = self.control({'position': position, 'velocity': velocity, 'effort': {'min': -12}})
        hinge = of(said(text, 'effort in <ros2_control> is narrower than in <limit>, and taken'))
        assert (hinge.lower, hinge.upper, hinge.velocity) == (-0.5, 2, 1)
        assert hinge.effort == (-12, 50)
        made_of_it = made(text, actuated=['shoulder', 'stroke'])
        assert made_of_it.least_effort[0] == -12 and made_of_it.effort[0] == 50
        off = of(read(self.control({'effort': {'max': 12}}, '<limits enable="false"/>')))
        assert off.effort == (-50, 50)

    def test_parameters_that_couple_joints_are_told(self):
        said(
            self.control({}, '<param name="mimic">stroke</param>'), 'left out: <param> of <joint>'
        )

    def test_of_sdf(self):
        ends = '<limit><lower>-1</lower><effort>-1</effort><velocity>0</velocity></limit>'
        text = sdf(sdf_link('a'), sdf_joint('j', 'world', 'a', more=ends))
        hinge = of(said(text, 'velocity=0 is taken for no limit: j'), 'j')
        assert (hinge.lower, hinge.upper) == (-1, math.inf) and hinge.effort == ALL


def four_bar(coupler, last):
    """A crank and a rocker of 0.3 m, 0.4 m apart, and what joins their ends."""
    legs = ''.join(
        link(name) + joint(name, 'base', name, xyz=f'{x} 0 0')
        for name, x in (('a', 0), ('b', 0.4))
    )
    motor = '<transmission name="t"><joint name="a"/></transmission>'
    return robot('<link name="base"/>', legs, link('c', 0.5), coupler, last, motor)


def pin(name, parent, place, child='c'):
    at = {'a': '0 0 0', 'b': '0.4 0 0'}[parent]
    return (
        f'<constraint name="{name}" type="{place}"><parent link="{parent}"/><parent_origin '
        f'xyz="0 0.3 0"/><parent_axis xyz="0 0 1"/><child link="{child}"/><child_origin '
        f'xyz="{at}"/><child_axis xyz="0 0 1"/></constraint>'
    )


class TestPlatforms:
    TREE = four_bar(joint('c', 'a', 'c', 'continuous', '0 0.3 0'), pin('right', 'b', 'revolute'))

    @pytest.mark.parametrize(
        ('kind', 'names'), [('floating', ['c.px', 'c.py', 'c.pz', 'c']),
                            ('planar', ['c.px', 'c.py', 'c'])]
    )  # fmt: skip
    def test_legs_hold_one_that_floats(self, kind, names):
        free = joint('c', 'base', 'c', kind, '0.02 0.28 0')
        text = four_bar(free, pin('left', 'a', 'revolute') + pin('right', 'b', 'revolute'))
        found = read(text, 'robot.xml')
        assert [each.name for each in found.joints if each.name[0] == 'c'] == names
        bar, reference = made(text), made(self.TREE)
        assert bar.actuated == ('a',) and {'c.px', 'c.py', 'b'} <= {*bar.passive}
        for q in (0.0, 0.3):
            here, there = Evaluated(bar, [q], [0.7]), Evaluated(reference, [q], [0.7])
            np.testing.assert_allclose(here.M, there.M, rtol=1e-9)
            np.testing.assert_allclose(here.force, there.force, atol=1e-9)

    def test_without_legs_it_is_refused(self):
        free = joint('c', 'base', 'c', 'floating')
        with pytest.raises(InputError, match="joint 'c' floats, and no loop holds it; a robot"):
            read(four_bar(free, ''), 'robot.xml')
        own = link('d') + joint('d', 'c', 'd') + pin('own', 'a', 'revolute').replace('"a"', '"d"')
        with pytest.raises(InputError, match="joint 'c' floats, and no loop holds it"):
            read(four_bar(free, own), 'robot.xml')  # its loop is within itself

    def test_loops_that_nothing_closes_are_told(self):
        ends = '<link name="c_end"/>' + joint('last', 'c', 'c_end', 'continuous', '0.4 0 0')
        text = four_bar(joint('c', 'a', 'c', 'continuous', '0 0.3 0'), ends)
        match = 'joint last: .* no loop is closed: of a URDF, `<constraint>` or `closed_loop`'
        with pytest.raises(InputError, match=match):
            made(text, actuated=['a', 'b', 'c', 'last'])


class TestGazebo:
    CHAIN = joint('c', 'a', 'c', 'continuous', '0 0.3 0')
    CLOSE = (
        '<gazebo><joint name="d" type="revolute"><parent>b</parent><child>c</child>'
        '<pose>0.4 0 0 0 0 0</pose><axis><xyz>0 0 1</xyz></axis></joint></gazebo>'
    )

    def test_a_joint_of_it_closes_a_loop(self):
        """As gazebosim.org's page of kinematic loops has it."""
        text = four_bar(self.CHAIN, self.CLOSE)
        assert not any('left out' in line for line in read(text).doubts)
        for q in (0.0, 0.3):
            here, there = Evaluated(made(text), [q]), Evaluated(made(TestPlatforms.TREE), [q])
            np.testing.assert_allclose(here.M, there.M, rtol=1e-9)

    def test_one_to_the_world(self):
        loops = read(four_bar(self.CHAIN, self.CLOSE.replace('>b<', '>world<'))).loops
        np.testing.assert_allclose(loops[0].first.position, (0.4, 0.3, 0))
        np.testing.assert_allclose(loops[0].second.position, (0.4, 0, 0))

    def test_one_of_unknown_links_is_refused(self):
        with pytest.raises(InputError, match="joint 'd' names an unknown link or frame 'x'"):
            read(four_bar(self.CHAIN, self.CLOSE.replace('>c<', '>x<')))


class TestFrames:
    LINKS = sdf_link('a', '0.1 0 0.2 0 0.3 0'), sdf_link('b', '0.4 0.2 0 0.1 0.2 0.3')
    BASE = sdf_joint('j', 'world', 'a')
    FRAMES = (
        '<frame name="tip" attached_to="a"><pose>0.3 0 0 0.2 0 0</pose></frame>'
        '<frame name="end" attached_to="tip"><pose relative_to="b">0.1 0 0.4 0 0 1</pose></frame>'
    )

    def test_a_joint_may_name_them(self):
        by_frames = sdf(*self.LINKS, self.FRAMES, self.BASE,
                        '<frame name="grip" attached_to="b"><pose>0 0.1 0 0.5 0 0</pose></frame>',
                        sdf_joint('k', 'end', 'grip', axis='0 1 0'))  # fmt: skip
        pose = '<pose relative_to="b">0 0.1 0 0.5 0 0</pose><axis>'
        by_links = sdf(*self.LINKS, self.BASE,
                       sdf_joint('k', 'a', 'b', axis='0 1 0').replace('<axis>', pose))  # fmt: skip
        for q in ((0, 0), (0.3, -0.4)):
            found, same = (Evaluated(made(text), q) for text in (by_frames, by_links))
            np.testing.assert_allclose(found.M, same.M, rtol=1e-13)

    def test_one_of_the_model_hangs_on_its_canonical_link(self):
        text = sdf(*self.LINKS, self.BASE, sdf_joint('k', 'a', 'b'),
                   '<frame name="top"><pose>0 0 2 0 0 0</pose></frame>')  # fmt: skip
        text = text.replace('<model name="m">', '<model name="m" canonical_link="b">')
        found = read(text)
        assert found.bodies[found.frames['top'].body].name == 'b'
        fixed = sdf_joint('fix', 'world', '__model__', 'fixed', '')
        model = read(text.replace(self.BASE, fixed))
        assert [body.name for body in model.bodies if body.parent == 0] == ['b']

    def test_a_model_stands_where_its_frame_is_put(self):
        text = sdf('<pose relative_to="desk">1 0 0 0 0 0</pose>', sdf_link('a', '0 0 0.5 0 0 0'),
                   '<frame name="foot"><pose>0 0 -0.25 0 0 0</pose></frame>', self.BASE,
                   world='<frame name="desk"><pose>0 2 0 0 0 0</pose></frame>')  # fmt: skip
        text = text.replace('<model name="m">', '<model name="m" placement_frame="foot">')
        np.testing.assert_allclose(read(text).bodies[1].position, (1, 2, 0.75), atol=1e-15)

    def test_a_joint_may_have_the_name_of_its_link(self):
        """In SDF before 1.7."""
        text = sdf(*self.LINKS, self.BASE, sdf_joint('k', 'a', 'b'))
        text = text.replace('<axis>', '<pose>0 0.5 0 0 0 0</pose><axis>')
        named = read(text.replace('"k"', '"b"'))
        np.testing.assert_allclose(of(named, 'b').anchor, of(read(text), 'k').anchor)

    @pytest.mark.parametrize(
        ('parts', 'reason'),
        [
            (('<frame name="f" attached_to="g"/><frame name="g" attached_to="f"/>',
              sdf_joint('k', 'f', 'b')), "'k' hangs on 'f', which hangs on itself"),
            ((sdf_joint('k', 'a', ''),), "joint 'k' has no child"),
            (('<joint name="x" type="gearbox"/>',), "joint 'x' has no parent"),
        ],
    )  # fmt: skip
    def test_those_that_lead_nowhere_are_refused(self, parts, reason):
        with pytest.raises(InputError, match=reason):
            read(sdf(*self.LINKS, self.BASE, *parts))


@pytest.mark.parametrize(
    ('text', 'name', 'words'),
    [
        (
            urdf().replace('friction="0.1"', 'friction="x"'),
            'my arm.urdf',
            'my arm.urdf, line 26: ',
        ),
        (sdf(sdf_link('a', '1 2')), 'arm.sdf', 'arm.sdf, line 1: <pose>'),
        (robot(), 'none.urdf', 'none.urdf has no links'),
        (urdf().replace('value="2"', 'value="1e300"'), 'arm.urdf', "arm.urdf: body 'second' has"),
    ],
)
def test_messages_name_the_file(text, name, words, tmp_path):
    file = tmp_path / name
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read(robot_file.text_of(file))
    assert str(caught.value).startswith(words)


@pytest.mark.parametrize(
    ('old', 'new', 'words'),
    [
        ('ixx="0.02" iyy="0.03" izz="0.03"', 'ixx="20000" iyy="30000" izz="30000"',
         "body 'second': 3e+04 kg m^2 is the inertia of its 2 kg at 122 m, and the machine has "
         '0.5 m: if it is in g mm^2, it must be 3e-05 kg m^2'),
        ('<mass value="2"/>', '<mass value="2000"/>',
         "'second' weighs 2000 kg, too much for its inertia: if that is in g, it must be 2 kg"),
    ],
)  # fmt: skip
def test_units_of_masses_and_inertias_are_doubted(old, new, words):
    assert any(words in line for line in made(shoulder(old, new)).warnings)
