"""The arm against MuJoCo, complex numbers, finite differences and its own energy."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from vectors import OnVectors, on_vectors

from parallel_robot.studies.identification import base_parameters
from parallel_robot_model.common.errors import InputError, KinematicsError, RobotError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import build
from parallel_robot_model.robots import serial_2r as module
from parallel_robot_model.robots.contract import FOUND, REACHED, PoseMotion, inverse_dynamics
from parallel_robot_model.robots.joint_load import (
    DisturbanceParameters,
    FrictionParameters,
    JointLoad,
)
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import robot_of

serial_2r = OnVectors(module)
ARM = serial_2r.Parameters(
    l1=0.35, l2=0.28, lc1=0.15, lc2=0.11, m1=3.0, m2=2.2, mp=0.7, I1=0.03, I2=0.015,
    gravity=9.81, elbow=1.0,
)  # fmt: skip
NO_LOAD = JointLoad(
    FrictionParameters((0.0, 0.0), (0.0, 0.0), (0.0,) * 2, 0.01, 0.0, *((0.0,) * 2,) * 2),
    DisturbanceParameters((0.0, 0.0), 0.0, (0.0, 0.0)),
)
MARGINS = serial_2r.SafetyMargins(0.1)
LIMITS = serial_2r.MotionLimits(0.2)
GUESS = np.zeros(2)
SIDES = pytest.mark.parametrize('side', [1.0, -1.0])


def rows(count, low, high, seed=0):
    return np.random.default_rng(seed).uniform(low, high, (count, 2))


def postures(side, count=30):
    """Joint angles on one side of the elbow, clear of the margin, within one turn of q1."""
    q = rows(count, [-3.0, 0.2], [3.0, 2.9])
    return q * [1.0, side]


def tip(q, robot=ARM):
    """Forward kinematics in complex numbers, shape (..., 2)."""
    q1, q2 = np.moveaxis(np.asarray(q), -1, 0)
    z = robot.l1 * np.exp(1j * q1) + robot.l2 * np.exp(1j * (q1 + q2))
    return np.stack([z.real, z.imag], axis=-1)


def solve(pose, rate=GUESS, acceleration=GUESS, robot=ARM):
    return serial_2r.joint_motion(
        robot, PoseMotion(*(np.array(x, dtype=float) for x in (pose, rate, acceleration)))
    )


def estimate(q, qd=GUESS, robot=ARM, margins=MARGINS):
    return serial_2r.estimate(robot, margins, np.array(q), np.array(qd), GUESS)


def model(q, qd, side):
    found = estimate(q, qd, ARM._replace(elbow=side))
    assert found.fault == FOUND
    return found.model


def simulated_arm(robot):
    """The arm in MuJoCo: hinges about z, gravity against y, the payload a body of its own."""
    xml = f"""
    <mujoco>
      <option gravity="0 {-robot.gravity} 0"/>
      <worldbody>
        <body>
          <joint axis="0 0 1"/>
          <inertial pos="{robot.lc1} 0 0" mass="{robot.m1}" diaginertia="{(f'{robot.I1} ' * 3)}"/>
          <body pos="{robot.l1} 0 0">
            <joint axis="0 0 1"/>
            <inertial pos="{robot.lc2} 0 0" mass="{robot.m2}"
                      diaginertia="{(f'{robot.I2} ' * 3)}"/>
            <body name="payload" pos="{robot.l2} 0 0">
              <inertial pos="0 0 0" mass="{robot.mp}" diaginertia="0 0 0"/>
            </body>
          </body>
        </body>
      </worldbody>
    </mujoco>
    """
    simulated = mujoco.MjModel.from_xml_string(xml)
    return simulated, mujoco.MjData(simulated)


@SIDES
def test_model_and_tip_agree_with_mujoco(side):
    simulated, data = simulated_arm(ARM)
    M = np.empty((2, 2))
    bias = np.empty(2)
    for q, qd in zip(postures(side), rows(30, -3.0, 3.0, 1), strict=True):
        data.qpos[:], data.qvel[:] = q, qd
        mujoco.mj_forward(simulated, data)
        mujoco.mj_fullM(simulated, data, M)
        mujoco.mj_rne(simulated, data, 0, bias)
        found = estimate(q, qd, ARM._replace(elbow=side))
        assert found.fault == FOUND
        assert np.allclose(found.model.M, M, rtol=1e-12, atol=1e-14)
        assert np.allclose(found.model.Q @ qd + found.model.gravity, bias, rtol=1e-11, atol=1e-12)
        assert np.allclose(found.pose, data.body('payload').xpos[:2], atol=1e-14)


def test_acceleration_agrees_with_mujoco_in_any_posture():
    simulated, data = simulated_arm(ARM)
    states = zip(
        rows(30, -7.0, 7.0), rows(30, -3.0, 3.0, 1), rows(30, -20.0, 20.0, 2), strict=True
    )
    for q, qd, torque in states:
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, qd, torque
        mujoco.mj_forward(simulated, data)
        ours = serial_2r.acceleration(ARM, NO_LOAD, q, qd, torque, 0.0)
        assert np.allclose(ours, data.qacc, rtol=1e-10, atol=1e-10)


def test_friction_and_disturbance_act_on_each_joint():
    friction = FrictionParameters(
        (0.5, 0.2), (0.3, 0.1), (0.0,) * 2, 0.01, 0.0, *((0.0,) * 2,) * 2
    )
    disturbance = DisturbanceParameters((1.0, 2.0), 0.5, (0.0, np.pi / 2))
    q, qd, torque = np.array([0.3, 1.2]), np.array([0.4, -0.6]), np.array([5.0, 1.0])
    # At t = 0.5 s, 2 pi 0.5 t = pi / 2: the sines are 1 and 0.
    left = torque - [0.5 * 0.4 + 0.3 + 1.0, -0.2 * 0.6 - 0.1 + 0.0]
    loaded = serial_2r.acceleration(ARM, JointLoad(friction, disturbance), q, qd, torque, 0.5)
    free = serial_2r.acceleration(ARM, NO_LOAD, q, qd, left, 0.0)
    assert np.allclose(loaded, free, rtol=1e-13)


@SIDES
def test_inertia_rate_less_twice_coriolis_is_skew(side):
    h = 1e-6
    for q, qd in zip(postures(side), rows(30, -3.0, 3.0, 1), strict=True):
        M_dot = (model(q + h * qd, qd, side).M - model(q - h * qd, qd, side).M) / (2 * h)
        skew = M_dot - 2 * model(q, qd, side).Q
        assert np.abs(skew + skew.T).max() < 1e-8 < 0.01 < np.abs(skew).max()


@SIDES
def test_torque_of_the_model_gives_the_acceleration_it_was_asked_for(side):
    wanted = np.array([2.0, -3.0])
    for q, qd in zip(postures(side), rows(30, -3.0, 3.0, 1), strict=True):
        torque = on_vectors(inverse_dynamics)(model(q, qd, side), wanted, qd)
        given = serial_2r.acceleration(ARM, NO_LOAD, q, qd, torque, 0.0)
        assert np.allclose(given, wanted, rtol=1e-10)


def energy(q, qd):
    """Of three bodies, from their places in complex numbers [J]."""
    u1, u2 = np.exp(1j * q[0]), np.exp(1j * (q[0] + q[1]))
    spin = qd[0] + qd[1]
    places = (ARM.lc1 * u1, ARM.l1 * u1 + ARM.lc2 * u2, ARM.l1 * u1 + ARM.l2 * u2)
    speeds = (
        ARM.lc1 * u1 * qd[0],
        ARM.l1 * u1 * qd[0] + ARM.lc2 * u2 * spin,
        ARM.l1 * u1 * qd[0] + ARM.l2 * u2 * spin,
    )
    total = 0.5 * ARM.I1 * qd[0] ** 2 + 0.5 * ARM.I2 * spin**2
    for mass, place, speed in zip((ARM.m1, ARM.m2, ARM.mp), places, speeds, strict=True):
        total += 0.5 * mass * abs(speed) ** 2 + mass * ARM.gravity * place.imag
    return total


def test_energy_stays_while_the_arm_swings_freely():
    def derivative(y):
        free = serial_2r.acceleration(ARM, NO_LOAD, y[:2].copy(), y[2:].copy(), np.zeros(2), 0.0)
        return np.concatenate([y[2:], free])

    h, y = 5e-4, np.array([0.3, 0.8, 0.5, -1.0])
    begin, places = energy(y[:2], y[2:]), [y[:2]]
    for _ in range(2000):
        k1 = derivative(y)
        k2 = derivative(y + h / 2 * k1)
        k3 = derivative(y + h / 2 * k2)
        k4 = derivative(y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        places.append(y[:2])
        assert abs(energy(y[:2], y[2:]) - begin) < 1e-7
    assert (np.ptp(places, axis=0) > 1.0).all()  # it swung


@SIDES
def test_inverse_kinematics_undo_forward_kinematics(side):
    robot = ARM._replace(elbow=side)
    for q in postures(side):
        joints = solve(tip(q), robot=robot)
        assert joints.out_of_reach == REACHED and joints.passive.shape == (0,)
        turns = (joints.position - q) / (2 * np.pi)
        assert np.allclose(turns, np.round(turns), atol=1e-12)
        assert np.round(turns[1]) == 0
        there = serial_2r.locate(robot, joints.position, GUESS)
        assert there.fault == FOUND and np.allclose(there.pose, tip(q), atol=1e-14)


@SIDES
def test_joint_rates_are_derivatives_of_the_inverse_kinematics(side):
    robot = ARM._replace(elbow=side)
    h = 1e-4

    def motion(t):
        """Ellipse and its derivatives."""
        s, c = np.sin(2 * t), np.cos(2 * t)
        return [0.2 + 0.1 * c, 0.3 + 0.06 * s], [-0.2 * s, 0.12 * c], [-0.4 * c, -0.24 * s]

    for t in np.linspace(0.0, 3.0, 20):
        here = solve(*motion(t), robot=robot)
        ahead, behind = (solve(*motion(t + d), robot=robot) for d in (h, -h))
        velocity = (ahead.position - behind.position) / (2 * h)
        acceleration = (ahead.velocity - behind.velocity) / (2 * h)
        assert np.allclose(here.velocity, velocity, atol=1e-6)
        assert np.allclose(here.acceleration, acceleration, atol=1e-5)
        assert np.abs(here.velocity).min() > 1e-3 and np.abs(here.acceleration).min() > 1e-3


def reference(poses, robot=ARM):
    """What `infeasible` reads of a reference."""
    motions = [solve(pose, robot=robot) for pose in poses]
    return SimpleNamespace(
        pose=np.array(poses),
        position=np.array([motion.position for motion in motions]),
        passive=np.array([motion.passive for motion in motions]),
        out_of_reach=np.array([motion.out_of_reach for motion in motions]),
    )


@SIDES
@pytest.mark.parametrize(('l1', 'l2'), [(0.35, 0.28), (0.28, 0.35), (0.3, 0.3)])
def test_around_the_shoulder_q1_jumps_only_straight_below(side, l1, l2):
    robot = ARM._replace(elbow=side, l1=l1, l2=l2, lc1=0.1, lc2=0.1)
    angles = np.linspace(-np.pi / 2 + 0.001, 3 * np.pi / 2 - 0.001, 1001)
    circle = 0.4 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    position = reference(circle, robot).position
    steps = np.diff(position, axis=0)
    assert np.allclose(steps, [np.ptp(angles) / 1000, 0.0], atol=1e-12)
    # One sample more closes the circle: the jump, and the first sample behind it.
    closed = reference([*circle, circle[0]], robot)
    failures = serial_2r.infeasible(robot, LIMITS, closed)
    assert [failure.sample for failure in failures] == [1001]
    assert 'straight below the shoulder' in failures[0].reason
    assert not serial_2r.infeasible(robot, LIMITS, reference(circle, robot))


@pytest.mark.parametrize('radius', [0.6301, 0.0699, 0.63, 0.0, np.nan])
def test_no_joints_out_of_reach(radius):
    joints = solve([radius, 0.0], [0.1, 0.0])  # the arm spans 0.07 to 0.63 m
    assert joints.out_of_reach == 0
    assert np.isnan([joints.position, joints.velocity, joints.acceleration]).all()


@pytest.mark.parametrize('radius', [0.6299, 0.0701])
def test_joints_are_found_up_to_the_ends_of_the_reach(radius):
    joints = solve([0.0, radius])
    assert joints.out_of_reach == REACHED
    assert np.allclose(tip(joints.position), [0.0, radius], atol=1e-12)


def test_a_start_out_of_reach_is_refused():
    with pytest.raises(InputError, match=r'plant\.initial_pose \[0\.5, 0\.5\] is out of reach'):
        serial_2r.start(ARM, np.array([0.5, 0.5]))
    with pytest.raises(InputError, match=r'spans 0\.07 to 0\.63 m'):
        serial_2r.start(ARM, np.array([0.01, 0.01]))


def test_the_start_has_the_tip_at_the_pose():
    q = serial_2r.start(ARM, np.array([0.3, -0.2]))
    assert np.allclose(tip(q), [0.3, -0.2], atol=1e-15) and q[1] > 0


@SIDES
def test_a_folded_elbow_is_the_wrong_working_mode(side):
    robot, q = ARM._replace(elbow=side), [0.4, -side]
    assert serial_2r.FAULTS[serial_2r.WRONG_WORKING_MODE].key == 'wrong_working_mode'
    there, found = serial_2r.locate(robot, np.array(q), GUESS), estimate(q, robot=robot)
    assert there.fault == found.fault == serial_2r.WRONG_WORKING_MODE
    assert np.allclose([there.pose, found.pose], tip(q), atol=1e-15)
    assert not found.model.M.any()


@pytest.mark.parametrize(
    ('q2', 'fault'),
    [
        (np.arcsin(0.101), FOUND),
        (np.arcsin(0.099), serial_2r.SINGULARITY),
        (np.pi - np.arcsin(0.101), FOUND),
        (np.pi - np.arcsin(0.099), serial_2r.SINGULARITY),
        (0.0, serial_2r.SINGULARITY),
        (np.nan, serial_2r.SINGULARITY),
        (2 * np.pi + 1.0, FOUND),  # whole turns do not matter
    ],
)
def test_a_stretched_or_folded_arm_is_singular(q2, fault):
    found = estimate([0.2, q2])
    assert found.fault == fault
    assert found.model.M.any() == (fault == FOUND)
    assert serial_2r.FAULTS[serial_2r.SINGULARITY].key == 'singularity'


def test_a_motion_is_refused_where_it_fails_first():
    line = [[x, 0.1] for x in np.linspace(0.3, 0.7, 41)]  # 10 mm apart
    span = np.hypot(*np.transpose(line))
    cosine = (span**2 - ARM.l1**2 - ARM.l2**2) / (2 * ARM.l1 * ARM.l2)
    singular = int(np.flatnonzero(np.sqrt(np.maximum(1 - cosine**2, 0)) < 0.2)[0])
    outside = int(np.flatnonzero(span > 0.63)[0])
    assert singular < outside
    near, far = serial_2r.infeasible(ARM, LIMITS, reference(line))
    assert (near.sample, near.part) == (singular, None)
    assert near.reason.startswith('singularity, |sin q2| = 0.1')
    assert far == (outside, None, 'out of reach (the arm spans 0.07 to 0.63 m)')
    assert serial_2r.infeasible(ARM, LIMITS, reference(line[:singular])) == []
    assert [f.sample for f in serial_2r.infeasible(ARM, LIMITS, reference(line[outside:]))] == [0]


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'l1': 0.0}, 'robot.l1 must be positive, not 0'),
        ({'m2': -1.0}, 'robot.m2 must be positive, not -1'),
        ({'I2': np.nan}, 'robot.I2 must be positive, not nan'),
        ({'lc1': 0.4}, 'robot.lc1 must lie on its link, from 0 to l1 = 0.35 m, not 0.4'),
        ({'elbow': 0.5}, r'robot.elbow must be \+1 or -1, not 0.5'),
    ],
)
def test_an_arm_that_cannot_be_built(change, message):
    with pytest.raises(RobotError, match=message):
        serial_2r.validate(ARM._replace(**change))


def test_an_arm_without_payload_or_gravity_can_be_built():
    robot = ARM._replace(mp=0.0, gravity=0.0)
    assert serial_2r.validate(robot) is robot
    assert build(serial_2r.Parameters, robot._asdict()) == robot
    assert not estimate([0.3, 1.0], robot=robot).model.gravity.any()
    with pytest.raises(InputError, match=r'robot\.mp must be at least 0 kg, not -0\.1'):
        build(serial_2r.Parameters, {**robot._asdict(), 'mp': -0.1}, 'robot.')


def test_links_reach_from_the_shoulder_to_the_tip():
    q = postures(1.0, 6).reshape(2, 3, 2)
    lines = serial_2r.segments(ARM, tip(q), q)
    assert list(lines) == ['proximal', 'distal']
    assert lines['proximal'].shape == lines['distal'].shape == (2, 3, 1, 2, 2)
    shoulder, elbow = np.moveaxis(lines['proximal'][..., 0, :, :], -2, 0)
    assert not shoulder.any()
    assert np.array_equal(lines['distal'][..., 0, 0, :], elbow)
    assert np.array_equal(lines['distal'][..., 0, 1, :], tip(q))
    assert np.allclose(np.linalg.norm(elbow, axis=-1), ARM.l1)
    assert np.allclose(np.linalg.norm(tip(q) - elbow, axis=-1), ARM.l2)


def test_an_arm_that_swings_through_its_stretched_posture_is_identified():
    """As a pendulum does: the tip is known there, on both sides."""
    robot = robot_of(config.resolve('serial_2r_circle'))
    angles = np.sin(np.linspace(0.0, 9.0, 400)[:, None] * [1.0, 1.7])
    with pytest.raises(KinematicsError, match='elbow has folded'):
        poses_of(robot, angles, GUESS)
    first, second = angles[:, 0], angles.sum(axis=1)
    tip = [
        robot.parameters.l1 * f(first) + robot.parameters.l2 * f(second) for f in (np.cos, np.sin)
    ]
    assert np.allclose(poses_of(robot, angles, GUESS, any_mode=True), np.transpose(tip))
    bent = base_parameters.find(robot, [np.abs(angles)], len(angles), GUESS)
    assert base_parameters.find(robot, [angles], len(angles), GUESS).names == bent.names
