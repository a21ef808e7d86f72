"""Robots that move in space, in pictures and pages: against SciPy, MuJoCo and the numbers."""

import json
import math
import shutil
import subprocess
from pathlib import Path

import mujoco
import numpy as np
import pytest
from reading import Evaluated
from scipy.spatial.transform import Rotation

from parallel_robot.analysis import metrics, video
from parallel_robot.analysis.metrics import METRICS
from parallel_robot.analysis.monitor import posture_of
from parallel_robot.analysis.readable_metrics import defined
from parallel_robot.analysis.report import figures, looks
from parallel_robot.analysis.report.charts import charts
from parallel_robot.analysis.report.page import ball, postures
from parallel_robot.analysis.report.planned import figure_of_motion
from parallel_robot.analysis.report.runs import Run
from parallel_robot.analysis.thinned import Track
from parallel_robot.analysis.timing import Timing
from parallel_robot.live.frames import HEADER, Camera
from parallel_robot.live.frames import Motion as States
from parallel_robot_control.configuration import nominal_of, resolve
from parallel_robot_model.mechanisms.description.machine import machine, read
from parallel_robot_model.mechanisms.joint_kinds import HINGE, SLIDE
from parallel_robot_model.robots.contract import Coordinate, angles_between, rotation_components_of
from parallel_robot_model.robots.link import frames
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.motions import Motion, Poses
from parallel_robot_sim.run_columns import of_poses

SOURCE = Path(looks.__file__).parent / 'templates' / 'robot.js'
MACHINES = Path(__file__).parents[1] / 'config' / 'machines'
COORDINATES = tuple(Coordinate(name, '') for name in ('x', 'y', 'z', 'rx', 'ry', 'rz'))
GENERATOR = np.random.default_rng(5)
LOOSE = '<mujoco><compiler boundmass="1e-9" boundinertia="1e-12" fusestatic="false"/></mujoco>'


def robot(name):
    """A shipped machine and its configuration."""
    values = resolve(f'{name}_circle')
    return robot_of(values), values


def joints_near_home(model, count=4, size=0.03):
    mechanism = model.module.machine(model.parameters).mechanism
    home = mechanism.home[mechanism.actuated]
    return home + GENERATOR.uniform(-size, size, (count, len(home)))


def turned_by(poses, axis, angle):
    """The same poses, each turned about an axis of the world."""
    turn = Rotation.from_rotvec(angle * np.asarray(axis))
    found = poses.copy()
    found[:, 3:] = (turn * Rotation.from_rotvec(poses[:, 3:])).as_rotvec()
    return found


@pytest.fixture(scope='module')
def hexapod():
    return robot('hexapod')


@pytest.fixture(scope='module')
def moved(hexapod):
    """A motion of the hexapod 3 µm and 2 mrad beside its reference."""
    model, _ = hexapod
    time = 1e-2 * np.arange(101)
    reference = np.zeros((101, 6))
    reference[:, :3] = [0.0, 0.0, 2.0]
    reference[:, 0] += 0.1 * time
    reference[:, 3:] = [0.02, -0.05, 0.1]
    actual = turned_by(reference, [0.0, 0.6, 0.8], 2e-3)
    actual[:, 2] += 3e-6
    mechanism = model.module.machine(model.parameters).mechanism
    joints = mechanism.home[mechanism.actuated] + 0.02 * time[:, np.newaxis]
    effort = np.stack([np.sin(k + time) for k in range(6)], axis=1)
    return Motion(
        time,
        joints,
        joints + 1e-5,
        effort,
        Poses(actual, reference, 3, rotation_components=(0, 1, 2)),
    )


def a_run(values, moved):
    """A run of a report as far as figures need it."""
    log = type('Log', (), {})()
    log.scenario, log.law, log.config, log.values = 'hexapod_circle', 's_smc', values, values
    log.joints = tuple(values['joints'])
    timing = Timing(*[None] * len(Timing._fields))
    found = metrics.evaluate(moved)
    track = Track(moved.time, moved.poses)
    at = lambda times: moved.rows(np.searchsorted(moved.time, times).clip(max=len(moved.time) - 1))  # noqa: E731
    whole = (moved, track, at, len(moved.time), found)
    return Run(Path('bag'), 'S-SMC', 'run0', log, *whole, None, timing, '', [], False)


