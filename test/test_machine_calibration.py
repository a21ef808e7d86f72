"""Calibration of described machines: slopes, trackers in space, machines whose truth is known."""

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import parallel_robot as pr
from parallel_robot.cli.command_line import main
from parallel_robot.studies.calibration import design, least_squares, measured_poses, pose_model
from parallel_robot.studies.calibration.pose_model import JointTrack, MeasuredPoses, PoseModel
from parallel_robot.studies.calibration.tracker import Locator, Tracker
from parallel_robot_control.configuration import nominal_of, resolve
from parallel_robot_model.common.errors import InputError
from trajectory_gen.configuration import trajectory_of

NOISE = {'m': 1e-5, 'rad': 5e-5}


class Case:
    """A machine, and poses that it reaches."""

    def __init__(self, scenario, count, seed=0):
        self.values = resolve(scenario)
        self.robot, centre = nominal_of(self.values)
        trajectory = trajectory_of(self.values)
        self.pose = design.candidates(trajectory, centre, count, seed)
        self.joints = np.array(
            [design.joints_within_reach(trajectory, each) for each in self.pose]
        )
        _, names, _ = self.robot.module.geometry(self.robot.parameters)
        self.numbers = [pose_model.Number('shift', k, 'm') for k in range(len(names))]
        axes = self.robot.module.coordinates(self.robot.parameters)
        self.noise = np.array([NOISE[axis.unit] for axis in axes])

    def model(self, pose, columns=None, free=()):
        """What a tracker that measures the machine at rest tells."""
        columns = tuple(range(pose.shape[1])) if columns is None else columns
        time = np.add.outer(10.0 * np.arange(len(pose)), [0.0, 1.0])
        track = JointTrack(time.ravel(), np.repeat(self.joints, 2, axis=0))
        measured = MeasuredPoses(time[:, 0] + 0.5, columns, pose)
        names, zero = tuple(self.values['joints']), np.zeros(self.joints.shape[1])
        return PoseModel(self.robot, names, track, measured, self.pose, zero, free)

    def off(self, seed, size):
        """Poses of a machine all of whose joints lie elsewhere, and what its encoders are off."""
        rng = np.random.default_rng(seed)
        body = pose_model.with_values(
            self.robot, self.numbers, size * rng.normal(size=len(self.numbers))
        )
        zero = size * rng.normal(size=self.joints.shape[1])
        pose = Locator(self.robot)(body, self.joints - zero, self.pose)
        assert pose is not None
        return body, zero, pose, rng


@pytest.mark.parametrize('name', ['five_bar', 'delta', 'hexapod', 'arm6'])
def test_slopes_of_the_pose_are_those_of_finite_differences(name):
    case = Case(f'{name}_circle', 6)
    robot, n, h = case.robot, case.joints.shape[1], 1e-5
    slopes = robot.module.pose_slopes(robot.parameters, case.joints, case.pose)
    assert slopes.shape == (6, case.pose.shape[1], n + len(case.numbers))
    locate = Locator(robot)
    joints, random = (
        3 * len(robot.module.machine(robot.parameters).names),
        np.random.default_rng(0),
    )
    chosen = random.choice(joints, 6, replace=False).tolist()
    if len(case.numbers) > joints:  # where its loops close
        chosen += (joints + random.choice(len(case.numbers) - joints, 6, replace=False)).tolist()
    for k in chosen:
        ahead, back = (
            locate(pose_model.with_values(robot, [case.numbers[k]], step), case.joints, case.pose)
            for step in (np.array([h]), np.array([-h]))
        )
        np.testing.assert_allclose(slopes[:, :, n + k], (ahead - back) / (2.0 * h), atol=1e-6)
    for k in range(n):
        step = h * np.eye(n)[k]
        ahead, back = (locate(robot, case.joints + x, case.pose) for x in (step, -step))
        np.testing.assert_allclose(slopes[:, :, k], (ahead - back) / (2.0 * h), atol=1e-6)


def test_intervals_hold_the_truth_and_the_machine_is_near_the_true_one():
    """The truth beside the values that are kept is what poses without noise tell."""
    case = Case('five_bar_circle', 30)
    locate, inside = Locator(case.robot), []
    for seed in range(12):
        body, zero, exact, rng = case.off(seed, 5e-4)
        model = case.model(exact + case.noise * rng.normal(size=exact.shape))
        found = least_squares.fit(model)
        told = [k for k in range(len(model.start)) if k not in found.kept]
        truth = found.values.copy()
        truth[told] = least_squares.solved(case.model(exact), truth.copy(), told, found.noise)
        inside += (np.abs(found.values - truth) <= found.half_widths)[told].tolist()
        turned = case.joints - found.values[model.zeros]
        both = (
            locate(body, case.joints - zero, case.pose),
            locate(model.robot_with(found.values), turned, case.pose),
        )
        assert np.sqrt(((both[0] - both[1]) ** 2).sum(axis=1).mean()) < 15e-6
    assert 0.88 <= np.mean(inside) <= 1.0


def test_what_a_ball_and_a_slide_hide_is_told():
    """A leg that is longer is an encoder that is off; the hinges of a ball can change places."""
    case = Case('hexapod_circle', 30)
    model = case.model(case.off(0, 1e-4)[2])
    found = least_squares.fit(model)
    names = [each.name for each in model.unknown]
    for one, other, sign in (
        ('robot.shift[26] leg2 z', 'zero angle of leg2', 1.0),
        ('robot.shift[13] ball1.y y', 'robot.shift[16] ball1.z y', -1.0),
    ):
        direction = np.zeros(len(names))
        direction[[names.index(one), names.index(other)]] = np.sqrt(0.5) * np.array([1.0, sign])
        basis = np.linalg.qr(found.untold.T)[0]
        np.testing.assert_allclose(basis @ (basis.T @ direction), direction, atol=1e-3)
    assert np.abs(found.left).max() < 1e-7


