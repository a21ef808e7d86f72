"""Calibration: against closed forms, and on robots whose truth is known."""

import numpy as np
import pytest

from parallel_robot.studies.calibration import calibrated, design, least_squares, pose_model
from parallel_robot.studies.calibration.pose_model import JointTrack, MeasuredPoses, PoseModel
from parallel_robot.studies.calibration.tracker import Locator
from parallel_robot_control.configuration import nominal_of, resolve
from parallel_robot_model.common.errors import BagError, InputError
from trajectory_gen.configuration import trajectory_of

NOISE = {'m': 1e-5, 'rad': 5e-5}


class Case:
    """A scenario's robot, and poses that it reaches."""

    def __init__(self, scenario, count, seed=0):
        self.values = resolve(scenario)
        self.robot, centre = nominal_of(self.values)
        trajectory = trajectory_of(self.values)
        self.pose = design.candidates(trajectory, centre, count, seed)
        self.joints = np.array(
            [design.joints_within_reach(trajectory, each) for each in self.pose]
        )
        self.numbers = pose_model.find_numbers(self.robot, self.joints, self.pose)
        axes = self.robot.module.coordinates(self.robot.parameters)
        self.noise = np.array([NOISE[axis.unit] for axis in axes])

    def measured(self, seed=None, length=0.0, turn=0.0, noise=1.0):
        """Truth and measured poses of a robot that differs by normal numbers [m, rad]."""
        rng = np.random.default_rng(seed)
        size = np.array([length if each.unit == 'm' else turn for each in self.numbers])
        true = pose_model.values_of(self.robot, self.numbers) + size * rng.normal(size=len(size))
        zero = turn * rng.normal(size=self.joints.shape[1])
        body = pose_model.with_values(self.robot, self.numbers, true)
        pose = Locator(self.robot)(body, self.joints - zero, self.pose)
        assert pose is not None
        return np.concatenate([true, zero]), pose + noise * self.noise * rng.normal(
            size=pose.shape
        )

    def model(self, pose, columns=None, free=()):
        """What a tracker that measures the robot at rest tells."""
        columns = tuple(range(pose.shape[1])) if columns is None else columns
        begin = 10.0 * np.arange(len(pose))
        track = JointTrack(np.add.outer(begin, [0.0, 1.0]).ravel(), np.repeat(self.joints, 2, 0))
        measured = MeasuredPoses(begin + 0.5, columns, pose[:, list(columns)])
        names, zero = tuple(self.values['joints']), np.zeros(self.joints.shape[1])
        return PoseModel(self.robot, names, track, measured, self.pose, zero, free)


@pytest.fixture(scope='module')
def parallel():
    return Case('paper_circle', 40)


@pytest.fixture(scope='module')
def arm():
    return Case('serial_2r_circle', 40)


def names(model):
    return [each.name for each in model.unknown]


def test_geometry_is_what_moves_the_pose(parallel, arm):
    found = [each.name for each in parallel.numbers]
    assert found == [
        'robot.l1', 'robot.l2', 'robot.l3',
        *(f'robot.{key}[{k}]' for key in ('base_x', 'base_y', 'platform_angle') for k in range(3)),
    ]  # fmt: skip
    assert [each.name for each in arm.numbers] == ['robot.l1', 'robot.l2']
    assert Case('axes_step', 5).numbers == ()


def test_slopes_of_an_arm_are_those_of_its_equations(arm):
    """x = l1 c1 + l2 c12, y = l1 s1 + l2 s12; zero angles are taken off the joints."""
    model = arm.model(arm.pose)
    q1, q12 = arm.joints[:, 0], arm.joints.sum(axis=1)
    l1, l2 = model.start[:2]
    first, second = (np.column_stack([np.cos(q), np.sin(q)]) for q in (q1, q12))
    turned = [np.column_stack([-each[:, 1], each[:, 0]]) for each in (first, second)]
    expected = [first, second, -l1 * turned[0] - l2 * turned[1], -l2 * turned[1], 0.0 * first]
    np.testing.assert_allclose(model.slopes(model.start), np.stack(expected, -1), atol=1e-9)


def test_an_arm_is_that_of_linear_least_squares(arm):
    """l1 e^(i (q1 - z1)) + l2 e^(i (q1 + q2 - z1 - z2)) is linear in two complex numbers."""
    _, pose = arm.measured(3, 1e-3, 2e-3)
    found = least_squares.fit(arm.model(pose))
    basis = np.exp(1j * np.column_stack([arm.joints[:, 0], arm.joints.sum(axis=1)]))
    tip = pose[:, 0] + 1j * pose[:, 1]
    (first, second), *_ = np.linalg.lstsq(basis, tip, rcond=None)
    expected = [abs(first), abs(second), -np.angle(first), np.angle(first) - np.angle(second)]
    np.testing.assert_allclose(found.values[:4], expected, atol=1e-8)
    left = np.abs(tip - basis @ [first, second])
    noise = np.sqrt((left**2).sum() / (2 * len(tip) - 4))
    np.testing.assert_allclose(found.noise, noise, rtol=1e-3)
    spread = np.linalg.inv(basis.conj().T @ basis).real * noise**2
    errors = found.half_widths[:2] / found.interval[:2]
    np.testing.assert_allclose(errors, np.sqrt(np.diag(spread)), rtol=0.02)