def test_the_angle_of_a_known_rotation():
    poses = np.hstack([np.zeros((50, 3)), GENERATOR.normal(size=(50, 3))])
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    for angle in (1e-9, 1e-3, 1.0, 3.0):
        found = angles_between(turned_by(poses, axis, angle), poses, (0, 1, 2))
        np.testing.assert_allclose(found, angle, rtol=1e-6, atol=1e-15)
    one = np.array([[0.0, 0.0, 0.0, 0.25]])
    assert angles_between(one, 0.0 * one, (1,)) == pytest.approx([0.25])
    assert (
        rotation_components_of(COORDINATES) == (0, 1, 2)
        and rotation_components_of(COORDINATES[:3]) == ()
    )
    assert rotation_components_of((*COORDINATES[:3], COORDINATES[5])) == (2,)
    assert (
        rotation_components_of(COORDINATES[3:])
        == ()
        == rotation_components_of([*COORDINATES[:2], Coordinate('phi', '')])
    )
    assert np.isnan(angles_between(poses, poses, ())).all()


def test_metrics_and_columns_tell_distance_and_angle(moved):
    found = metrics.evaluate(moved)
    assert found['xy_rms_m'] == pytest.approx(3e-6)
    assert found['rotation_rms_rad'] == pytest.approx(2e-3)
    names = {one.name: one.printed(found) for one in defined(METRICS, found)}
    assert names['end-effector rotation error, rms'] == pytest.approx(2e3)  # µrad
    assert found['rotation_max_rad'] == pytest.approx(2e-3)
    columns = of_poses(COORDINATES, 3, moved.poses.actual, moved.poses.reference)
    np.testing.assert_allclose(columns['platform_rotation_error_rad'], 2e-3)
    np.testing.assert_allclose(columns['platform_error_m'], 3e-6)


def test_in_a_plane_the_angle_is_that_of_phi(moved):
    count, phi = len(moved.time), np.linspace(0.0, 1e-3, len(moved.time))
    here = np.column_stack([np.zeros((count, 2)), math.pi - phi])
    there = np.column_stack([np.zeros((count, 2)), -math.pi + 2.0 * phi])  # half a turn is no jump
    found = metrics.evaluate(moved._replace(poses=Poses(here, there)), all_of_it=True)
    assert found['rotation_max_rad'] == pytest.approx(3e-3)
    assert found['rotation_rms_rad'] == pytest.approx(3e-3 / math.sqrt(3.0), rel=1e-2)
    point = Poses(here[:, :2], there[:, :2])
    assert math.isnan(metrics.evaluate(moved._replace(poses=point))['rotation_rms_rad'])


def lines_and_tool(name):
    """Ends of the lines of a machine in some postures, shape (K, lines, 2, 3 or 2); its tool."""
    model, values = robot(name)
    joints = joints_near_home(model)
    pose = poses_of(model, joints, nominal_of(values)[1])
    (ends,) = model.module.segments(model.parameters, pose, joints).values()
    assert ends.shape[0] == len(joints) and ends.shape[2:] == (2, model.place)
    (one,) = model.module.segments(model.parameters, pose[0], joints[0]).values()
    np.testing.assert_allclose(one, ends[0], atol=1e-9)
    return ends, pose[:, np.newaxis, : model.place]


@pytest.mark.parametrize('name', ['arm6', 'five_bar'])
def test_lines_of_a_machine_end_at_its_tool(name):
    ends, tool = lines_and_tool(name)
    apart = np.linalg.norm(ends[:, :, 1] - tool, axis=-1)
    np.testing.assert_allclose(apart.min(axis=1), 0.0, atol=1e-9)


@pytest.mark.parametrize('name', ['delta', 'hexapod'])
def test_lines_go_round_a_platform_whose_middle_is_the_tool(name):
    """Each of its six edges begins where another one ends."""
    ends, tool = lines_and_tool(name)
    for row, here in zip(ends.reshape(len(ends), -1, 3), tool, strict=True):
        nearest = row[np.argsort(np.linalg.norm(row - here, axis=1))[:18]]
        points, count = np.unique(nearest.round(9), axis=0, return_counts=True)
        corners = points[count >= 2]
        assert len(corners) == 6
        np.testing.assert_allclose(corners.mean(axis=0), here[0], atol=1e-8)


