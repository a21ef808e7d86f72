"""What a tool reaches in a plane, compared with closed forms of the robots."""

import contextlib
import math

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, label

from parallel_robot.analysis.reach import Axis, Plane, plane_of_motion, region_of
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_sim.configuration import configure
from trajectory_gen.configuration import trajectory_of

STEPS = 60


TILTED = (0.0, math.sqrt(0.5), -math.sqrt(0.5)), (-4 / math.sqrt(18), *[1 / math.sqrt(18)] * 2)


def through_pose(robot, plane, pose):
    """The plane of two coordinates through a pose, or of two directions."""
    names = [each.name for each in robot.module.coordinates(robot.parameters)]
    unit = dict(zip(names, np.eye(robot.pose_size), strict=True))
    axes = [Axis(unit.get(each, np.array(each)), str(each)) for each in plane]
    return Plane(np.array(pose), tuple(axes))


def reached(scenario, plane, through, steps=STEPS, **values):
    """The region, and the poses of its grid, shape (rows, columns, m)."""
    given = {key.replace('__', '.'): value for key, value in values.items()}
    robot = trajectory_of(resolve(scenario, given)).robot
    region = region_of(robot, through_pose(robot, plane, through), steps)
    grid = np.stack(np.meshgrid(region.first, region.second), axis=-1)
    return region, region.plane.poses(grid)


def connected(good, region):
    """The part of a grid that is good and holds the pose of the plane."""
    here = region.plane.coordinates(region.plane.pose)
    row, column = (np.abs(each - k).argmin() for each, k in zip(
        (region.second, region.first), here[::-1], strict=True
    ))  # fmt: skip
    parts, _ = label(good)
    assert parts[row, column]
    return parts == parts[row, column]


def assert_same(region, good):
    """Both agree, but for rounding where they end."""
    expected = connected(good, region)
    assert region.complete and expected.sum() > 300
    assert np.count_nonzero(expected != region.inside) <= 2


def within(angle, low, high):
    """Whether angles are between others, but for whole turns."""
    if high - low > 2 * np.pi:
        return True
    middle = 0.5 * (low + high)
    return np.abs(np.mod(angle - middle + np.pi, 2 * np.pi) - np.pi) <= 0.5 * (high - low)


def five_bar(p, lower, upper):
    """Two annuli, both elbows outward, distal links that do not fall in line."""
    good, distal = True, []
    with np.errstate(invalid='ignore'):
        for side, low, high in zip((-1.0, 1.0), lower, upper, strict=True):
            x, y = p[..., 0] - 0.059 * side, p[..., 1]
            d = np.hypot(x, y)
            q = np.arctan2(y, x) - side * np.arccos(d / 0.18)
            good = good & (d <= 0.18) & within(q, low, high)
            distal.append((x - 0.09 * np.cos(q), y - 0.09 * np.sin(q)))
    (a, b), (c, d) = distal
    return good & (a * d - b * c > 0.0)  # as at home


@pytest.mark.parametrize('travel', [((0.5, -0.46), (3.6, 2.64)), ((-9.0, -9.0), (9.0, 9.0))])
def test_five_bar_reaches_two_annuli(travel):
    lower, upper = travel
    region, poses = reached(
        'five_bar_circle', 'xy', (0.0, 0.14), robot__lower=list(lower), robot__upper=list(upper)
    )
    assert_same(region, five_bar(poses, lower, upper))


def planar_3rrr(pose):
    """Three annuli, and a platform that does not yield."""
    l1, l2, l3, angles = 0.4, 0.6, 0.2, np.pi * np.array([7 / 6, 11 / 6, 1 / 2])
    x, y, phi = np.moveaxis(pose[..., np.newaxis], -2, 0)
    x = x + l3 * np.cos(phi + angles) - np.array([0.0, 1.0, 0.5])
    y = y + l3 * np.sin(phi + angles) - np.array([0.0, 0.0, math.sqrt(0.75)])
    r = np.hypot(x, y)
    with np.errstate(invalid='ignore'):
        theta = np.arctan2(y, x) + np.arccos((r * r + l1 * l1 - l2 * l2) / (2 * l1 * r))
        beta = np.arctan2(y - l1 * np.sin(theta), x - l1 * np.cos(theta))
        rows = np.stack([np.cos(beta), np.sin(beta), np.sin(beta - phi - angles)], axis=-1)
        return ((r <= l1 + l2) & (r >= l2 - l1)).all(axis=-1), np.linalg.det(rows)


