"""What a browser gets of a motion, against geometry and the numbers themselves."""

import numpy as np
import pytest
from geometry import PAPER_START, legs

from parallel_robot.live.frames import GAP, HEADER, Camera, Motion, MotionBuffer
from parallel_robot_control.configuration import nominal_of, resolve

MS = 10**6  # ns


@pytest.fixture
def camera(values):
    return Camera(*nominal_of(values), values['joints'], number=7)


def motion(robot, count=50, shift=5e-6):
    """A robot 5 µm beside a path of 1 mm, in x."""
    t = 1e-3 * np.arange(count)
    desired = PAPER_START + np.stack([0.02 * t, 0 * t, 0 * t], axis=1)
    actual = desired + np.array([shift, 0.0, 0.0])
    effort = np.stack([np.sin(90 * t), t, -t], axis=1)
    joints = [legs(robot, path)[0] for path in (actual, desired)]
    return Motion(t, *joints, effort, np.full_like(effort, np.nan)), desired, actual


def read(data, camera):
    length, number, time, seconds, count = HEADER.unpack_from(data)
    assert length == len(data) and number == camera.number
    numbers = np.frombuffer(data, '<f4', offset=HEADER.size).astype(float)
    curves = numbers[len(numbers) - 2 * len(camera.curves) :].reshape(-1, 2)
    path = numbers[: len(numbers) - curves.size][len(numbers) - curves.size - 4 * count :]
    posture = numbers[: len(numbers) - curves.size - 4 * count]
    return time, seconds, posture, path.reshape(-1, 4), curves


def test_a_frame_has_posture_path_and_extremes(camera, robot):
    moved, desired, actual = motion(robot)
    time, seconds, posture, path, curves = read(camera.frame(moved, 0.05), camera)
    assert time == moved.time[-1] and seconds == pytest.approx(0.05)
    np.testing.assert_allclose(posture[:4], [*desired[-1, :2], *actual[-1, :2]], atol=1e-7)
    assert camera.parts == [('proximal', 3), ('distal', 3), ('platform', 3)]
    lines = posture[4:].reshape(9, 2, 2)
    np.testing.assert_allclose(lines[:3, 1], lines[3:6, 0], atol=1e-7)  # elbows
    np.testing.assert_allclose(lines[3:6, 1], lines[6:, 0], atol=1e-7)  # corners of the platform
    rows = [20, 40, 49]  # the motion has a point each 20 ms, and the newest
    np.testing.assert_allclose(
        path, np.hstack([desired, actual][:2])[rows][:, [0, 1, 3, 4]], atol=1e-7
    )
    found = dict(zip(camera.curves, curves, strict=True))
    by = {(curve.group, curve.name): pair for curve, pair in found.items()}
    np.testing.assert_allclose(by['error', 'end effector'], 5e-6, atol=1e-11)
    sine = moved.effort[:, 0]
    assert by['torque', 'joint1'] == pytest.approx([sine.max(), sine.min()])  # as they came
    assert by['torque', 'joint2'] == pytest.approx([0.0, 0.049])
    assert np.isnan(by['ghost', 'joint3']).all()


def test_states_without_a_reference_leave_the_others_alone(camera, robot):
    moved, _, actual = motion(robot)
    moved.desired[:10] = np.nan
    _, _, posture, path, curves = read(camera.frame(moved, 0.05), camera)
    np.testing.assert_allclose(posture[2:4], actual[-1, :2], atol=1e-7)
    assert np.isfinite(path).all() and np.isfinite(curves[:7]).all()
    moved.desired[:] = np.nan
    _, _, posture, _, curves = read(camera.frame(moved, 0.05), camera)
    assert np.isnan(posture[:2]).all() and np.isfinite(posture[2:]).all()
    assert np.isnan(curves[:4]).all() and np.isfinite(curves[4:7]).all()


def test_joints_that_no_robot_can_have_leave_a_frame_without_a_picture(camera, robot):
    moved, *_ = motion(robot)
    moved.position[-1] = 1e3, -2e3, 7.0
    _, _, posture, _, curves = read(camera.frame(moved, 0.05), camera)
    assert np.isnan(posture[2:4]).all() and np.isfinite(curves[1:7]).all()


def test_a_robot_without_a_plane_has_curves_alone():
    values = resolve('axes_step')
    count = len(values['joints'])
    camera = Camera(*nominal_of(values), values['joints'])
    rows = np.zeros((4, count))
    data = camera.frame(Motion(np.arange(4.0), rows, rows + 1e-3, rows, rows), 1.0)
    *_, path, curves = read(data, camera)
    assert camera.parts == [] and not path.size and len(curves) == 3 * count
    assert curves[:count] == pytest.approx(1e-3)


def states(first, count, step=MS):
    stamps = first + step * np.arange(count)
    return stamps, tuple(np.full((count, 3), float(k)) for k in range(3))


def references(first, count, rate=2.0):
    """Position `rate` times the time since 0 [rad]."""
    stamps = first + MS * np.arange(count)
    position = np.repeat(rate * stamps[:, np.newaxis] * 1e-9, 3, axis=1)
    return stamps, (position, np.full_like(position, rate), np.zeros_like(position))


def test_states_get_the_reference_at_their_stamp():
    buffer = MotionBuffer(3)
    buffer.add_references(*references(1000 * MS, 20))
    found = buffer.add_states(*states(1000 * MS + MS // 2, 30))
    assert found.anew
    np.testing.assert_allclose(found.desired[:, 0], 2.0 * found.stamps * 1e-9, rtol=1e-12)
    found = buffer.add_states(*states(1200 * MS, 5))
    assert not found.anew and np.isnan(found.desired).all()  # its reference is too old


def test_a_torque_that_acts_later_has_the_reference_of_then():
    buffer = MotionBuffer(3, age=2 * MS)
    buffer.add_references(*references(1000 * MS, 20))
    found = buffer.add_states(*states(1000 * MS, 10))
    np.testing.assert_allclose(found.desired[:, 0], 2.0 * found.stamps * 1e-9)
    np.testing.assert_allclose(
        found.references.position[:, 0], 2.0 * (found.stamps + 2 * MS) * 1e-9
    )


@pytest.mark.parametrize('stamp', [500 * MS, 1000 * MS + 2 * GAP])
def test_after_a_jump_another_motion_begins(stamp):
    buffer = MotionBuffer(3)
    buffer.add_references(*references(1000 * MS, 20))
    buffer.add_states(*states(1000 * MS, 5))
    assert not buffer.add_states(*states(1005 * MS, 5)).anew
    before, after = ([stamps, *rows] for stamps, rows in (states(1010 * MS, 3), states(stamp, 4)))
    both = [np.concatenate(pair) for pair in zip(before, after, strict=True)]
    found = buffer.add_states(both[0], tuple(both[1:]))
    assert found.anew and found.stamps.tolist() == states(stamp, 4)[0].tolist()


def test_a_state_that_is_repeated_counts_once():
    buffer = MotionBuffer(3)
    assert buffer.add_states(*states(1000 * MS, 3, step=0)).stamps.tolist() == [1000 * MS]
    assert buffer.add_states(*states(1000 * MS, 2, step=0)) is None
    assert buffer.add_states(*states(0, 0)) is None
