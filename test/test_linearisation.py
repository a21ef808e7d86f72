"""Robots as linear systems against the equations of motion of the plant."""

import numpy as np
import pytest

import parallel_robot as pr
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import vector
from parallel_robot_sim.configuration import configure_plant
from trajectory_gen.configuration import resolve

POSES = {'paper_circle': [0.49, 0.38, 1.2], 'serial_2r_circle': None, 'axes_step': None}


def accelerations(scenario, pose, torque, push=0.0, rate=0.0):
    """Accelerations of the plant's joints by finite differences of its motion, shape (n,)."""
    plant = configure_plant(
        resolve(
            scenario,
            {'friction.coulomb': 0.0, 'disturbance.amplitude': 0.0, 'plant.initial_pose': pose},
        )
    )
    robot = plant.true_robot
    start = np.asarray(robot.module.start(robot.parameters, np.asarray(pose)))
    zero = np.zeros(len(start))
    kernel = robot.kernel(
        'acceleration', plant.joint_load, *map(vector, (start, zero, torque)), 0.0
    )
    measure = robot.kernel('measure', vector(start), vector(zero))

    def joints(coordinates):
        measured = measure(robot.constants, vector(coordinates), vector(zero))
        return np.array(measured.position)

    step = 1e-6
    columns = [
        (joints(start + d) - joints(start - d)) / (2 * step) for d in step * np.eye(len(start))
    ]
    jacobian = np.transpose(columns)
    at = start + np.linalg.solve(jacobian, np.broadcast_to(push, len(torque)))
    speed = np.linalg.solve(jacobian, np.broadcast_to(rate, len(torque)))
    words = plant.joint_load, vector(at), vector(speed), vector(torque), 0.0
    return jacobian @ np.array(kernel(robot.constants, *words))


@pytest.mark.parametrize('scenario', POSES)
def test_it_accelerates_as_the_plant_does_for_small_torques_angles_and_rates(scenario):
    values = resolve(scenario)
    pose = POSES[scenario] or list(values['plant.initial_pose'])
    plain = {'friction.coulomb': 0.0, 'disturbance.amplitude': 0.0}
    A, B, C, D = pr.linearise(scenario, pose, **plain)
    n = B.shape[1]
    hold = -np.linalg.solve(B[n:], accelerations(scenario, pose, np.zeros(n)))
    for k, unit in enumerate(1e-4 * np.eye(n)):
        near = {'rtol': 2e-3, 'atol': 1e-8 * np.abs(B).max()}
        assert np.allclose(accelerations(scenario, pose, hold + unit) / 1e-4, B[n:, k], **near)
        moved = accelerations(scenario, pose, hold, push=unit) / 1e-4
        assert np.allclose(moved, A[n:, k], rtol=2e-3, atol=1e-2)
        moving = accelerations(scenario, pose, hold, rate=unit) / 1e-4
        assert np.allclose(moving, A[n:, n + k], rtol=2e-3, atol=1e-2)
    assert (A[:n, n:] == np.eye(n)).all() and not A[:n, :n].any() and not B[:n].any()
    assert not D.any() and C.shape == (len(pose), 2 * n)


def test_a_pose_out_of_reach_is_refused():
    with pytest.raises(InputError, match=r'pose \[5, 0, 0\] is out of reach of leg 1'):
        pr.linearise('paper_circle', [5, 0, 0])