@pytest.mark.parametrize(('plane', 'phi'), [('xy', math.pi / 2), ('xy', 0.3)])
def test_planar_3rrr_reaches_three_annuli_on_its_assembly_mode(plane, phi):
    region, poses = reached('paper_circle', plane, (0.5, 0.3, phi))
    good, determinant = planar_3rrr(poses)
    _, here = planar_3rrr(region.plane.pose)
    assert_same(region, good & (determinant * here > 0.0))
    of_legs, of_platform = region.reach.margins
    assert (of_legs.key, of_platform.key) == ('min_sin_psi', 'min_determinant')
    known = np.isfinite(of_platform.values)
    np.testing.assert_allclose(of_platform.values[known], np.abs(determinant[known]), atol=1e-9)


def delta(p):
    """Three spheres of rods around the ends of three arms, within the travel of the arms."""
    good, rods = True, []
    with np.errstate(invalid='ignore'):
        for angle in 2.0 * np.pi / 3.0 * np.arange(3):
            c, s = math.cos(angle), math.sin(angle)
            x = c * p[..., 0] + s * p[..., 1] + 0.044 - 0.164
            y, z = c * p[..., 1] - s * p[..., 0], p[..., 2]
            share = (x * x + y * y + z * z + 0.524**2 - 1.244**2) / (2 * 0.524 * np.hypot(x, z))
            q = np.arctan2(-z, x) - np.arccos(share)
            good = good & (np.abs(share) <= 1.0) & within(q, -0.7, 1.4)
            u, w = x - 0.524 * np.cos(q), z + 0.524 * np.sin(q)
            rods.append(np.stack([c * u - s * y, s * u + c * y, w], axis=-1))
        return good, np.linalg.det(np.stack(rods, axis=-2))


@pytest.mark.parametrize('plane', ['xy', 'xz', TILTED])
def test_delta_reaches_what_its_arms_allow(plane):
    place = [0.0, 0.0, -1.1]
    region, poses = reached('delta_circle', plane, place)
    good, determinant = delta(poses)
    _, here = delta(np.array(place))
    assert_same(region, good & (determinant * here > 0.0))


def test_margins_are_those_of_the_motion():
    made = trajectory_of(resolve('delta_circle', {'circle.radius': 0.05}))
    path = made.sample(np.array([0.0, 0.1]))
    for pose, margins in zip(path.pose, path.passive, strict=True):
        region = region_of(made.robot, through_pose(made.robot, 'xz', pose), 20)
        x, z = region.plane.coordinates(pose)
        row, column = np.abs(region.second - z).argmin(), np.abs(region.first - x).argmin()
        found = [margin.values[row, column] for margin in region.reach.margins]
        np.testing.assert_allclose(found, margins[:2], rtol=1e-9)


def test_serial_arm_reaches_a_ring():
    region, poses = reached('serial_2r_circle', 'xy', (0.3, 0.2))
    values = resolve('serial_2r_circle')
    l1, l2 = values['robot.l1'], values['robot.l2']
    r = np.hypot(*np.moveaxis(poses, -1, 0))
    assert_same(region, (r < l1 + l2) & (r > abs(l1 - l2)))
    assert region.area == pytest.approx(math.pi * ((l1 + l2) ** 2 - (l1 - l2) ** 2), rel=0.02)


