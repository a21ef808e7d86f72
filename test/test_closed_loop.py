"""The closed loop: what the paper claims, and what makes a run trustworthy."""

import os
from pathlib import Path

import numpy as np
import pytest
from assembly import make_plant, open_loop, simulate
from geometry import PAPER_START, closure, legs
from mujoco_robot import open_loop as mujoco_open_loop
from test_s_fotsmc import ring

from parallel_robot_control.assembly import assemble
from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import initial_state, run_cycle
from parallel_robot_control.safety.limiting import When
from parallel_robot_model.compiler import entry_point, vector
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.planar_3rrr import measure
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import GUESS_OUT_OF_REACH

HEAVY = {'true_robot.m1': 1.1 * 5.12, 'true_robot.m2': 1.1 * 7.39, 'true_robot.mp': 1.1 * 3.84}


@pytest.fixture(scope='module')
def circle():
    return simulate('paper_circle')


@pytest.mark.parametrize(
    ('scenario', 'overrides', 'bound'),
    [
        ('paper_circle', {}, 10e-6),
        ('paper_circle', HEAVY, 30e-6),
        ('circle_pi12', {}, 30e-6),
        ('paper_line', {}, 30e-6),
    ],
)
def test_steady_error(scenario, overrides, bound):
    done = simulate(scenario, overrides=overrides)
    assert (
        not done.out.fault.any() and not done.out.active_limits.any() and done.out.steps == 12001
    )
    assert done.steady_rms() < bound


def test_the_start_error_is_the_papers_and_goes_away(circle):
    error = np.hypot(*(circle.out.pose - circle.reference.pose)[:, :2].T)
    assert abs(error[0] - 8.6e-3) < 5e-5
    assert error[3000:].max() < 1e-3


def test_heavier_masses_need_more_torque(circle):
    heavy = simulate(overrides=HEAVY)
    assert np.abs(heavy.out.effort - circle.out.effort)[6000:].mean() > 1e-3


def test_loops_stay_closed_for_a_minute(robot):
    out = simulate(duration=60.0).out
    gaps = closure(
        robot, out.pose[-1], out.position[-1], out.position[-1] + out.passive_position[-1]
    )
    assert out.steps == 60001 and gaps.max() < 1e-12


def test_recorded_joints_are_those_of_the_recorded_pose(robot, circle):
    theta, beta = legs(robot, circle.out.pose)
    assert np.abs(np.exp(1j * theta) - np.exp(1j * circle.out.position)).max() < 1e-12
    assert (
        np.abs(np.exp(1j * (beta - theta)) - np.exp(1j * circle.out.passive_position)).max()
        < 1e-12
    )
    for angle, rate in (('position', 'velocity'), ('passive_position', 'passive_velocity')):
        slope = np.gradient(getattr(circle.out, angle), 1e-3, axis=0)
        assert np.abs(slope - getattr(circle.out, rate))[1:-1].max() < 1e-3


def test_effort_is_the_torque_that_acted_before_the_state(circle):
    assert not circle.out.effort[0].any()
    assert np.array_equal(circle.out.effort[1:], circle.out.command[:-1])


def test_effort_is_saturated_and_the_command_is_not():
    out = simulate(duration=0.5, overrides={'plant.torque_limit': [2.0, 3.0, 4.0]}).out
    assert np.abs(out.command).max() > 4.0
    assert np.array_equal(out.effort[1:], np.clip(out.command[:-1], [-2, -3, -4], [2, 3, 4]))


@pytest.mark.parametrize('scenario', ['paper_circle', 'circle_pi12'])
def test_recorded_efforts_reproduce_the_joints_from_state_0(scenario):
    out = simulate(scenario).out
    values = config.resolve(scenario)
    robot = make_plant(values).setup.robot
    states = open_loop(values, out.effort[1:])
    position = [measure(robot, state.coordinates, state.rate).position for state in states]
    assert np.abs(np.array(position) - out.position).max() < 1e-9


def test_recorded_commands_move_mujoco_alike(robot):
    fine = {
        'friction.coulomb': [0.0] * 3,
        'plant.integrator': 'rk4',
        'plant.substeps': 10,
    }
    out = simulate(duration=1.0, overrides=fine).out
    theirs = mujoco_open_loop(robot, PAPER_START, out.command[:-1], 1e-3, [2.5] * 3)
    assert np.abs(out.pose - theirs).max() < 2e-10


def test_the_coupled_error_is_the_error_and_the_integral_of_the_coupling(circle):
    error = circle.reference.position - circle.out.position
    summed = 1e-3 * (np.cumsum(error @ ring(3), axis=0) - error @ ring(3))
    assert np.abs(circle.out.telemetry.coupled_error - (error + 0.9 * summed)).max() < 1e-12


def test_the_same_run_gives_the_same_bits(circle):
    again = simulate('paper_circle')
    for first, second in zip(circle.out[:11], again.out[:11], strict=True):
        assert np.array_equal(first, second)


def test_a_controller_without_a_pose_leaves_the_robot_damped():
    out = simulate(duration=0.1, guess=[5.0, 5.0, 0.0]).out
    assert (out.fault == GUESS_OUT_OF_REACH).all() and out.steps == 101
    assert np.array_equal(out.command, -40.0 * out.velocity)


def test_a_plant_out_of_its_workspace_ends_the_run():
    pull = {'friction.viscous': [0.0] * 3, 's_fotsmc.G': 1e7, 'plant.torque_limit': [1e4] * 3}
    pull |= {f'safety.{key}': [1e9] * 3 for key in ('torque_limit', 'torque_rate', 'speed_limit')}
    pull |= {'safety.min_sin_psi': 0.0, 'safety.min_determinant': 0.0, 'safety.action': 'zero'}
    out = simulate(duration=2.0, overrides=pull).out
    assert out.steps < 2001
    assert all(np.isfinite(rows[: out.steps]).all() for rows in out[:9])


def resident():
    """Memory of this process [bytes]."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE')


@pytest.mark.skipif(not Path('/proc/self/statm').exists(), reason='needs Linux')
def test_memory_does_not_grow_with_the_steps_of_a_run():
    for _ in range(2):
        simulate(duration=60.0)
    before = resident()
    for _ in range(4):
        assert simulate(duration=60.0).out.steps == 60001
    assert resident() - before < 4e6  # a leak of 20 bytes a step would be 5 MB


@pytest.mark.skipif(not Path('/proc/self/statm').exists(), reason='needs Linux')
def test_memory_does_not_grow_with_single_cycles(values, robot):
    control = assemble(configure(values))
    theta, still = vector(legs(robot, PAPER_START)[0]), vector(np.zeros(3))
    reference = JointReference(theta, still, still)

    when = When(0, 0.0, 1e-3)
    begin = control.setup, reference, theta, still, still, when
    cycle_alone = entry_point(run_cycle, *begin)

    def cycles(count):
        control.setup.memory.state.value = initial_state(PAPER_START, 3)
        for _ in range(count):
            cycle_alone(control.setup, reference, theta, still, still, when)

    cycles(1000)
    before = resident()
    cycles(40000)
    assert resident() - before < 2e6  # a leak of one array a cycle would be 4 MB
