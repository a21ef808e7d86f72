"""One control cycle: pose from the joints, model at the pose, law, and no torque in doubt."""

from typing import NamedTuple

import numpy as np
import pytest
from assembly import FAULTS
from geometry import PAPER_START, PI12_START, legs
from vectors import boxed, on_vectors

from parallel_robot_control.assembly import assemble
from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.cycle import Cycle, CycleState, initial_state, run_cycle
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.safety.faults import NONE, SPEED, TORQUE_NOT_FINITE
from parallel_robot_control.safety.limiting import When
from parallel_robot_model.compiler import as_vectors, vector
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_model.robots.planar_3rrr.dynamics import actuated_dynamics
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import (
    GUESS_OUT_OF_REACH,
    NOT_CONVERGED,
)
from parallel_robot_model.robots.planar_3rrr.kinematics import posture_at


class Situation(NamedTuple):
    """A state of the robot with a reference close to it, and what a cycle remembers."""

    reference: JointReference
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    state: CycleState

    def solve(self, control) -> Cycle:
        control.setup.memory.state.value = self.state
        return run_cycle(control.setup, *as_vectors(tuple(self[:-1])), When(0, 0.0, 1e-3))


@pytest.fixture
def control(values):
    return assemble(configure(values))


@pytest.fixture(params=[PAPER_START, PI12_START])
def pose(request):
    return request.param


@pytest.fixture
def situation(robot, pose):
    rng = np.random.default_rng(4)
    theta, (velocity, rate_d, acceleration_d) = legs(robot, pose)[0], rng.standard_normal((3, 3))
    return Situation(
        JointReference(theta + 0.01 * rng.standard_normal(3), rate_d, acceleration_d),
        theta,
        velocity,
        np.zeros(3),
        initial_state(pose + np.array([0.002, -0.001, 0.01]), 3),
    )


def test_torque_is_the_laws_at_the_true_pose(control, robot, pose, situation):
    law, cycle = control.law, situation.solve(control)
    theta = legs(robot, pose)[0]
    own = boxed(planar_3rrr, robot)
    posture = posture_at(own, vector(pose))
    model = actuated_dynamics(own, posture, vector(situation.velocity))
    feedback = Feedback(theta, situation.velocity, *np.zeros((2, 3)))
    given = (law.gains, model, situation.reference, feedback, law.memory.first, 1e-3)
    alone = on_vectors(s_fotsmc.update)(*given)
    assert (
        control.setup.memory.state.fault == NONE
        and np.abs(control.setup.memory.state.pose - pose).max() < 1e-12
    )
    assert np.allclose(cycle.torque, alone.torque, rtol=1e-9)
    for after, expected in zip(law.memory.current, alone.memory, strict=True):
        assert np.allclose(after, expected, rtol=1e-12, atol=1e-15)


def bad_position(situation):
    position = situation.position.copy()
    position[1] = np.nan
    return situation._replace(position=position)


def bad_velocity(situation):
    return situation._replace(velocity=np.array([0.0, np.inf, 0.0]))


def bad_reference(situation):
    nothing = np.full(3, np.nan)
    return situation._replace(reference=JointReference(nothing, nothing, nothing))


def bad_guess(situation):
    return situation._replace(state=initial_state(np.array([5.0, 5.0, 0.0]), 3))


@pytest.mark.parametrize(
    ('spoil', 'fault'),
    [
        (bad_position, NOT_CONVERGED),
        (bad_velocity, SPEED),
        (bad_reference, TORQUE_NOT_FINITE),
        (bad_guess, GUESS_OUT_OF_REACH),
    ],
)
def test_in_doubt_the_action_is_safe_and_the_law_remembers_nothing(
    control, situation, spoil, fault
):
    situation.solve(control)
    memory, spoilt = control.law.memory.current, spoil(situation)
    cycle = spoilt.solve(control)
    assert control.setup.memory.state.fault == fault and FAULTS[fault].text
    damped = np.where(np.isfinite(spoilt.velocity), -40.0 * spoilt.velocity, 0.0)
    assert np.array_equal(cycle.torque, np.clip(damped, -200.0, 200.0))
    assert not cycle.telemetry.sliding_variable.any()
    for after, before in zip(control.law.memory.current, memory, strict=True):
        assert np.array_equal(after, before)


def test_a_fault_stays_when_its_cause_is_gone(control, situation):
    bad_velocity(situation).solve(control)
    moved = situation.position + 1e-3 * situation.velocity
    again = situation._replace(position=moved, state=control.setup.memory.state.value).solve(
        control
    )
    assert control.setup.memory.state.fault == SPEED
    assert np.allclose(again.torque, np.clip(-40.0 * situation.velocity, -200.0, 200.0))
