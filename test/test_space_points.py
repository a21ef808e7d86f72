"""Points of machines in space: rotation vectors and quaternions from tables."""

import numpy as np
import pytest
from scipy import constants
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import points
from parallel_robot_model.robots.registry import resolve, robot_of
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.joint_path import as_poses, continuous

SI = {  # sizes of units in s, m and rad
    'time': {
        's': 1.0,
        'ms': constants.milli,
        'us': constants.micro,
        'ns': constants.nano,
        'min': constants.minute,
    },
    'length': {
        'm': 1.0,
        'cm': constants.centi,
        'mm': constants.milli,
        'um': constants.micron,
        'in': constants.inch,
    },
    'angle': {
        'rad': 1.0,
        'mrad': constants.milli,
        'deg': constants.degree,
        'turn': 360 * constants.degree,
    },
}
KINDS = 'time', 'length', 'length', 'angle'  # of the columns t, x, y, phi


def table(tmp_path, header, rows, **options):
    path = tmp_path / 'points.csv'
    path.write_text('\n'.join([header, *(', '.join(map(str, row)) for row in rows)]))
    return points.read_table(path, **options)


def test_a_table_of_poses_in_space_in_millimetres_and_degrees(tmp_path):
    rows = [(0, 100, 200, 300, 0, 90, 180), (1, 101, 200, 300, 0, 90, 180)]
    found = table(tmp_path, 't, x, y, z, rx, ry, rz', rows, units=['mm', 'deg'])
    assert found.names == ('x', 'y', 'z', 'rx', 'ry', 'rz')
    np.testing.assert_allclose(found.points[0], [0.1, 0.2, 0.3, 0.0, np.pi / 2, np.pi])


def test_each_unit_is_of_its_size_and_of_its_columns_alone(tmp_path):
    assert {kind: {*sizes} for kind, sizes in points.KINDS.items()} == {
        kind: {*sizes} for kind, sizes in SI.items()
    }
    for kind, sizes in SI.items():
        for unit, size in sizes.items():
            found = table(tmp_path, 't, x, y, phi', [(0,) * 4, (1,) * 4], units=[unit])
            numbers = [found.times[1], *found.points[1]]
            expected = [size if kind == of else 1.0 for of in KINDS]
            assert numbers == pytest.approx(expected, rel=1e-12), unit


def test_quaternions_have_no_unit_and_must_be_rotations(tmp_path):
    header = 't, x, y, z, qx, qy, qz, qw'
    rows = [(0, 1, 2, 3, 0, 0, 0, 1), (1, 1, 2, 3, 0, 0, 0.6, 0.8)]
    found = table(tmp_path, header, rows, units=['mm', 'deg'])
    np.testing.assert_allclose(found.points[1], [1e-3, 2e-3, 3e-3, 0, 0, 0.6, 0.8])
    with pytest.raises(InputError, match='the quaternion at t = 1 must have length 1'):
        table(tmp_path, header, [rows[0], (1, 1, 2, 3, 0, 0, 0.3, 0.4)])


@pytest.mark.parametrize('header', ['t, x, y, z', 't, x, z', 't, x, y, z, rz', 't, z'])
def test_some_coordinates_in_space(tmp_path, header):
    names = tuple(header.split(', ')[1:])
    count = len(names) + 1
    assert table(tmp_path, header, [range(count), range(1, count + 1)]).names == names


@pytest.mark.parametrize('header', ['t, z, x', 't, x, y, z, qx, qy', 't, x, y, phi, z', 't, qx'])
def test_other_columns_are_refused_in_one_line(tmp_path, header):
    count = len(header.split(','))
    with pytest.raises(InputError, match='the header must be t, x, y, phi; t, x, y; t, x, y, z'):
        table(tmp_path, header, [range(count), range(1, count + 1)])


def test_rotation_vectors_go_on_without_a_jump():
    angles = np.linspace(0.0, 4.0 * np.pi, 41)
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    turned = Rotation.from_rotvec(angles[:, np.newaxis] * axis)
    jumping = turned.as_rotvec()
    assert np.abs(np.diff(jumping, axis=0)).max() > 3.0
    np.testing.assert_allclose(continuous(jumping), angles[:, np.newaxis] * axis, atol=1e-9)


def test_quaternions_are_rotations_from_the_home_of_the_tool():
    robot = robot_of(resolve('hexapod_circle'))
    vectors = np.array([[0.1, 0.0, -0.2], [0.0, 0.2, 0.1]])
    poses = np.hstack([np.zeros((2, 3)), vectors])
    seen = robot.module.orientations(robot.parameters, poses)
    numbers = np.hstack([poses[:, :3] + [0.1, 0.2, 2.0], -seen])  # the same rotations
    found = np.reshape(as_poses(robot, numbers.ravel().tolist()), (2, 6))
    np.testing.assert_allclose(found[:, 3:], vectors, atol=1e-12)
    np.testing.assert_allclose(found[:, :3], [[0.1, 0.2, 2.0]] * 2)


def test_quaternions_need_a_pose_that_turns():
    robot = robot_of(resolve('delta_circle'))
    with pytest.raises(
        InputError, match='quaternions need a pose of x, y, z, rx, ry, rz; that of'
    ):
        as_poses(robot, [0.0, 0.0, -1.1, 0.0, 0.0, 0.0, 1.0] * 2)


def test_points_of_a_plane_are_refused_for_a_machine_in_space(tmp_path):
    path = tmp_path / 'points.csv'
    path.write_text('t, x, y, phi\n0, 0, 0, 0\n1, 0.1, 0, 0\n')
    given = {'trajectory.shape': 'waypoints', 'waypoints.file': str(path)}
    with pytest.raises(InputError, match=r'a point must be a pose of delta, x \[m\], y \[m\], z'):
        trajectory_of(resolve('delta_circle', given))