def test_a_posture_that_does_not_close_has_no_lines():
    model, _ = robot('delta')
    joints = joints_near_home(model, 2)
    joints[1] = 50.0
    (ends,) = model.module.segments(model.parameters, joints, joints).values()
    assert np.isfinite(ends[0]).all() and np.isnan(ends[1]).all()


def test_a_picture_of_a_run_has_three_views_and_an_angle(hexapod, moved):
    _, values = hexapod
    run = a_run(values, moved)
    *views, distance, angle, joints, torque = figures.figure_of_run(run.log, moved).axes
    assert [axes.get_xlabel()[0] + axes.get_ylabel()[0] for axes in views] == ['xy', 'xz', 'yz']
    for axes, (_, _, shown) in zip(views, looks.VIEWS, strict=True):
        lines = {line.get_label(): line for line in axes.lines}
        path = 1e3 * moved.poses.actual[:, shown]
        np.testing.assert_array_equal(lines['end effector'].get_xydata(), path)
        np.testing.assert_array_equal(lines['start'].get_xydata(), path[:1])
        assert len(axes.lines) == 12 + 3  # the robot, paths and start
    np.testing.assert_allclose(distance.lines[0].get_ydata(), 3.0)
    np.testing.assert_allclose(angle.lines[0].get_ydata(), 2.0)
    assert 'mrad' in angle.get_ylabel() and len(joints.lines) == len(torque.lines) == 6
    both = figures.figure_of_runs({'a': (run.log, moved), 'b': (run.log, moved)}).axes
    assert len(both) == 7 and len(both[0].lines) == 12 + 5
    np.testing.assert_allclose(both[4].lines[1].get_ydata(), 2.0)


def test_a_planned_motion_is_drawn_with_the_machine():
    made = configure(resolve('delta_circle'))
    *views, position, _, _ = figure_of_motion(made).axes
    lines = {line.get_label(): line for line in views[1].lines}
    x, z = lines['path'].get_xydata().T
    assert z == pytest.approx(-1100.0) and np.ptp(x) == pytest.approx(300.0, rel=1e-3)
    assert len(views[1].lines) == 4 * 21 + 2 and len(position.lines) == 3


def test_a_report_has_views_distance_and_angle(hexapod, moved):
    run = a_run(hexapod[1], moved)
    drawn = {chart.name: chart for chart in charts([run])}
    assert list(drawn) == [
        *('path', 'place_error', 'rotation_error', 'joint_errors', 'coupling_errors', 'torques')
    ]
    assert [panel.x_label for panel in drawn['path'].panels] == ['x [mm]', 'x [mm]', 'y [mm]']
    side = next(c for c in drawn['path'].panels[2].curves if c.label == 'S-SMC')
    np.testing.assert_allclose(side.y, 2000.003)
    np.testing.assert_allclose(drawn['place_error'].panels[0].curves[0].y, 3e-3)
    np.testing.assert_allclose(drawn['rotation_error'].panels[0].curves[0].y, 2.0)
    assert not drawn['rotation_error'].of_paper and drawn['path'].of_paper


def test_the_page_gets_lines_in_space(hexapod, moved):
    model, values = hexapod
    found = postures([a_run(values, moved)])
    assert found.place == 3 and found.parts == [('link', 12)]
    (numbers,) = found.frames
    assert numbers.shape == (51, 6 + 12 * 6)
    np.testing.assert_array_equal(numbers[-1, :3], moved.poses.reference[-1, :3])
    rows = np.searchsorted(moved.time, found.time)
    (ends,) = model.module.segments(model.parameters, None, moved.position[rows]).values()
    np.testing.assert_allclose(numbers[:, 6:].reshape(ends.shape), ends, atol=1e-9)
    assert ball(np.array([[0.0, 0, 0], [2.0, 0, 0], [np.nan] * 3]), 0.5) == [1.0, 0.0, 0.0, 1.5]


def test_a_video_sees_space_from_one_place(hexapod, moved):
    run = a_run(hexapod[1], moved)
    assert video.magnification([run]) == 2000.0  # 3 µm times this are 8 % of 0.1 m, or less
    found = video.scene(run, np.array([0.0, 1.0]), 2000.0)
    np.testing.assert_allclose(
        found.path - found.reference,
        2000.0 * (found.actual - found.reference),
        atol=1e-9,
    )
    up = 3e-6 * math.cos(looks.TILT)
    np.testing.assert_allclose(found.actual - found.reference, [[0.0, up]] * 101, atol=1e-12)
    assert found.parts['link'].shape == (2, 12, 2, 2) and found.error[0] == pytest.approx(3e-6)