def test_tracker_and_target_anywhere_in_space():
    case = Case('hexapod_circle', 30)
    _, _, pose, rng = case.off(1, 1e-4)
    frame, target = Rotation.from_rotvec([0.3, 2.5, -1.0]), Rotation.from_rotvec([1.0, -2.0, 0.5])
    turned = Rotation.from_rotvec(pose[:, 3:])
    place = frame.apply(pose[:, :3] + turned.apply([0.1, -0.2, 0.05]))
    seen = np.column_stack([place, (frame * turned * target).as_rotvec()])
    seen += [4.0, -2.0, 1.0, 0.0, 0.0, 0.0] + 0.1 * case.noise * rng.normal(size=seen.shape)
    model = case.model(seen, free=('frame', 'target'))
    found = least_squares.fit(model)
    assert np.sqrt((found.left[:, :3] ** 2).mean()) < 1.2e-6
    value = dict(zip((each.name for each in model.unknown), found.values, strict=True))
    vector = [value[f'target.{axis}'] for axis in ('rx', 'ry', 'rz')]
    apart = (Rotation.from_rotvec(vector) * target.inv()).magnitude()
    assert apart < 1e-3  # as far as the platform tells it from its own joints


def test_three_rotations_are_compared_as_one():
    """Of two vectors beside a half turn, the components differ by far, the attitudes little."""
    robot = Case('arm6_circle', 1).robot
    tracker = Tracker(robot, (0, 1, 2, 3, 4, 5))
    turn = np.array([[0.0, 0.0, 0.0, np.pi - 1e-3, 0.0, 0.0]])
    other = np.array([[0.0, 0.0, 0.0, -np.pi + 1e-3, 0.0, 0.0]])
    np.testing.assert_allclose(tracker.apart(turn, other)[0, 3:], [-2e-3, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ('scenario', 'free', 'message'),
    [
        ('delta_circle', 'target', 'needs an angle phi'),
        ('five_bar_circle', 'target', 'needs an angle phi'),
    ],
)
def test_a_target_is_not_free_where_nothing_turns(scenario, free, message):
    with pytest.raises(InputError, match=message):
        Tracker(Case(scenario, 1).robot, (0, 1), (free,))


def test_quaternions_of_a_file_are_rotation_vectors_from_home(tmp_path):
    rng = np.random.default_rng(0)
    home, vectors = Rotation.from_rotvec([0.4, -1.0, 2.0]), rng.uniform(-1.0, 1.0, (5, 3))
    quaternions = (Rotation.from_rotvec(vectors) * home).as_quat()
    table = np.column_stack([np.arange(5.0), quaternions, vectors])
    file = tmp_path / 'poses.csv'
    names = ['x', 'y', 'z', 'rx', 'ry', 'rz']
    np.savetxt(file, table, '%.12f', ',', header='t,qx,qy,qz,qw,x,y,z', comments='')
    read, *_ = measured_poses.read_file(file, names, 0, home)
    assert [names[k] for k in read.columns] == names
    np.testing.assert_allclose(read.pose, np.column_stack([vectors, vectors]), atol=1e-9)
    for header, row, message in (
        ('t,x,qx,qy,qz', '0,1,0,0,0', 'line 1: a rotation is all of qx, qy, qz, qw'),
        ('t,x,qx,qy,qz,qw,rx', '0,1,0,0,0,1,0', 'or some of rx, ry, rz, not qx'),
        ('t,x,qx,qy,qz,qw', '0,1,0,0,0,2', 'line 2: the quaternion must be of length 1, not 2'),
    ):
        file.write_text(f'{header}\n{row}\n')
        with pytest.raises(InputError, match=message):
            measured_poses.read_file(file, names, 0, home)


def test_a_machine_is_calibrated_by_the_command_and_its_file_makes_a_loop_right(tmp_path, capsys):
    motion, bag, poses, out = (
        tmp_path / name for name in ('m.yaml', 'bag', 'p.csv', 'robot.yaml')
    )
    words = ['calibrate', '--scenario', 'five_bar_circle', '--design', '16', '--out', motion]
    words += ['--set', 'trajectory.min_closure=0.4']  # a machine that is off gets nearer than ours
    assert main([str(word) for word in words]) == 0
    shift = (5e-4 * np.random.default_rng(2).normal(size=18)).tolist()
    true = {'true_robot.shift': shift, 'sensor.zero_angle': [1e-3, -5e-4]}
    joined = {'approach.duration': 0.4}
    run = pr.simulate('five_bar_circle', param_file=motion, **joined, **true)
    assert run.fault is None
    pr.save(run, bag)
    rows = np.arange(1000, len(run.time), 100)
    seen = run.pose[rows] + 1e-5 * np.random.default_rng(1).normal(size=(len(rows), 2))
    np.savetxt(
        poses, np.column_stack([run.time[rows], seen]), '%.9f', ',', header='t,x,y', comments=''
    )
    words = ['calibrate', bag, '--poses', poses, '--out', out]
    assert main([str(word) for word in words]) == 0
    assert 'robot.shift[3] left_elbow x' in capsys.readouterr().out
    assert set(yaml.safe_load(out.read_text())) == {'robot', 'estimator', 'sensor'}
    errors = []
    for file in ({}, {'param_file': out}):
        held = pr.simulate('five_bar_circle', duration=2, **file, **true)
        left = held.pose - pr.simulate('five_bar_circle', duration=2, **file).pose
        errors.append(float(np.sqrt((left[1000:] ** 2).sum(axis=1).mean())))
    assert errors[1] < 15e-6 < 1e-4 < errors[0], errors
