"""What holds for every robot: the contract, and the files in config/robots."""

import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from vectors import OnVectors, on_vectors

from parallel_robot_model.configuration.fields import build, parameters
from parallel_robot_model.robots.contract import FOUND, REACHED, PoseMotion, Robot
from parallel_robot_model.robots.joint_load import (
    DisturbanceParameters,
    FrictionParameters,
    JointLoad,
    net_torque,
)
from parallel_robot_model.robots.registry import ROBOTS as MODULES

ROBOTS = {name: OnVectors(module) for name, module in MODULES.items()}
CONFIG = Path(__file__).parents[1] / 'config'
FILES = [file for file in sorted(CONFIG.glob('robots/*.yaml')) if file.stem in ROBOTS]
H = 1e-5  # s, of central differences
STATES = 10  # random states of each robot


def configuration(name):
    return yaml.safe_load((CONFIG / 'robots' / f'{name}.yaml').read_text())


def picked(group, values, prefix, joints):
    """A group from those of the values that are its own; a scenario gives the frequency."""
    rest = {'stribeck': 0.0, 'stribeck_velocity': 0.01, 'smoothing': 0.0, 'frequency': 0.8}
    rest |= {'offset': 0.3, 'load': 0.1}
    values = {**rest, **values}
    keys = [parameter.key for parameter in parameters(group)]
    return build(group, {key: values[key] for key in keys}, prefix, joints)


@pytest.fixture(params=ROBOTS)
def case(request):
    """A robot with its parameters, margins and load, and random states near its initial pose."""
    robot, values = ROBOTS[request.param], configuration(request.param)
    n = len(values['joints'])
    own = robot.validate(picked(robot.Parameters, values['robot'], 'robot.', n))
    pose = np.array(values['plant']['initial_pose'])
    rng = np.random.default_rng(3)
    poses = pose + rng.uniform(-0.03, 0.03, (STATES, len(pose)))
    disturbance = {**values['disturbance'], 'amplitude': 0.4, 'phase': 0.3}
    return SimpleNamespace(
        robot=robot,
        parameters=own,
        n=n,
        m=len(pose),
        margins=picked(robot.SafetyMargins, values['safety'], 'safety.', n),
        load=JointLoad(
            picked(FrictionParameters, values['friction'], 'friction.', n),
            picked(DisturbanceParameters, disturbance, 'disturbance.', n),
        ),
        poses=poses,
        coordinates=[robot.start(own, pose) for pose in poses],
        rates=rng.uniform(-0.5, 0.5, (STATES, len(robot.start(own, pose)))),
        torques=rng.uniform(-5.0, 5.0, (STATES, n)),
        rng=rng,
    )


def measure(case, coordinates, rate):
    return case.robot.measure(case.parameters, coordinates, rate)


def estimate(case, measured):
    """Estimate from the joints of a measurement, with a guess beside the pose."""
    return case.robot.estimate(
        case.parameters,
        case.margins,
        measured.position,
        measured.velocity,
        measured.pose + 1e-3,
    )


def states(case):
    return zip(case.coordinates, case.rates, strict=True)


def test_names_and_faults(case):
    coordinates = case.robot.coordinates(case.parameters)
    assert len({coordinate.name for coordinate in coordinates}) == case.m
    assert all(coordinate.unit in ('m', 'rad') for coordinate in coordinates)
    if case.robot.PLANAR:
        names = [coordinate.name for coordinate in coordinates]
        assert names == ['x', 'y', 'phi'][: case.m] and case.m >= 2
    assert set(case.robot.FAULTS) <= set(range(1, 10))
    keys = [fault.key for fault in case.robot.FAULTS.values()]
    assert len(set(keys)) == len(keys) and all(key.isidentifier() for key in keys)


def test_joints_are_as_many_as_the_contract_says(case):
    n = case.robot.joints(case.parameters)
    assert n == case.n
    coordinates, rate = case.coordinates[0], case.rates[0]
    measured = measure(case, coordinates, rate)
    assert measured.position.shape == measured.velocity.shape == (n,)
    assert measured.passive_position.shape == measured.passive_velocity.shape
    assert measured.pose.shape == (case.m,)
    still = np.zeros(case.m)
    motion = case.robot.joint_motion(case.parameters, PoseMotion(case.poses[0], still, still))
    assert motion.position.shape == motion.velocity.shape == motion.acceleration.shape == (n,)
    model = estimate(case, measured).model
    assert model.M.shape == model.Q.shape == (n, n) and model.gravity.shape == (n,)
    acceleration = case.robot.acceleration(
        case.parameters, case.load, coordinates, rate, case.torques[0], 0.0
    )
    assert acceleration.shape == coordinates.shape