def test_a_frame_of_the_live_page_is_in_space():
    model, values = robot('delta')
    guess = nominal_of(values)[1]
    camera = Camera(model, guess, values['joints'])
    joints = joints_near_home(model, 30)[:1] + np.linspace(0.0, 0.01, 30)[:, np.newaxis]
    time, nothing = 1e-3 * np.arange(30), np.full((30, 3), np.nan)
    data = camera.frame(States(time, joints, joints + 1e-3, nothing, nothing), 0.03)
    *_, count = HEADER.unpack_from(data)
    numbers = np.frombuffer(data, '<f4', offset=HEADER.size)
    pose, desired = (poses_of(model, each, guess) for each in (joints, joints + 1e-3))
    assert camera.place == 3 and camera.parts == [('link', 21)]
    assert len(numbers) == 6 + 21 * 6 + 6 * count + 2 * len(camera.curves)
    np.testing.assert_allclose(numbers[:6], [*desired[-1], *pose[-1]], atol=1e-6)
    (ends,) = model.module.segments(model.parameters, pose[-1], joints[-1]).values()
    np.testing.assert_allclose(numbers[6:132].reshape(21, 2, 3), ends, atol=1e-6)
    error = numbers[132 + 6 * count :][:2]
    apart = np.linalg.norm(pose - desired, axis=1)
    np.testing.assert_allclose(np.sort(error), [apart.min(), apart.max()], rtol=1e-5)


def test_the_page_projects_as_the_video(tmp_path):
    if not (node := shutil.which('node')):
        pytest.skip('node is not installed')
    places = GENERATOR.normal(size=(5, 3)).round(6)
    script = tmp_path / 'eye.js'
    script.write_text(
        SOURCE.read_text(encoding='utf-8')
        + f"""
        const eye = new Eye(3), places = {places.tolist()};
        const found = [places.map((p) => eye.flat(p))];
        for (const [turn, tilt] of [[0, Math.PI / 2], [0, 0], [Math.PI / 2, 0]]) {{
          Object.assign(eye, {{ turn, tilt }});
          found.push(places.map((p) => eye.flat(p)));
        }}
        console.log(JSON.stringify(found));
        """,
        encoding='utf-8',
    )
    told = subprocess.run([node, str(script)], capture_output=True, text=True, check=True).stdout
    oblique, *views = np.array(json.loads(told))
    np.testing.assert_allclose(oblique, looks.oblique(places), atol=1e-12)
    for found, (_, _, shown) in zip(views, looks.VIEWS, strict=True):
        np.testing.assert_allclose(found, places[:, shown], atol=1e-12)


def in_mujoco(posture):
    """The model that MuJoCo makes of a description; links without mass get next to none."""
    text = posture.description.replace('</robot>', f'{LOOSE}</robot>')
    return mujoco.MjModel.from_xml_string(text)


@pytest.mark.parametrize('name', ['delta', 'hexapod', 'arm6', 'five_bar'])
def test_the_urdf_of_a_machine_closes_its_loops(name):
    model, values = robot(name)
    posture, joints = posture_of(values), joints_near_home(model, 2)
    described = in_mujoco(posture)
    data = mujoco.MjData(described)
    for k, row in enumerate(joints):
        found = posture.add_state(20_000_000 * k, row)
        for joint, value in zip(posture.joints, found[posture.moving], strict=True):
            data.joint(joint).qpos[0] = value
        mujoco.mj_forward(described, data)
        (ends,) = model.module.segments(model.parameters, None, row[np.newaxis]).values()
        lines = [
            data.body(link.name).xpos + np.array(line) @ data.body(link.name).xmat.reshape(3, 3).T
            for link in posture.links
            for line in link.lines
        ]
        assert len(lines) == ends.shape[1]
        legs = 0
        for line in np.array(lines)[..., : model.place]:
            begins, is_it = (np.abs(ends[0] - line).max(axis=axes) < 1e-9 for axes in (2, (1, 2)))
            if is_it.any():
                continue
            legs += 1  # there it is as long as at home, in pictures it ends at the slide
            (leg,) = (ends[0, k] for k in np.flatnonzero(begins[:, 0]) if ends[0, k, 0, 2] == 0.0)
            assert np.abs(np.cross(leg[1] - leg[0], line[1] - line[0])).max() < 1e-9
            assert any(np.abs(data.body(x.name).xpos - leg[1]).max() < 1e-9 for x in posture.links)
        assert legs == (6 if name == 'hexapod' else 0)
        origins, turns = frames(posture.links, found)  # what is sent as frames
        for link, origin, turn in zip(posture.links, origins, turns, strict=True):
            there, parent = data.body(link.name), described.body(link.name).parentid[0]
            before = data.xmat[parent].reshape(3, 3)
            np.testing.assert_allclose(data.xpos[parent] + before @ origin, there.xpos, atol=1e-9)
            rotation = before @ Rotation.from_quat(turn).as_matrix()
            np.testing.assert_allclose(rotation, there.xmat.reshape(3, 3), atol=1e-9)
    masses = model.module.mechanism(model.parameters).mass
    assert described.body_mass.sum() == pytest.approx(masses.sum(), abs=1e-6)