def test_exact_poses_give_the_exact_robot(parallel):
    truth, pose = parallel.measured(1, 1e-3, 2e-3, noise=0.0)
    found = least_squares.fit(parallel.model(pose))
    np.testing.assert_allclose(found.values[:-1], truth, atol=1e-8)
    assert found.kept == (len(truth),)  # the clock, of a robot at rest


def test_intervals_hold_the_truth_and_the_robot_is_near_the_true_one(parallel):
    locate, inside, errors = Locator(parallel.robot), [], []
    for seed in range(30):
        truth, pose = parallel.measured(seed, 1e-3, 2e-3)
        model = parallel.model(pose)
        found = least_squares.fit(model)
        off = np.abs(found.values[:-1] - truth)
        inside += (off <= found.half_widths[:-1]).tolist()
        zero = model.zeros
        both = [
            locate(model.robot_with(values), parallel.joints - values[zero], parallel.pose)
            for values in (found.values, truth)
        ]
        errors.append(np.sqrt((((both[0] - both[1])[:, :2]) ** 2).sum(axis=1).mean()))
        expected = calibrated.expected_error(model, found)['m']
        assert errors[-1] < 3.0 * expected
    assert 0.90 <= np.mean(inside) <= 0.99
    assert max(errors) < 15e-6


def spans(found, model, *directions):
    """Whether combinations, by the names of their unknown, are among those that are not told."""
    for direction in directions:
        vector = np.array([direction.get(name, 0.0) for name in names(model)])
        vector /= np.linalg.norm(vector)
        basis = np.linalg.qr(found.untold.T)[0]
        assert np.linalg.norm(vector - basis @ (basis.T @ vector)) < 1e-3, direction
    return True


CLOCK = {'clock': 1.0}
AROUND = {f'robot.platform_angle[{k}]': 1.0 for k in range(3)}


def test_without_its_angle_nobody_knows_how_the_platform_is_counted(parallel):
    _, pose = parallel.measured(2, 1e-3, 2e-3)
    model = parallel.model(pose, columns=(0, 1))
    found = least_squares.fit(model)
    assert len(found.untold) == 2 and spans(found, model, CLOCK, AROUND)
    [line] = [line for line in calibrated.untold(model, found) if 'platform' in line]
    assert line.count('+0.58 robot.platform_angle') == 3
    assert not found.half_widths[list(found.kept)].any()


def test_a_tracker_somewhere_leaves_the_place_and_direction_of_the_base(parallel):
    _, pose = parallel.measured(4, 1e-3, 2e-3)
    model = parallel.model(pose, free=('frame',))
    found = least_squares.fit(model)
    value = dict(zip(names(model), found.values, strict=True))
    c, s = np.cos(value['frame.angle']), np.sin(value['frame.angle'])
    along_x = {f'robot.base_x[{k}]': 1.0 for k in range(3)} | {'frame.x': -c, 'frame.y': -s}
    along_y = {f'robot.base_y[{k}]': 1.0 for k in range(3)} | {'frame.x': s, 'frame.y': -c}
    # The robot turns about its origin, the frame back again.
    turn = {f'robot.base_x[{k}]': -value[f'robot.base_y[{k}]'] for k in range(3)}
    turn |= {f'robot.base_y[{k}]': value[f'robot.base_x[{k}]'] for k in range(3)}
    turn |= {f'zero angle of joint{k}': -1.0 for k in (1, 2, 3)} | {'frame.angle': -1.0}
    assert len(found.untold) == 4 and spans(found, model, CLOCK, along_x, along_y, turn)
    kept = {names(model)[k] for k in found.kept}
    assert not any(name.startswith('frame') for name in kept)  # the robot says where it is
    # What is told is the shape of the robot.
    assert np.sqrt((found.left[:, :2] ** 2).mean()) < 1.2e-5


def test_tracker_and_target_anywhere(parallel):
    """A target 30 mm beside the centre and turned, a tracker half a metre away and turned more."""
    truth, pose = parallel.measured(5, 1e-4, 2e-4, noise=0.0)
    arm = np.exp(1j * pose[:, 2]) * (0.03 - 0.01j)
    seen = np.exp(2.5j) * (pose[:, 0] + 1j * pose[:, 1] + arm) + (0.4 - 0.3j)
    model = parallel.model(
        np.column_stack([seen.real, seen.imag, pose[:, 2] + 3.9]), free=('frame', 'target')
    )
    found = least_squares.fit(model)
    assert np.abs(found.left).max() < 1e-8
    lengths = found.values[[names(model).index(f'robot.l{k}') for k in (1, 2, 3)]]
    np.testing.assert_allclose(lengths, truth[:3], atol=1e-7)


