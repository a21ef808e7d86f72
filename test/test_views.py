"""What other tools draw of the robot: URDF in MuJoCo, frames and layouts beside a decoded bag."""

import json
import re
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import yaml
from bags import STORE
from geometry import PAPER_START, legs
from rosbags.rosbag2 import Reader

from parallel_robot.analysis.monitor import posture_of
from parallel_robot.cli.command_line import main
from parallel_robot_model.configuration import config
from parallel_robot_model.mechanisms.description.machine import machine, read
from parallel_robot_model.robots.registry import robot_of

VIEWS = Path(__file__).parents[1] / 'config' / 'views'
GENERATOR = np.random.default_rng(2)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Decoded messages of an exported run with their log times, by topic."""
    folder = tmp_path_factory.mktemp('views')
    run, out = folder / 'run', folder / 'views'
    assert main(['simulate', 'paper_circle', '--duration', '0.5', '--out', str(run)]) == 0
    assert main(['export', str(run), '--foxglove', str(out)]) == 0
    found = {}
    with Reader(out) as reader:
        for connection, log_time, data in reader.messages():
            message = STORE.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((log_time, message))
        latched = {c.topic for c in reader.connections if 'transient_local' in str(c.ext).lower()}
    assert '/robot_description' in latched
    return found


def described(scenario, capsys):
    """The model that MuJoCo makes of a robot's description."""
    capsys.readouterr()
    assert main(['urdf', scenario]) == 0
    return mujoco.MjModel.from_xml_string(capsys.readouterr().out)