def test_the_start_is_at_the_pose(case):
    for pose, coordinates in zip(case.poses, case.coordinates, strict=True):
        measured = measure(case, coordinates, np.zeros_like(coordinates))
        assert np.allclose(measured.pose, pose, atol=1e-12) and not measured.velocity.any()


def test_estimate_at_a_good_posture(case):
    for coordinates, rate in states(case):
        measured = measure(case, coordinates, rate)
        found = estimate(case, measured)
        assert found.fault == FOUND
        assert np.allclose(found.pose, measured.pose, atol=1e-9)
        M = found.model.M
        assert np.array_equal(M, M.T) and np.linalg.eigvalsh(M).min() > 0
        location = case.robot.locate(case.parameters, measured.position, measured.pose + 1e-3)
        assert location.fault == FOUND and np.array_equal(location.pose, found.pose)


def test_a_violated_margin_is_a_fault_without_a_model(case):
    measured = measure(case, case.coordinates[0], case.rates[0])
    for index, name in enumerate(case.margins._fields):
        kind = parameters(type(case.margins))[index].field
        widest = min(kind.high, 1e3)  # no posture keeps such a distance
        found = estimate(
            SimpleNamespace(**{**vars(case), 'margins': case.margins._replace(**{name: widest})}),
            measured,
        )
        assert found.fault in case.robot.FAULTS
        assert np.allclose(found.pose, measured.pose, atol=1e-9)
        assert not any(part.any() for part in found.model)


def test_joint_motion_leads_to_the_joints_of_the_pose(case):
    still = np.zeros(case.m)
    for coordinates, rate in states(case):
        measured = measure(case, coordinates, rate)
        motion = case.robot.joint_motion(case.parameters, PoseMotion(measured.pose, still, still))
        assert motion.out_of_reach == REACHED
        assert np.allclose(motion.position, measured.position, atol=1e-12)
        assert not motion.velocity.any() and not motion.acceleration.any()


def test_joint_motion_is_the_derivative_of_its_positions(case):
    for pose in case.poses:
        rate, acceleration = case.rng.uniform(-0.5, 0.5, (2, case.m))

        def at(t, pose=pose, rate=rate, acceleration=acceleration):
            motion = PoseMotion(
                pose + rate * t + acceleration * t**2 / 2, rate + acceleration * t, acceleration
            )
            return case.robot.joint_motion(case.parameters, motion)

        here, ahead, behind = at(0.0), at(H), at(-H)
        velocity = (ahead.position - behind.position) / (2 * H)
        assert np.allclose(here.velocity, velocity, atol=1e-7)
        slope = (ahead.velocity - behind.velocity) / (2 * H)
        assert np.allclose(here.acceleration, slope, atol=1e-6)


def test_measured_rates_are_derivatives(case):
    for coordinates, rate in states(case):
        here = measure(case, coordinates, rate)
        ahead = measure(case, coordinates + H * rate, rate)
        behind = measure(case, coordinates - H * rate, rate)
        for position, velocity in (
            ('position', 'velocity'),
            ('passive_position', 'passive_velocity'),
        ):
            slope = (getattr(ahead, position) - getattr(behind, position)) / (2 * H)
            assert np.allclose(getattr(here, velocity), slope, atol=1e-7)


def test_plant_and_model_describe_one_machine(case):
    """M thdd + Q thd + gravity is what friction and disturbance leave of the motors' torque."""
    time = 0.21
    for coordinates, rate, torque in zip(case.coordinates, case.rates, case.torques, strict=True):
        here = measure(case, coordinates, rate)
        change = case.robot.acceleration(
            case.parameters, case.load, coordinates, rate, torque, time
        )
        ahead = measure(case, coordinates + H * rate, rate + H * change)
        behind = measure(case, coordinates - H * rate, rate - H * change)
        acceleration = (ahead.velocity - behind.velocity) / (2 * H)
        model = estimate(case, here).model
        needed = model.M @ acceleration + model.Q @ here.velocity + model.gravity
        given = on_vectors(net_torque)(case.load, torque, here.velocity, time)
        assert np.abs(torque - given).max() > 0.1  # the load is felt
        assert np.allclose(needed, given, atol=1e-6)