def test_hexapod_moves_as_far_as_its_legs_allow():
    region, poses = reached('hexapod_circle', 'xy', (0.0, 0.0, 2.0, 0.0, 0.0, 0.0), 30)
    robot = trajectory_of(resolve('hexapod_circle')).robot
    lower, upper = np.array(robot.parameters.lower), np.array(robot.parameters.upper)
    within, beyond = np.zeros((2, *region.inside.shape), bool)
    for index in np.ndindex(within.shape):
        with contextlib.suppress(InputError):
            q = robot.module.start(robot.parameters, poses[index])
            within[index] = (q >= lower).all() and (q <= upper).all()
            beyond[index] = not within[index]
    assert not (beyond & region.inside).any()
    assert not (within & binary_dilation(region.inside) & ~region.inside).any()
    assert np.count_nonzero(within & region.inside) > 0.9 * np.count_nonzero(region.inside)
    assert len(region.reach.margins) == 2


class TestPlane:
    @pytest.mark.parametrize(
        ('values', 'names'),
        [
            ({}, ('x', 'y')),
            ({'circle.normal': [0.0, 1.0, 0.0]}, ('x', 'z')),
            ({'circle.normal': [0.0, 1.0, 1.0]}, ('x', 'along (0, -0.707, 0.707)')),
            ({'trajectory.shape': 'pick_and_place'}, ('x', 'z')),
            ({'trajectory.shape': 'line'}, ('x', 'y')),
        ],
    )
    def test_that_of_a_motion_holds_it(self, values, names):
        made = trajectory_of(resolve('delta_circle', values))
        path = made.poses(np.linspace(0.0, made.span, 50)).pose
        plane = plane_of_motion(made.robot, path)
        assert {axis.name.replace('0.707, -0', '-0.707, 0') for axis in plane.axes} == set(names)
        np.testing.assert_allclose(plane.beside(path), 0.0, atol=1e-9)
        np.testing.assert_allclose(plane.poses(plane.coordinates(path)), path, atol=1e-9)


class TestCommand:
    @pytest.mark.parametrize('scenario', ['paper_circle', 'arm6_circle'])
    def test_a_picture_is_drawn(self, scenario, tmp_path, capsys):
        file = tmp_path / 'reach.svg'
        assert main(['show', scenario, '--workspace', str(file)]) == 0
        assert file.read_text().count('<path') > 50
        told = capsys.readouterr().err
        assert told.startswith('workspace: ') and ' m^2' in told and told.count('\n') == 1
        assert main(['show', scenario, '--workspace', str(file)]) == 2  # nothing is overwritten

    @pytest.mark.parametrize(
        ('words', 'reason'),
        [
            (['axes_step', '--workspace', 'a.png'], 'the pose of axes is no place: q1, q2'),
            (['delta_circle', '--workspace', 'a.txt'], "unknown format of --workspace '.txt'"),
        ],
    )
    def test_what_cannot_be_drawn_costs_one_line(
        self, words, reason, tmp_path, capsys, monkeypatch
    ):
        monkeypatch.chdir(tmp_path)
        assert main(['show', *words]) == 2
        error = capsys.readouterr().err
        assert error.count('\n') == 1 and reason in error and not list(tmp_path.iterdir())


def test_the_default_picture_is_that_of_the_motion(tmp_path):
    from parallel_robot.analysis.reach_picture import figure_of, plane_and_scenery

    made = configure(resolve('five_bar_circle'))
    plane, scenery = plane_and_scenery(made)
    figure = figure_of(region_of(scenery.robot, plane, STEPS), scenery)
    first, *_ = figure.axes
    lines = {line.get_label(): line.get_xydata() for line in first.lines}
    distance = np.hypot(*(lines['motion'] - [0.0, 140.0]).T)  # mm
    np.testing.assert_allclose(distance, 20.0, rtol=1e-9)
    np.testing.assert_allclose(lines['home'], [[0.0, 140.0]], atol=1e-9)
    assert first.get_aspect() == 1.0 and first.get_xlabel() == 'x [mm]'