def test_the_urdf_of_the_arm_has_the_inertia_of_its_file():
    _, values = robot('arm6')
    described = in_mujoco(posture_of(values))
    of_file = mujoco.MjModel.from_xml_path(str(MACHINES / 'arm6.xml'))
    of_file.dof_armature[:] = 0.0
    for _ in range(5):
        q = GENERATOR.uniform(-1.0, 1.0, 6)
        found = []
        for each in (described, of_file):
            data, matrix = mujoco.MjData(each), np.empty((6, 6))
            data.qpos[:] = q
            mujoco.mj_forward(each, data)
            mujoco.mj_fullM(each, data, matrix)
            found.append(matrix)
        np.testing.assert_allclose(*found, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize('name', ['delta', 'hexapod', 'arm6', 'five_bar'])
def test_the_urdf_of_a_machine_read_back_is_that_machine(name):
    """With what it cannot say: home and tool."""
    model, values = robot(name)
    posture = posture_of(values)
    unsaid = dict(line.split(': ', 1) for line in posture.beside.unsaid)
    assert {*unsaid} <= {'robot.home', 'robot.tool'}
    assert all(line in posture.description for line in posture.beside.unsaid)
    chosen = {'home': unsaid.get('robot.home', ''), 'tool': unsaid['robot.tool']}
    back = machine(read(posture.description), **chosen)
    made = model.module.machine(model.parameters)
    assert not any('left out' in line for line in back.warnings)
    assert {*back.actuated} == {*made.actuated} and len(back.passive) == len(made.passive)
    order = [back.actuated.index(joint) for joint in made.actuated]
    for key in ('lower', 'upper', 'effort', 'velocity', 'viscous', 'coulomb'):
        found = np.clip(np.array(getattr(back, key))[order], -1e6, 1e6)
        expected = np.clip(getattr(made, key), -1e6, 1e6)
        np.testing.assert_allclose(found, expected, rtol=1e-11, err_msg=key)
    home = made.mechanism.home[made.mechanism.actuated]
    for q in (home, home + 0.02):
        there = Evaluated(made, q, np.ones(len(q)))
        here = Evaluated(back, q[np.argsort(order)], np.ones(len(q)))
        np.testing.assert_allclose(here.M[np.ix_(order, order)], there.M, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(here.force[order], there.force, rtol=1e-6, atol=1e-7)


def test_lengths_of_legs_are_no_angles(hexapod):
    model, values = hexapod
    posture = posture_of(values)
    kinds = {link.joint: link.kind for link in posture.links}
    legs = list(values['joints'])
    assert {kinds[name] for name in legs} == {SLIDE} and HINGE in kinds.values()
    joints = joints_near_home(model, 1)[0]
    found = dict(zip(posture.joints, posture.add_state(0, joints)[posture.moving], strict=True))
    assert [found[name] for name in legs] == pytest.approx(joints, abs=1e-15)
    travel = {link.joint: link.travel for link in posture.links}
    assert travel[legs[0]] == (model.parameters.lower[0], model.parameters.upper[0])


def test_a_posture_that_does_not_close_has_no_frames():
    model, values = robot('delta')
    posture, good = posture_of(values), joints_near_home(model, 1)[0]
    assert posture.add_state(0, good + 50.0) is None
    assert np.isfinite(posture.add_state(20_000_000, good)).all()