def test_an_arm_needs_no_pin_but_its_direction(arm):
    _, pose = arm.measured(6, 1e-3, 2e-3)
    model = arm.model(pose, free=('frame',))
    found = least_squares.fit(model)
    direction = {'zero angle of shoulder': 1.0, 'frame.angle': 1.0}
    assert len(found.untold) == 2 and spans(found, model, CLOCK, direction)


def test_a_late_tracker_is_found_while_the_robot_moves(arm):
    """The tip on a path, of which the tracker tells 4 ms too late."""
    time = np.arange(0.0, 6.0, 1e-3)
    joints = np.column_stack([0.5 + 0.4 * np.sin(time), 1.2 + 0.5 * np.cos(1.7 * time)])
    rng = np.random.default_rng(0)
    body = pose_model.with_values(arm.robot, arm.numbers, np.array([0.3007, 0.2995]))
    zero = np.array([1e-3, -2e-3])
    l1, l2 = 0.3007, 0.2995
    q1, q12 = joints[:, 0] - zero[0], joints.sum(axis=1) - zero.sum()
    tip = np.column_stack([l1 * np.cos(q1) + l2 * np.cos(q12), l1 * np.sin(q1) + l2 * np.sin(q12)])
    assert Locator(arm.robot)(body, joints - zero, tip) == pytest.approx(tip, abs=1e-12)
    rows = np.arange(50, 5900, 7)
    pose = tip[rows] + 1e-5 * rng.normal(size=(len(rows), 2))
    track = JointTrack(time, joints + 5e-6 * rng.normal(size=joints.shape))
    measured = MeasuredPoses(time[rows] + 4e-3, (0, 1), pose)
    model = PoseModel(arm.robot, ('a', 'b'), track, measured, tip[rows], np.zeros(2))
    found = least_squares.fit(model)
    truth = np.array([l1, l2, *zero, 4e-3])
    assert not found.kept
    assert (np.abs(found.values - truth) <= 2.0 * found.half_widths).all()
    assert found.half_widths[-1] < 2e-5


def test_too_few_poses_are_refused(parallel):
    few = Case('paper_circle', 5)
    model = few.model(few.pose)
    with pytest.raises(BagError, match=r'5 poses of 3 numbers are too few for 16 .* at least 6'):
        least_squares.fit(model)


@pytest.mark.parametrize(
    ('scenario', 'free', 'message'),
    [
        ('axes_step', 'frame', '--free frame is for robots that move in a plane'),
        ('serial_2r_circle', 'target', '--free target needs an angle phi'),
    ],
)
def test_what_a_robot_has_not_cannot_be_free(scenario, free, message):
    case = Case(scenario, 5)
    with pytest.raises(InputError, match=message):
        case.model(case.pose, free=(free,))


def test_axes_have_zero_angles_alone():
    case = Case('axes_step', 12)
    truth, pose = case.measured(7, turn=2e-3)
    found = least_squares.fit(case.model(pose))
    np.testing.assert_allclose(found.values[:-1], truth, atol=5 * 5e-5 / np.sqrt(12))


def test_chosen_poses_are_better_than_each_with_one_exchanged():
    """The determinant of the information, computed anew for every exchange."""
    rng = np.random.default_rng(0)
    J = rng.normal(size=(40, 2, 5)) * rng.uniform(0.1, 3.0, size=(40, 1, 1))
    chosen = design._exchanged(J, design._greedy(J, 6))

    def determinant(rows):
        flat = J[rows].reshape(-1, 5)
        return np.linalg.slogdet(flat.T @ flat + np.eye(5))[1]

    best = determinant(chosen)
    for place in range(6):
        for other in set(range(40)) - set(chosen):
            rows = [*chosen[:place], other, *chosen[place + 1 :]]
            assert determinant(rows) <= best + 1e-8
    assert len(set(chosen)) == 6


@pytest.mark.parametrize('scenario', ['paper_circle', 'five_bar_circle'])
def test_a_line_out_of_reach_is_looked_at_up_to_there(scenario):
    """The joints at its samples before are those of single poses; the next one has none."""
    values = resolve(scenario)
    _, centre = nominal_of(values)
    trajectory = trajectory_of(values)
    line = design.along(trajectory, centre, centre + 1.0)
    last = len(line.pose) - 1
    assert 0 < last < design.SAMPLES - 1 and np.isnan(line.position[last]).any()
    for k in (0, last // 2, last - 1):
        joints = design.joints_within_reach(trajectory, line.pose[k])
        np.testing.assert_allclose(line.position[k], joints, atol=1e-9)
    assert np.isnan(design.joints_within_reach(trajectory, line.pose[last])).any()
