"""Motions of shipped machines that come from descriptions, and why some are refused."""

import numpy as np
import pytest

from parallel_robot_model.common.errors import InputError, MotionError
from parallel_robot_sim.configuration import configure
from trajectory_gen import preflight
from trajectory_gen.configuration import resolve, trajectory_of

MACHINES = ['delta', 'delta_rl5', 'hexapod', 'arm6', 'five_bar']


def motion(machine, **values):
    given = {key.replace('__', '.'): value for key, value in values.items()}
    return trajectory_of(resolve(f'{machine}_circle', given))


@pytest.mark.parametrize('machine', MACHINES)
@pytest.mark.parametrize('shape', ['move', 'trapezoid', 'hold', 'pick_and_place'])
def test_machines_perform_the_shapes(machine, shape):
    made = motion(machine, trajectory__shape=shape)
    preflight.check(made, 0.002)
    times = np.linspace(0.0, made.span, 2001)
    reference = made.sample(times)
    if shape in ('move', 'pick_and_place'):  # with smooth accelerations
        slope = np.gradient(reference.position, times, axis=0)[2:-2]
        largest = np.abs(reference.velocity).max()
        np.testing.assert_allclose(slope, reference.velocity[2:-2], atol=1e-3 * largest)


@pytest.mark.parametrize('machine', MACHINES)
def test_machines_pass_through_points_of_their_joints(machine):
    made = motion(machine, trajectory__shape='move')
    joints = made.sample(made.span * np.array([0.0, 0.5, 1.0])).position
    points = np.array([joints[0], joints[1] + 0.01, joints[2], joints[0]])
    made = motion(
        machine,
        trajectory__shape='waypoints',
        waypoints__space='joints',
        waypoints__times=[0.0, 1.5, 3.0, 6.0],
        waypoints__points=points.ravel().tolist(),
        plant__initial_pose=list(made.first_pose),
    )
    preflight.check(made, 0.002)
    np.testing.assert_allclose(
        made.sample(np.array([0.0, 1.5, 3.0, 6.0])).position, points, atol=1e-9
    )


def test_a_slide_that_is_too_fast_is_told_in_metres():
    end = [0.2, 3.0, 2.0, 0.0, 0.0, 0.0]
    with pytest.raises(MotionError, match=r'joint \d: joint speed 1\.\d* m/s is above'):
        preflight.check(motion('hexapod', trajectory__shape='move', move__end=end), 0.001)


def test_joints_at_which_no_loop_closes_are_told():
    joints = [0.3, 0.3, 0.3, 4.0, 4.0, 4.0]
    with pytest.raises(InputError, match=r'waypoints\.points: at t = '):
        motion(
            'delta',
            trajectory__shape='waypoints',
            waypoints__space='joints',
            waypoints__times=[0.0, 1.0],
            waypoints__points=joints,
        )


@pytest.mark.parametrize('motors', [['arm3', 'arm2', 'arm1'], ['arm1', 'arm2']])
def test_the_true_machine_has_the_motors_of_the_nominal_one(motors):
    with pytest.raises(InputError, match=r'true_robot\.actuated must be robot\.actuated'):
        configure(resolve('delta_circle', {'true_robot.actuated': motors}))
