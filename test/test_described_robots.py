"""Robots that come as descriptions: named by a path, run by all laws, kept in the bag."""

import json
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import vector
from parallel_robot_model.configuration import config, config_files
from parallel_robot_model.mechanisms.skeleton import drawn
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.contract import FOUND, PoseMotion
from parallel_robot_model.robots.link import frames as link_frames
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_model.robots.tree import angles_of, links_of
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import simulate

MACHINES = config.directory() / config_files.MACHINES
OF_ARM = {'safety.min_sin_elbow', 'trajectory.min_sin_elbow'}


def space_origins(links, positions):
    """Origins of links in the world, shape (L, 3)."""
    frames = {FRAME: Rotation.identity()}, {FRAME: np.zeros(3)}
    for link, origin, turn in zip(links, *link_frames(links, positions), strict=True):
        frames[1][link.name] = frames[1][link.parent] + frames[0][link.parent].apply(origin)
        frames[0][link.name] = frames[0][link.parent] * Rotation.from_quat(turn)
    return np.array([frames[1][link.name] for link in links])


def loop_of(values):
    return simulate(configure(values)).run


@pytest.fixture
def own(tmp_path):
    """A five-bar of somebody else's, beside his scenario."""
    file = tmp_path / 'my_bar.xml'
    shutil.copy(MACHINES / 'five_bar.xml', file)
    return file


