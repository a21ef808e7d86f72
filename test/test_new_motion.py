"""A new motion while the trajectory node runs: continuous, through its points, or refused."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from trajectory_run import Run, smooth

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from trajectory_gen import messages, preflight
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.trajectory import MotionSequence

pytest_plugins = ['ros_fixtures']

START = np.array([0.52, 0.37, 0.5 * np.pi])
CORNERS = START + 1e-3 * np.array([
    [0, 10, 0], [-10, 20, 20], [-20, 20, 0], [-30, 10, -20],
    [-30, -5, 0], [-20, -10, 30], [-10, -5, 0], [0, 0, 0],
])  # fmt: skip


def message(poses=CORNERS, step=0.2, names=('x', 'y', 'phi'), **fields):
    """Points in equal steps of time; `fields` are velocities and accelerations."""
    points = []
    for k, pose in enumerate(poses, 1):
        time = Duration(nanosec=round(k * step * 1e9) % 10**9, sec=int(k * step + 1e-9))
        rows = {name: list(map(float, values[k - 1])) for name, values in fields.items()}
        point = JointTrajectoryPoint(
            positions=list(map(float, pose)), time_from_start=time, **rows
        )
        points.append(point)
    return JointTrajectory(joint_names=list(names), points=points)


def joints(poses):
    values = {'waypoints.times': list(range(len(poses))), 'waypoints.points': np.ravel(poses)}
    shape = config.resolve('paper_circle', {**values, 'trajectory.shape': 'waypoints'})
    return trajectory_of(shape).sample(np.arange(len(poses))).position


def test_it_passes_through_the_points_without_a_jump(node):
    run = Run(node)
    run.go(300)
    run.ask(message())
    run.go(2200)
    k, *motion = heard = run.heard()
    smooth(*heard)
    text, begin = run.told
    assert text.startswith('8 points from stamp') and 300 <= begin <= 600
    at = begin + 200 * np.arange(1, 9) - k[0]
    np.testing.assert_allclose(motion[0][at], joints(CORNERS), atol=1e-9)
    assert not motion[1][at[-1] :].any() and (motion[0][at[-1] :] == motion[0][at[-1]]).all()


def test_derivatives_of_the_points_are_those_of_the_motion():
    """A quintic from each point to the next is exactly the polynomial that it was made of."""
    course = MotionSequence(trajectory_of(config.resolve('paper_circle')), 1e-3)
    t = np.array([0.5, 1.0, 1.5])
    u = t / 1.5

    def polynomial(u):
        rest = u**3 * (10 - 15 * u + 6 * u**2)
        rate, acceleration = 30 * u**2 * (1 - u) ** 2 / 1.5, 60 * u * (1 - u) * (1 - 2 * u) / 2.25
        way = np.array([-0.03, 0.01, 0.1])
        return START + np.outer(rest, way), np.outer(rate, way), np.outer(acceleration, way)

    pose, rate, acceleration = polynomial(u)
    points = messages.Points(t, pose, rate, acceleration)
    found = preflight.through(course, 400, points)
    times = np.arange(501, 1901) * 1e-3 - 0.4  # from the first point on
    sampled = found.sample(np.arange(501 + 400, 1901))
    expected = polynomial((times[400:]) / 1.5)
    for got, wanted in zip(sampled[:3], expected, strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-9)
    np.testing.assert_array_equal(found.sample([100, 400])[0], course.sample([100, 400])[0])


def test_another_one_may_come_before_the_end(node):
    run = Run(node)
    run.go(100)
    for poses in (CORNERS, CORNERS[::-1], CORNERS[:3]):
        run.ask(message(poses, 0.5))
        told, _ = run.told
        assert told.startswith(f'{len(poses)} points') and told.endswith(
            f' {0.5 * len(poses):g} s'
        )
        run.go(700)
    assert not run.node.counts
    run.go(1500)
    heard = run.heard()
    smooth(*heard)
    np.testing.assert_allclose(heard[1][-1], joints(CORNERS[1:3])[1], atol=1e-9)


def stamped():
    asked = message()
    asked.header.stamp.sec = 5
    return asked


REST = np.zeros((3, 3))
FINITE = 'points[1].positions must be finite, not [nan, 0.37, 1.5'
WRONG = {
    'far': (message([[3.0, 3.0, 0.0]]), 'motion refused at t = 0.'),
    'fast': (message(step=0.002), 'joint speed'),
    'names': (message(names=('a', 'b', 'c')), 'joint_names must be x, y, phi, not a, b, c'),
    'no names': (message(names=()), 'joint_names must be x, y, phi, not empty'),
    'twice': (message(names=('x', 'y', 'y')), 'joint_names must be x, y, phi, not x, y, y'),
    'stamped': (stamped(), 'header.stamp must be 0'),
    'none': (message([]), 'points must be 1 to 1000, not 0'),
    'many': (message([START] * 1001), 'points must be 1 to 1000, not 1001'),
    'huge': (message([START] * 20_000), 'bytes; at most 1048576 are read'),
    'still': (message(step=0.0), '[0].time_from_start = 0 s is not after the beginning at 0 s'),
    'back': (message(step=-0.5), 'is not after'),
    'not finite': (message([START, [np.nan, *START[1:]]]), FINITE),
    'short': (message([START, START[:2]]), 'points[1].positions must be 3 numbers, not 2'),
    'half': (message(velocities=CORNERS), 'positions alone, or velocities and accelerations, too'),
    'moving': (
        message(velocities=CORNERS, accelerations=CORNERS),
        'the last point must be at rest',
    ),
    'between samples': (message([START, START + 0.01], 1e-9), 'joint speed'),
    'at rest in each': (
        message([START, START + 0.02, START], 1e-3, velocities=REST, accelerations=REST),
        'joint speed',
    ),
    'broken': (serialize_message(message())[:300], 'cannot be read: ends before byte'),
    'nothing': (b'', 'a message that cannot be read: its encapsulation is empty, not that of CDR'),
}  # fmt: skip


@pytest.mark.parametrize('node', ['lockstep'], indirect=True)
def test_a_wrong_one_is_refused_in_one_line_and_changes_nothing(node, monkeypatch):
    run, lines = Run(node), []
    monkeypatch.setattr(run.node, 'get_logger', lambda: type('', (), {
        'warning': lambda _, text, **__: lines.append(text), 'info': lambda _, text: None,
    })())  # fmt: skip
    run.ask(message())
    assert 'the motion has not begun' in lines.pop()
    run.go(10)
    before = run.node._sequence
    for name, (asked, reason) in WRONG.items():
        run.ask(asked)
        assert len(lines) == 1 and reason in lines[0] and len(lines[0]) < 400, (name, lines)
        assert lines.pop().startswith('new motion refused: ') and run.node._sequence is before
    assert run.node.counts['new motions refused'] == len(WRONG) + 1


def test_whatever_bytes_come_they_are_read_or_refused():
    good, draw = serialize_message(message()), np.random.default_rng(5)
    for _ in range(2000):
        data = bytearray(good)
        for _ in range(draw.integers(1, 4)):
            data[draw.integers(len(data))] = draw.integers(256)
        try:
            points = messages.read(bytes(data[: draw.integers(len(data) + 1)]), ['x', 'y', 'phi'])
        except InputError:
            continue
        assert np.isfinite(points.pose).all() and (np.diff(points.times) > 0.0).all()