def test_lines_end_where_numbers_are(case):
    poses = case.poses.reshape(2, -1, case.m)
    measured = [measure(case, c, np.zeros_like(c)) for c in case.coordinates]
    positions = np.array([m.position for m in measured]).reshape(2, -1, case.n)
    lines = case.robot.segments(case.parameters, poses, positions)
    assert bool(lines) == case.robot.PLANAR
    for part, ends in lines.items():
        assert ends.shape[:2] == poses.shape[:2] and ends.shape[3:] == (2, 2), part
        assert np.isfinite(ends).all()
        one = case.robot.segments(case.parameters, poses[0, 1], positions[0, 1])[part]
        assert np.allclose(ends[0, 1], one, atol=1e-15)


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_the_file_of_a_robot_is_complete(file):
    robot, values = ROBOTS[file.stem], yaml.safe_load(file.read_text())
    n = len(values['joints'])
    own = robot.validate(build(robot.Parameters, values['robot'], 'robot.', n))
    assert robot.joints(own) == n
    m = len(robot.coordinates(own))
    limits = build(robot.MotionLimits, values['trajectory'], 'trajectory.', n)
    margins = picked(robot.SafetyMargins, values['safety'], 'safety.', n)
    for key, limit in limits._asdict().items():
        if hasattr(margins, key):
            assert limit > getattr(margins, key)  # a reference keeps clear of the faults
    pose = np.array(values['plant']['initial_pose'], dtype=float)
    assert len(pose) == m
    coordinates = robot.start(own, pose)
    measured = robot.measure(own, coordinates, np.zeros_like(coordinates))
    found = robot.estimate(own, margins, measured.position, measured.velocity, pose)
    assert found.fault == FOUND
    limit = np.array(values['plant']['torque_limit'])
    assert (np.abs(found.model.gravity) < 0.5 * limit).all()
    for group in ('torque_limit', 'torque_rate', 'ramp_rate', 'damping', 'stiffness'):
        assert np.shape(values['safety'][group]) in ((), (n,)), group
    for group in ('start', 'end'):
        assert len(values.get('move', {}).get(group, [0] * m)) == m


def reference(robot, own, poses):
    still = np.zeros(poses.shape[1])
    motions = [robot.joint_motion(own, PoseMotion(pose, still, still)) for pose in poses]
    return SimpleNamespace(
        pose=poses,
        position=np.array([motion.position for motion in motions]),
        passive=np.array([motion.passive for motion in motions]),
        out_of_reach=np.array([motion.out_of_reach for motion in motions]),
    )


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_the_motion_in_the_file_of_a_robot_is_feasible(file):
    robot, values = ROBOTS[file.stem], yaml.safe_load(file.read_text())
    own = build(robot.Parameters, values['robot'], 'robot.', len(values['joints']))
    limits = build(robot.MotionLimits, values['trajectory'], 'trajectory.')
    if 'circle' in values:
        angle = np.linspace(0.0, 2 * np.pi, 200)
        circle = values['circle']['radius'] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        phi = np.full(len(angle), values['circle']['phi'])
        poses = np.column_stack([circle + values['circle']['center'], phi])
        poses = poses[:, : len(robot.coordinates(own))]
        gap = np.linalg.norm((poses[0] - values['plant']['initial_pose'])[:2])
        assert 0.002 < gap < 0.01  # m beside the start of the circle, as in the paper
    else:
        share = np.linspace(0.0, 1.0, 200)[:, np.newaxis]
        start, end = (np.array(values['move'][key]) for key in ('start', 'end'))
        poses = start + share * (end - start)
    assert robot.infeasible(own, limits, reference(robot, own, poses)) == []


def test_what_a_robot_leaves_out_has_a_default():
    robot = Robot.of(
        SimpleNamespace(PLANAR=True, Parameters=tuple, estimate='kernel', warnings=warnings)
    )
    assert (
        robot.constants('own') == 'own' and robot.planar(()) and robot.estimate_coarse == 'kernel'
    )
    assert robot.Constants is tuple is not MODULES['planar_3rrr'].Constants
    assert robot.units(()) == robot.parameter_warnings(()) == robot.margins((), ()) == ()
    assert robot.home(()) is robot.NO_POSE is robot.linear_model is robot.tree is None
    assert np.isnan(robot.pose_with((), (), ())).all() and not robot.OWN_MEMORY
    assert MODULES['planar_3rrr'].NO_POSE and MODULES['planar_3rrr'].tree is not None