class TestNaming:
    def test_a_path_is_a_robot_wherever_one_is_named(self, own, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        scenario = tmp_path / 'mine.yaml'
        scenario.write_text('robot_model: my_bar.xml\n')
        monkeypatch.chdir('/')
        found = [
            resolve(str(own)),
            resolve(str(scenario)),
            resolve('five_bar_circle', {'robot_model': str(own)}),
        ]
        for values in found:
            assert values['robot_model'] == 'my_bar'
            assert values['robot_description'].lstrip().startswith('<mujoco')
            assert values['joints'] == ['left', 'right']
        assert [values['scenario'] for values in found] == ['my_bar', 'mine', 'five_bar_circle']

    def test_another_robot_drops_the_description(self):
        values = resolve('five_bar_circle', {'robot_model': 'serial_2r'})
        assert values['robot_description'] == '' and robot_of(values).name == 'serial_2r'

    def test_the_name_of_a_shipped_robot_is_taken(self, tmp_path):
        shutil.copy(MACHINES / 'five_bar.xml', tmp_path / 'delta.xml')
        with pytest.raises(InputError, match='already a robot delta; rename the file'):
            resolve(str(tmp_path / 'delta.xml'))

    @pytest.mark.parametrize(
        ('change', 'text'),
        [
            ({'robot.actuated': ['left']}, 'left'),
            ({'robot.tool': 'tol'}, 'tool'),
            ({'robot.home': 'nowhere'}, 'nowhere'),
            ({'robot.held': ['left']}, 'left'),
            ({'robot.mass_factor': [1.0]}, 'a number or 4 numbers'),
            ({'robot.mass_factor': 'two'}, 'robot.mass_factor must be a number'),
            ({'robot.mass_factor': -1}, 'robot.mass_factor must be at least 0'),
            ({'robot.lower': 3.0}, 'robot.lower must be below robot.upper'),
        ],
    )
    def test_a_wrong_choice_is_one_line(self, change, text, own):
        with pytest.raises(InputError, match=text) as caught:
            configure(resolve(str(own), change))
        assert '\n' not in str(caught.value)


class TestClosedForms:
    """The two robots whose equations stand in the suite, once more as descriptions."""

    def test_the_paper_s_robot(self):
        paper = resolve('paper_circle', {'duration': 0.3})
        shared = ('circle', 'plant', 'friction', 'safety')
        same = {
            key: value
            for key, value in paper.items()
            if key.split('.')[0] in shared
            and key not in ('safety.min_sin_psi', 'safety.min_determinant')
        }
        same |= {'robot_model': 'planar_3rrr_described', 'duration': 0.3}
        closed, described = loop_of(paper), loop_of(resolve('paper_circle', same))
        assert np.abs(described.joints - closed.joints).max() < 1e-9
        assert np.abs(described.pose - closed.pose).max() < 1e-9

    def test_the_arm(self):
        arm = resolve('serial_2r_circle', {'duration': 0.3})
        shared = ('circle', 'plant', 'friction', 'safety', 'tdc')
        same = {
            key: value
            for key, value in arm.items()
            if key.split('.')[0] in shared and key not in OF_ARM
        }
        same |= {'robot_model': 'serial_2r_described', 'duration': 0.3}
        closed, described = loop_of(arm), loop_of(resolve('serial_2r_circle', same))
        assert np.abs(described.joints - closed.joints).max() < 1e-9


class TestRobot:
    def test_joints_and_pose_belong_together(self):
        robot = robot_of(resolve('five_bar_circle'))
        pose = np.array([0.01, 0.13])
        row = vector(pose)
        moved = robot.kernel('joint_motion', PoseMotion(row, row, row))(
            robot.constants, PoseMotion(row, vector(0.1 * pose), row)
        )
        found = robot.kernel('locate', row, row)(robot.constants, moved.position, row)
        assert found.fault == FOUND
        np.testing.assert_allclose(found.pose, pose, atol=1e-12)

    def test_a_single_factor_is_for_all_masses(self):
        five = {
            factor: robot_of(resolve('five_bar_circle', {'robot.mass_factor': factor}))
            for factor in (1.0, 2.0)
        }
        assert five[2.0].parameters.mass_factor == (2.0,) * 4
        light, heavy = (each.module.mechanism(each.parameters) for each in five.values())
        np.testing.assert_array_equal(heavy.mass, 2.0 * light.mass)
        np.testing.assert_allclose(heavy.inertia, 2.0 * light.inertia, rtol=1e-14)

    def test_whoever_has_its_constants_has_his_own_memory(self):
        robot = robot_of(resolve('five_bar_circle'))
        first, second = robot.constants, robot.constants
        row = vector(first.value.workspace.q + 0.1)
        robot.module.locate(first, row, row)
        assert (second.value.workspace.q != first.value.workspace.q).all()

    def test_its_picture_is_of_the_machine_of_the_parameters(self):
        shift = 0.002  # m, of the right motor
        values = resolve('five_bar_circle', {'robot.shift': [0.0] * 6 + [shift] + [0.0] * 11})
        robot, q = robot_of(values), np.array([1.8, 1.3])
        directions = np.stack([np.cos(q), np.sin(q)], axis=1)
        motors = np.array([[-0.059, 0.0], [0.059 + shift, 0.0]])
        elbows = motors + 0.09 * directions
        half = 0.5 * (elbows[1] - elbows[0])  # the tool is on both circles, above the elbows
        up = np.array([-half[1], half[0]]) / np.linalg.norm(half)
        tool = elbows[0] + half + np.sqrt(0.09**2 - half @ half) * up
        expected = [(motors[0], elbows[0]), (motors[1], elbows[1]), (elbows[0], tool)]
        (lines,) = robot.module.segments(robot.parameters, tool[None], q[None]).values()
        links = links_of(robot, ('left', 'right'))
        origins = space_origins(links, angles_of(robot, links, q, q))
        for ends in (*expected, (elbows[1], tool)):
            assert any(np.allclose(line, ends, atol=1e-12) for line in lines[0])
        for point in (*motors, *elbows):
            assert any(np.allclose(origin, [*point, 0.0], atol=1e-12) for origin in origins)

    def test_in_its_picture_legs_are_as_long_as_they_are(self):
        robot = robot_of(resolve('hexapod_circle'))
        q = np.array([0.2, -0.1, 0.15, 0.05, -0.2, 0.1])  # m, longer than at home
        (lines,) = robot.module.segments(robot.parameters, None, q[None]).values()
        turns = np.radians(np.add.outer([0.0, 120.0, 240.0], [-2.5, 2.5]).ravel())
        base = 3.0 * np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
        for foot, longer in zip(base, q, strict=True):
            ends = lines[0][np.abs(lines[0][:, 0] - foot).max(axis=1) < 1e-9]
            (leg,) = ends[np.ptp(ends, axis=1).max(axis=1) > 1e-9]
            length = 3.153800683985283 + longer
            assert np.linalg.norm(leg[1] - leg[0]) == pytest.approx(length, abs=1e-9)
        corners = lines[0][np.abs(lines[0][:, :, 2] - 2.0).max(axis=1) < 0.5]
        assert len(corners) >= 6  # of the platform, at which the legs end

    def test_in_its_picture_jaws_move_away_from_their_carriage(self, tmp_path):
        mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
        joints = [
            ('x', 'base', '1 0 0', '0'),
            ('a', 'x', '0 1 0', '.1'),
            ('b', 'x', '0 -1 0', '.1'),
        ]
        file = tmp_path / 'gripper.urdf'
        file.write_text(
            '<robot name="gripper"><link name="base"/>'
            + ''.join(
                f'<link name="{name}">{mass}</link><joint name="j{name}" type="prismatic">'
                f'<parent link="{parent}"/><child link="{name}"/><origin xyz="0 0 {z}"/>'
                f'<axis xyz="{axis}"/><limit lower="-1" upper="1" effort="9" velocity="1"/>'
                '</joint>'
                for name, parent, axis, z in joints
            )
            + '</robot>'
        )
        robot = robot_of(resolve(str(file)))
        found = drawn(robot.module.mechanism(robot.parameters), np.array([[0.3, 0.02, 0.05]]))[0]
        middle = [0.3, 0.0, 0.1]
        for ends in ([0.3, 0.0, 0.0], [0.3, 0.02, 0.1], [0.3, -0.05, 0.1]):
            expected = sorted([ends, middle])
            assert any(np.allclose(sorted(line.tolist()), expected, atol=1e-12) for line in found)

    def test_what_is_judged_ahead_leaves_no_trace(self):
        robot = robot_of(resolve('hexapod_circle'))
        asked, plain = robot.constants, robot.constants
        margins = robot.module.SafetyMargins(0.1, 0.1, 0.0)
        here = vector(plain.value.workspace.q)
        rate = vector(np.linspace(-0.2, 0.3, 6))
        for k in range(20):
            there = vector(here + 0.01 * k * rate)
            far = vector(there + 0.1 * rate)
            judged = robot.module.estimate_coarse(asked, margins, far, rate, here)
            found = [
                robot.module.estimate(box, margins, there, rate, here) for box in (asked, plain)
            ]
            np.testing.assert_array_equal(found[0].model.M, found[1].model.M)
            np.testing.assert_array_equal(found[0].pose, found[1].pose)
            exact = robot.module.estimate(robot.constants, margins, far, rate, here)
            assert judged.fault == exact.fault == FOUND
            np.testing.assert_allclose(judged.model.M, exact.model.M, rtol=1e-5, atol=1e-3)

    def test_joints_that_no_posture_has_are_a_fault_and_leave_the_memory(self):
        robot = robot_of(resolve('five_bar_circle'))
        box = robot.constants
        before = box.value.workspace.all.copy()
        row = vector(box.value.workspace.q + np.array([2.5, -2.5]))
        assert robot.module.locate(box, row, row).fault != FOUND
        assert (box.value.workspace.all == before).all()


class TestBag:
    def test_it_runs_again_where_there_is_no_file(self, own, tmp_path, capsys):
        bag = tmp_path / 'bag'
        words = ['--duration', '0.1', '--set', 'true_robot.mass_factor=1.1']
        assert main(['simulate', str(own), *words, '--out', str(bag)]) == 0
        own.unlink()
        assert main(['rerun', str(bag), '--out', str(tmp_path / 'again')]) == 0
        assert 'identical' in capsys.readouterr().out
        assert main(['analyze', str(bag)]) == 0
        assert 'end-effector error' in capsys.readouterr().out


class TestCommand:
    def test_it_says_what_was_read(self, capsys):
        assert main(['robot', 'five_bar']) == 0
        told = capsys.readouterr().out
        assert 'five_bar: 4 joints, 2 actuated, 2 passive; 2 freedoms' in told

    def test_its_numbers_are_those_of_the_equations(self, capsys):
        words = ['robot', 'five_bar', '--state', '1.8,1.3', '--rate', '0.3,-0.2', '--json']
        assert main(words) == 0
        found = json.loads(capsys.readouterr().out)
        M, Q = np.array(found['M']), np.array(found['Q'])
        assert np.abs(M - M.T).max() < 1e-15 and np.linalg.eigvalsh(M).min() > 0.0
        robot = robot_of(resolve('five_bar_circle'))
        row = vector(np.array([1.8, 1.3]))
        margins = robot.module.SafetyMargins(0.0, 0.0, 0.0)
        rate = vector(np.array([0.3, -0.2]))
        model = robot.module.estimate(robot.constants, margins, row, rate, row).model
        np.testing.assert_array_equal(M, model.M)
        np.testing.assert_array_equal(Q, model.Q)
        assert found['closure'] < 1e-12 and [*found['passive']]

    @pytest.mark.parametrize(
        ('words', 'text'),
        [
            (['dleta'], "unknown machine 'dleta'; did you mean 'delta'?"),
            (['nowhere.xml'], 'nowhere.xml'),
            (['five_bar', '--state', '1'], '--state must be 2 numbers'),
            (['five_bar', '--state', '1,x'], '--state must be numbers with commas'),
            (['five_bar', '--state', '0,9'], 'the loops cannot be closed'),
            (['five_bar', '--plot', 'x.gif'], '--plot must end with'),
        ],
    )
    def test_a_mistake_is_one_line(self, words, text, capsys):
        assert main(['robot', *words]) == 2
        told = capsys.readouterr().err
        assert text in told and told.count('\n') == 1


class TestProposedMotion:
    """Of machines whose home is near an end of travel, as of many a slide, or beyond it."""

    @pytest.fixture
    def slide(self, tmp_path):
        def write(lower, upper):
            file = tmp_path / 'slide.urdf'
            file.write_text(f"""<robot name="slide"><link name="base"/><link name="jaw"><inertial>
              <mass value="0.2"/>
              <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
              </inertial></link><joint name="open" type="prismatic"><parent link="base"/>
              <child link="jaw"/><axis xyz="0 0 -1"/>
              <limit lower="{lower}" upper="{upper}" effort="20" velocity="1"/></joint></robot>""")
            return resolve(str(file))

        return write

    @pytest.mark.parametrize(
        ('lower', 'upper', 'share'),
        [(0, 0.03, -0.8), (-0.03, 0, 0.8), (-0.02, 0.03, -0.8), (-9, 9, None)],
    )
    def test_it_goes_where_the_travel_has_room(self, lower, upper, share, slide):
        values = slide(lower, upper)
        room = 0.03
        ((start,), (end,)) = values['move.start'], values['move.end']
        assert start == 0.0
        if share is None:
            assert end > room
        else:  # the tool goes down where the joint opens
            np.testing.assert_allclose(end, share * room, rtol=1e-12)
        run = loop_of({**values, 'duration': 1.0})
        assert np.isfinite(run.position).all()

    @pytest.mark.parametrize(('lower', 'upper', 'end'), [(0.01, 0.03, 1.0), (-0.03, 0.0, -0.02)])
    def test_a_home_without_room_is_named(self, lower, upper, end, slide):
        values = {**slide(lower, upper), 'move.end': [end]}
        with pytest.raises(InputError) as caught:
            loop_of({**values, 'duration': 1.0})
        told = str(caught.value)
        travel = f'at home open is at 0, its travel from {lower:g} to {upper:g}: choose robot.home'
        assert 'end of travel' in told and travel in told

    def test_a_home_with_room_is_not(self, slide):
        values = {**slide(0.0, 0.03), 'move.end': [-1.0], 'move.duration': 1.0}
        with pytest.raises(InputError) as caught:
            loop_of({**values, 'duration': 1.0})
        assert 'end of travel' in str(caught.value) and 'home' not in str(caught.value)
