"""A machine that stands in x-z or y-z is that of x-y to rounding, wherever its place counts."""

import numpy as np
import pytest
from machine_files import INERTIAL, five_bar, mjcf
from scipy.spatial.transform import Rotation

import parallel_robot
from parallel_robot.analysis.reach import plane_of_motion, region_of
from parallel_robot.analysis.report.planned import figure_of_motion
from parallel_robot_control.configuration import resolve
from parallel_robot_model.mechanisms.description.assembly import coordinates
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.plant_node import RobotMarkers
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.messages import pose_fields

ARM = mjcf(
    f'<body euler="0 0 20"><joint name="a"/>{INERTIAL.format(0.1, 1)}<body pos="0.3 0 0" '
    f'euler="0 0 60"><joint name="b"/>{INERTIAL.format(0.1, 1)}<body pos="0.25 0 0" '
    f'euler="0 0 -30"><joint name="c"/>{INERTIAL.format(0.05, 0.5)}<site name="tool" '
    'pos="0.1 0 0"/></body></body></body>',
    '<actuator><motor joint="a"/><motor joint="b"/><motor joint="c"/></actuator>',
)
MACHINES = {'arm': ARM, 'five_bar': five_bar()}
# A quaternion w, x, y, z that lays x-y into a plane; the sign of its angle about the third axis.
PLANES = {'xz': ('1 1 0 0', -1.0), 'yz': ('1 1 1 1', 1.0)}
TIMES = np.linspace(0.0, 2.0, 50)


def standing(name, plane):
    """A machine that stands in a plane, gravity along its second axis."""
    gravity = '0 -9.81 0' if plane == 'xy' else '0 0 -9.81'
    turned = PLANES[plane][0] if plane != 'xy' else '1 0 0 0'
    return (
        MACHINES[name]
        .replace('<worldbody>', f'<option gravity="{gravity}"/><worldbody><body quat="{turned}">')
        .replace('</worldbody>', '</body></worldbody>')
    )


@pytest.fixture(params=[(name, plane) for name in MACHINES for plane in PLANES], ids=str)
def pair(request, tmp_path):
    """Files of a machine in x-y and in another plane, and this plane."""
    name, plane = request.param
    files = []
    for each in ('xy', plane):
        files.append(tmp_path / f'{name}_{each}.xml')
        files[-1].write_text(standing(name, each))
    return (*files, plane)


def signs(robot, plane):
    """What the coordinates in a plane are of those in x-y, shape (m,)."""
    return np.array([1.0, 1.0, PLANES[plane][1]])[: robot.pose_size]


def test_its_circle_is_that_of_x_y(pair):
    level, upright = (trajectory_of(resolve(str(file))) for file in pair[:2])
    assert level.parameters.shape == upright.parameters.shape == 'circle'
    there, here = level.sample(TIMES), upright.sample(TIMES)
    of_pose = signs(level.robot, pair[2])
    np.testing.assert_allclose(here.pose, there.pose * of_pose, atol=1e-9)
    np.testing.assert_allclose(here.position, there.position, atol=1e-8)
    np.testing.assert_allclose(here.acceleration, there.acceleration, atol=1e-7)


def test_its_lines_are_those_of_x_y(pair):
    (level, flat), (robot, poses) = (
        (robot_of(values), trajectory_of(values).sample(0.3))
        for values in (resolve(str(file)) for file in pair[:2])
    )
    parts = robot.module.segments(robot.parameters, poses.pose[0], poses.position[0])
    there = level.module.segments(level.parameters, flat.pose[0], flat.position[0])
    np.testing.assert_allclose(parts['link'], there['link'], atol=1e-8)
    assert ''.join(robot.axes) == pair[2] and robot.planar and robot.place == 2
    markers = RobotMarkers(robot).build(0, poses.pose[0], poses.position[0]).markers
    (beside,) = {*'xyz'} - {*robot.axes}
    for point, place in zip(markers[0].points, parts['link'].reshape(-1, 2), strict=True):
        assert [getattr(point, axis) for axis in robot.axes] == place.tolist()
        assert getattr(point, beside) == 0.0


def test_its_pose_in_space_is_where_the_tool_is(pair):
    values = resolve(str(pair[1]))
    robot, reference = robot_of(values), trajectory_of(values).sample(TIMES)
    fields = pose_fields(robot, reference.pose)
    place = [fields[axis] for axis in robot.axes]
    np.testing.assert_array_equal(np.transpose(place), reference.pose[:, :2])
    if robot.pose_size == 3:
        orientations = Rotation.from_quat(
            robot.module.orientations(robot.parameters, reference.pose)
        )
        turned = orientations * orientations[0].inv()
        told = [fields.get(f'q{axis}', np.zeros(len(TIMES))) for axis in 'xyzw']
        seen = Rotation.from_quat(np.transpose(told))
        np.testing.assert_allclose((seen * seen[0].inv() * turned.inv()).magnitude(), 0, atol=1e-9)


def test_it_reaches_what_it_reaches_in_x_y(pair):
    areas = []
    for file in pair[:2]:
        robot, values = robot_of(resolve(str(file))), resolve(str(file))
        plane = plane_of_motion(robot, trajectory_of(values).poses(TIMES).pose)
        areas.append(region_of(robot, plane, 40).area)
    assert areas[1] == pytest.approx(areas[0], rel=1e-6) and areas[0] > 0.0
    assert ''.join(axis.name for axis in plane.axes) == pair[2]


def test_its_runs_are_those_of_x_y(pair, tmp_path):
    level, upright = (parallel_robot.simulate(str(file), duration=0.2) for file in pair[:2])
    np.testing.assert_allclose(upright.position, level.position, atol=1e-8)
    there, here = (parallel_robot.metrics(run)['xy_rms_m'] for run in (level, upright))
    assert here == pytest.approx(there, rel=1e-3) and here > 0.0


def test_its_pictures_name_its_axes(pair):
    across, up = pair[2]
    figure = figure_of_motion(configure(resolve(str(pair[1]))))
    path = next(axes for axes in figure.axes if axes.get_title() == 'Path and robot')
    assert (path.get_xlabel(), path.get_ylabel()) == (f'{across} [mm]', f'{up} [mm]')


@pytest.mark.parametrize(
    ('motion', 'names'),
    [
        ([(0, 1, 0, 0, 0, 1), (0, 0.5, 0, 0, 0, 1)], ['y', 'rz']),  # an arm that is stretched
        ([(0, 1, 0, 0, 0, 1), (0, 0, 1, 0, 1, 0)], ['y', 'z']),  # pan and tilt
        ([(0.7, 0.7, 1, -0.7, 0.7, 0), (0.1, 0.1, 0.5, -0.7, 0.7, 0)], ['x', 'z']),  # between
        ([(1, 0, 0, 0, 0, 0)], ['x']),
    ],
)
def test_a_motion_beside_the_plane_of_two_axes_is_in_none(motion, names):
    _, found, planar = coordinates(np.transpose(motion).astype(float))
    assert [name for name, _ in found] == names and not planar
