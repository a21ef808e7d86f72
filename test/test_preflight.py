"""Motions that the robot cannot perform are refused with time, leg and reason."""

import re

import numpy as np
import pytest
from geometry import ROBOT, jacobian, legs

from parallel_robot_model.common.errors import InputError, MotionError
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.planar_3rrr import MotionLimits
from parallel_robot_sim.configuration import configure
from trajectory_gen.configuration import resolve, trajectory_of
from trajectory_gen.preflight import check
from trajectory_gen.trajectory import Trajectory

PERIOD = 1e-3  # s
FREE = {'min_sin_psi': 0.0, 'max_condition': np.inf, 'max_joint_speed': np.inf}


def move(end, phi=np.pi / 2, start=(0.52, 0.37)):
    overrides = {
        'trajectory.shape': 'line',
        'line.start': list(start),
        'line.end': list(end),
        'line.phi': phi,
        'line.duration': 1.0,
    }
    return trajectory_of(config.resolve('paper_circle', overrides))


def poses_of(motion):
    times = np.arange(1001) * PERIOD
    return times, motion.sample(times).pose


def check_with(motion, limits):
    """Check a motion with other limits than those of its configuration."""
    speed = limits['max_joint_speed']
    motion.parameters = motion.parameters._replace(max_joint_speed=speed)
    motion.limits = MotionLimits(limits['min_sin_psi'], limits['max_condition'])
    check(motion, PERIOD)


def refusal(motion, limits):
    with pytest.raises(MotionError) as caught:
        check_with(motion, limits)
    return caught.value


@pytest.mark.parametrize('scenario', config.scenarios())
def test_every_scenario_is_allowed(scenario):
    values = resolve(scenario)
    check(trajectory_of(values), values['period'])


@pytest.mark.parametrize('end', [(1.6, 0.37), (-0.6, 0.37), (0.52, -0.8), (0.52, 1.6)])
def test_out_of_reach(end):
    motion = move(end)
    times, poses = poses_of(motion)
    lost = np.isnan(legs(ROBOT, poses)[0])
    first = lost.any(axis=1).argmax()
    error = refusal(motion, FREE)
    assert (error.time, error.part) == (times[first], lost[first].argmax() + 1)
    assert f't = {times[first]:.3f} s, leg {error.part}' in str(error)
    assert 'out of reach' in str(error) and '0.2 to 1 m' in str(error)


def test_out_of_reach_at_the_very_start():
    assert refusal(move((0.5, 0.3), start=(3.0, 3.0)), FREE).time == 0.0


@pytest.mark.parametrize('end', [(1.6, 0.37), (0.52, 1.6), (0.52, -0.8)])
def test_type_1(end):
    motion = move(end)
    times, poses = poses_of(motion)
    theta, beta = legs(ROBOT, poses)
    close = np.abs(np.sin(beta - theta)) < 0.3  # NaN, out of reach, compares false
    first = close.any(axis=1).argmax()
    error = refusal(motion, FREE | {'min_sin_psi': 0.3})
    assert (error.time, error.part) == (times[first], close[first].argmax() + 1)
    assert 'type 1 singularity' in str(error)


def test_type_2():
    motion = move((0.7, 0.1), phi=-1.0)
    times, poses = poses_of(motion)
    conditions = np.array([np.linalg.cond(jacobian(ROBOT, pose)) for pose in poses])
    limit = float(np.sort(conditions)[len(conditions) // 2])
    first = (conditions > limit * (1 + 1e-9)).argmax()
    error = refusal(motion, FREE | {'max_condition': limit * (1 + 1e-9)})
    assert (error.time, error.part) == (times[first], None)
    assert 'platform: type 2 singularity' in str(error)


def test_joint_speed():
    motion = move((0.46, 0.41))
    _, poses = poses_of(motion)
    speeds = np.abs(np.gradient(legs(ROBOT, poses)[0], PERIOD, axis=0))
    fastest, leg = speeds.max(), np.unravel_index(speeds.argmax(), speeds.shape)[1] + 1
    check_with(motion, FREE | {'max_joint_speed': fastest * 1.001})
    error = refusal(motion, FREE | {'max_joint_speed': fastest * 0.999})
    assert error.part == leg and 'joint speed' in str(error)
    assert abs(error.time - 0.5) < 0.1


@pytest.mark.parametrize('key', ['min_sin_psi', 'max_condition'])
def test_limits_are_drawn_where_they_say(key):
    motion = move((0.46, 0.41))
    _, poses = poses_of(motion)
    theta, beta = legs(ROBOT, poses)
    if key == 'min_sin_psi':
        worst, outward = np.abs(np.sin(beta - theta)).min(), 1 - 1e-9
    else:
        worst, outward = max(np.linalg.cond(jacobian(ROBOT, p)) for p in poses), 1 + 1e-9
    check_with(motion, FREE | {key: worst * outward})
    refusal(motion, FREE | {key: worst / outward})


def test_the_first_failure_is_the_one_reported():
    motion = move((1.6, 0.37))
    alone = [
        refusal(motion, limits).time
        for limits in (FREE, FREE | {'min_sin_psi': 0.3}, FREE | {'max_joint_speed': 1.0})
    ]
    together = refusal(motion, FREE | {'min_sin_psi': 0.3, 'max_joint_speed': 1.0})
    assert len(set(alone)) == 3 and together.time == min(alone)


def test_a_held_pose_is_checked_too():
    values = config.resolve(
        'paper_circle', {'trajectory.shape': 'hold', 'hold.pose': [0.5, 2.0, 0.0]}
    )
    assert refusal(trajectory_of(values), FREE).time == 0.0


def test_a_speed_just_above_the_limit_has_digits_that_say_so():
    values = config.resolve('paper_circle')
    fastest = float(np.abs(trajectory_of(values).sample(np.arange(0, 6, 1e-3)).velocity).max())
    values = config.resolve('paper_circle', {'trajectory.max_joint_speed': fastest * (1 - 1e-7)})
    with pytest.raises(MotionError) as caught:
        check(trajectory_of(values), 1e-3)
    numbers = re.search(r'speed (\S+) rad/s is above trajectory.max_joint_speed, (\S+) rad/s',
                        str(caught.value))  # fmt: skip
    assert float(numbers[1]) > float(numbers[2])


def test_a_value_just_out_of_range_has_digits_that_say_so():
    with pytest.raises(InputError, match=r'period must be from 0.0001 to 0.1 s, not 0.10000001'):
        configure(config.resolve('paper_circle', {'period': 0.10000001}))


@pytest.mark.parametrize('end', [(0.56, 0.4), (1.6, 0.37)])
def test_known_samples_are_not_computed_again(end, monkeypatch):
    motion, found = move(end), []
    known = motion.sample(np.arange(1001) * PERIOD)
    for given in (None, known):
        with monkeypatch.context() as patch:
            if given is not None:
                patch.delattr(Trajectory, 'sample')
            try:
                found.append(check(motion, PERIOD, given))
            except MotionError as error:
                found.append(str(error))
    assert found[0] == found[1] and (found[0] is None) == (end[0] < 1.0)


def test_too_few_known_samples_are_not_taken():
    motion, refusals = move((1.6, 0.37)), set()
    for count in (1001, 500):
        with pytest.raises(MotionError) as caught:
            check(motion, PERIOD, motion.sample(np.arange(count) * PERIOD))
        refusals.add(str(caught.value))
    assert len(refusals) == 1
