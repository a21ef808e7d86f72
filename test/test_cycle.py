"""One control cycle: pose from the joints, model at the pose, law, and no torque in doubt."""

from typing import NamedTuple

import numpy as np
import pytest
from geometry import PAPER_START, PI12_START, legs
from test_s_fotsmc import ring

from parallel_robot_control import laws
from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.cycle import CYCLE_TEXT, TORQUE_NOT_FINITE, Cycle, run_cycle
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_model.dynamics import actuated_dynamics
from parallel_robot_model.kinematics import FOUND, GUESS_OUT_OF_REACH, NOT_CONVERGED


class Situation(NamedTuple):
    """A state of the robot with a reference close to it."""

    reference: JointReference
    feedback: Feedback
    guess: np.ndarray
    integral: np.ndarray

    def solve(self, law, robot, memory=None) -> Cycle:
        memory = law.memory if memory is None else memory
        return run_cycle(law.update, law.gains, robot, *self, memory, 1e-3)


@pytest.fixture
def law(values):
    return laws.prepare('s_fotsmc', values)


@pytest.fixture(params=[PAPER_START, PI12_START])
def pose(request):
    return request.param


@pytest.fixture
def situation(robot, pose):
    rng = np.random.default_rng(4)
    theta, (velocity, rate_d, acceleration_d) = legs(robot, pose)[0], rng.standard_normal((3, 3))
    return Situation(
        JointReference(theta + 0.01 * rng.standard_normal(3), rate_d, acceleration_d),
        Feedback(theta, velocity),
        pose + np.array([0.002, -0.001, 0.01]),
        np.array([0.1, 0.2, -0.3]),
    )


def test_torque_is_the_laws_at_the_true_pose(law, robot, pose, situation):
    cycle = situation.solve(law, robot)
    theta, beta = legs(robot, pose)
    model = actuated_dynamics(robot, pose[2], theta, beta, situation.feedback.velocity)
    alone = s_fotsmc.update(
        law.gains, model, situation.reference, situation.feedback, law.memory, 1e-3
    )
    assert cycle.status == FOUND and np.abs(cycle.pose - pose).max() < 1e-12
    assert np.allclose(cycle.torque, alone.torque, rtol=1e-9)
    for after, expected in zip(cycle.memory, alone.memory, strict=True):
        assert np.allclose(after, expected, rtol=1e-12, atol=1e-15)


def test_the_published_integral_is_that_of_the_coupling(law, robot, situation):
    e = situation.reference.position - situation.feedback.position
    advanced = situation.integral + 1e-3 * ring(3) @ e
    assert np.allclose(situation.solve(law, robot).integral, advanced, rtol=1e-14)


def bad_position(situation):
    position = situation.feedback.position.copy()
    position[1] = np.nan
    return situation._replace(feedback=situation.feedback._replace(position=position))


def bad_velocity(situation):
    velocity = np.array([0.0, np.inf, 0.0])
    return situation._replace(feedback=situation.feedback._replace(velocity=velocity))


def bad_reference(situation):
    nothing = np.full(3, np.nan)
    return situation._replace(reference=JointReference(nothing, nothing, nothing))


def bad_guess(situation):
    return situation._replace(guess=np.array([5.0, 5.0, 0.0]))


@pytest.mark.parametrize(
    ('spoil', 'status'),
    [
        (bad_position, NOT_CONVERGED),
        (bad_velocity, TORQUE_NOT_FINITE),
        (bad_reference, TORQUE_NOT_FINITE),
        (bad_guess, GUESS_OUT_OF_REACH),
    ],
)
def test_in_doubt_there_is_no_torque_and_nothing_is_remembered(
    law, robot, situation, spoil, status
):
    memory = situation.solve(law, robot).memory
    cycle = spoil(situation).solve(law, robot, memory)
    assert cycle.status == status and CYCLE_TEXT[cycle.status]
    assert not cycle.torque.any() and not cycle.sliding_variable.any()
    assert np.array_equal(cycle.integral, situation.integral)
    for after, before in zip(cycle.memory, memory, strict=True):
        assert np.array_equal(after, before)


def test_after_a_bad_sample_the_cycle_goes_on(law, robot, situation):
    failed = bad_position(situation).solve(law, robot)
    again = situation._replace(guess=failed.pose).solve(law, robot, failed.memory)
    assert again.status == FOUND
    assert np.array_equal(again.torque, situation.solve(law, robot).torque)