def put(model, names, angles):
    """MuJoCo's data with the joints at angles, by name."""
    data = mujoco.MjData(model)
    for name, angle in zip(names, angles, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    return data


def ends(data, posture):
    """Both ends of all lines of the links in the plane, shape (lines, 2, 2)."""
    found = []
    for link in posture.links:
        body = data.body(link.name)
        for line in link.lines:
            points = [body.xpos + body.xmat.reshape(3, 3) @ [*point, 0.0] for point in line]
            found.append(np.array(points)[:, :2])
    return np.array(found)


def test_the_described_robot_is_where_the_kinematics_have_it(robot, values, capsys):
    model = described('paper_circle', capsys)
    posture = posture_of(values)
    period = 20_000_000  # ns
    for k in range(30):
        pose = PAPER_START + GENERATOR.uniform(-0.03, 0.03, 3)
        theta, _ = legs(robot, pose)
        angles = posture_of(values).add_state(k * period, theta)
        data = put(model, posture.joints, angles)
        found = ends(data, posture)
        corners = np.array([*pose[:2]]) + robot.l3 * np.array(
            [[np.cos(a), np.sin(a)] for a in pose[2] + np.array(robot.platform_angle)]
        )
        assert np.allclose(found[3:6, 1], corners, atol=1e-9)  # the tips of the legs
        assert np.allclose(found[6:, 0], corners, atol=1e-9)  # the loop is closed
        assert np.allclose(data.body('platform').xipos[:2], pose[:2], atol=1e-9)
    total = 3 * robot.m1 + 3 * robot.m2 + robot.mp
    assert model.body_mass.sum() == pytest.approx(total)
    assert sorted(model.body_inertia[1:, 2]) == pytest.approx(
        sorted([*[robot.I1] * 3, *[robot.I2] * 3, robot.Ip])
    )


def test_read_back_its_legs_are_closed(robot, values):
    posture = posture_of(values)
    theta, _ = legs(robot, PAPER_START)
    angles = posture.add_state(0, theta).tolist()
    home = dict(zip(posture.joints, angles, strict=True))
    back = machine(read(posture.description), home=home)
    assert list(back.actuated) == values['joints'] and len(back.passive) == 4
    assert back.home_moved < 1e-9


def test_the_described_arm_has_the_inertia_of_the_model(capsys):
    values = config.resolve('serial_2r_circle')
    arm, posture = robot_of(values), posture_of(values)
    model = described('serial_2r_circle', capsys)
    for _ in range(10):
        q = GENERATOR.uniform(-2.0, 2.0, 2)
        data = put(model, posture.joints, q)
        matrix = np.empty((2, 2))
        mujoco.mj_fullM(model, data, matrix)
        p = arm.parameters
        a = p.I1 + p.m1 * p.lc1**2 + (p.m2 + p.mp) * p.l1**2
        b = p.I2 + p.m2 * p.lc2**2 + p.mp * p.l2**2
        h = p.l1 * (p.m2 * p.lc2 + p.mp * p.l2) * np.cos(q[1])
        assert np.allclose(matrix, [[a + b + 2 * h, b + h], [b + h, b]])


def test_a_robot_without_links_has_no_description(tmp_path, capsys):
    assert main(['urdf', 'axes_step', '--out', str(tmp_path / 'axes.urdf')]) == 2
    assert 'axes says nothing of its links' in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_a_description_goes_into_a_new_file_alone(tmp_path, capsys):
    out = tmp_path / 'robot.urdf'
    assert main(['urdf', 'paper_circle', '--set', 'robot.l1=0.5', '--out', str(out)]) == 0
    assert 'box size="0.5 ' in out.read_text()
    assert main(['urdf', 'paper_circle', '--out', str(out)]) == 2
    assert 'exists; nothing is overwritten' in capsys.readouterr().err


def test_the_frames_of_a_bag_close_the_chain(bag, values):
    names = [link.name for link in posture_of(values).links]
    assert len(bag['/tf']) == 26  # fifty a second, the first state too
    states = {(m.header.stamp.sec, m.header.stamp.nanosec): m for _, m in bag['/joint_states']}
    poses = {(m.header.stamp.sec, m.header.stamp.nanosec): m.pose for _, m in bag['/pose']}
    for _, message in bag['/tf']:
        assert [t.child_frame_id for t in message.transforms] == names
        stamp = message.transforms[0].header.stamp
        key = stamp.sec, stamp.nanosec
        angle = {t.child_frame_id: 2 * np.arctan2(t.transform.rotation.z, t.transform.rotation.w)
                 for t in message.transforms}  # fmt: skip
        links = [angle[f'{part}{k}'] for part in ('proximal', 'distal') for k in (1, 2, 3)]
        known = states[key].position  # with the passive joints of the plant
        assert np.allclose(np.exp(1j * np.array(links)), np.exp(1j * known), atol=1e-9)
        phi = angle['proximal1'] + angle['distal1'] + angle['platform']
        turn = poses[key].orientation
        assert np.exp(1j * phi) == pytest.approx(np.exp(2j * np.arctan2(turn.z, turn.w)), abs=1e-6)
    times = [log_time for log_time, _ in bag['/tf']]
    assert all(0 < b - a <= 20_000_000 for a, b in pairwise(times))
    ((_, paths),) = bag['/markers']
    assert [marker.ns for marker in paths.markers] == ['reference', 'end effector']


def test_a_full_copy_is_left_by_none_or_whole(tmp_path, capsys):
    assert main(['export', str(tmp_path), '--foxglove', str(tmp_path / 'out')]) == 2
    assert capsys.readouterr().err.count('\n') == 1
    run = tmp_path / 'axes'
    assert main(['simulate', 'axes_step', '--duration', '0.2', '--out', str(run)]) == 0
    assert main(['export', str(run), '--foxglove', str(tmp_path / 'out')]) == 2
    assert not (tmp_path / 'out').exists()


def value_at(message, path):
    """Follow a path, as ``points[0].positions[2]``, into a decoded message."""
    for name, index in re.findall(r'\.?([A-Za-z_]\w*)|\[(\d+)\]', path):
        message = getattr(message, name) if name else message[int(index)]
    return message


def test_foxglove_finds_what_its_layout_names(bag):
    layout = json.loads((VIEWS / 'foxglove.json').read_text())
    panels = layout['configById']
    paths = [path['value'] for one in panels.values() for path in one.get('paths', ())]
    paths += [one['topicPath'] for one in panels.values() if 'topicPath' in one]
    assert len(paths) == 16
    for path in paths:
        topic, _, field = path.partition('.')
        value_at(bag[topic][0][1], field)
    scene = panels['3D!robot']
    assert bag[scene['layers']['robot']['topic']] and set(scene['topics']) <= bag.keys()
    assert bag[panels['DiagnosticStatusPanel!status']['topicToRender']]
    frames = {t.header.frame_id for _, message in bag['/tf'] for t in message.transforms}
    assert scene['followTf'] in frames

    def named(node):
        if isinstance(node, str):
            return [node]
        return [*named(node['first']), *named(node['second'])]

    assert sorted(named(layout['layout'])) == sorted(panels)


def test_plotjuggler_finds_what_its_layout_names(bag):
    tree = ElementTree.parse(VIEWS / 'plotjuggler.xml')
    curves = [curve.get('name') for curve in tree.iter('curve')]
    assert len(curves) == 12
    for name in curves:
        topic = next(topic for topic in bag if name.startswith(f'{topic}/'))
        message, field = bag[topic][0][1], name.removeprefix(f'{topic}/')
        joint, _, part = field.rpartition('/')
        if joint:  # as PlotJuggler names the numbers of a JointState
            assert len(getattr(message, part)) == len(message.name) and joint in message.name
        else:
            value_at(message, field)


def test_rviz_finds_what_its_layout_names(bag):
    layout = yaml.safe_load((VIEWS / 'robot.rviz').read_text())['Visualization Manager']
    for display in layout['Displays']:
        for key in ('Topic', 'Description Topic'):
            if key in display:
                assert bag[display[key]['Value']], display['Name']
    assert layout['Global Options']['Fixed Frame'] == 'base'
