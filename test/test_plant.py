"""The plant against MuJoCo, energy balances and its own finer steps."""

import numpy as np
import pytest
from assembly import make_plant, open_loop
from geometry import PAPER_START, PI12_START, closure, kinetic_energy, legs, wrap
from mujoco_robot import open_loop as mujoco_open_loop
from vectors import OnVectors, on_vectors

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import as_vectors
from parallel_robot_model.configuration import config
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_sim import plant

measure = OnVectors(planar_3rrr).measure
FREE = {'friction.viscous': [0.0] * 3, 'friction.coulomb': [0.0] * 3}
FINE = {'plant.integrator': 'rk4', 'plant.substeps': 10}


def resolve(start=PAPER_START, **overrides):
    keys = {key.replace('__', '.'): value for key, value in overrides.items()}
    initial = {'plant.initial_pose': [float(x) for x in start]}
    return config.resolve('paper_circle', {**FREE, **FINE, **initial, **keys})


def sines(amplitude, count=1000, period=1e-3):
    t = np.arange(count)[:, None] * period
    return amplitude * np.sin(2 * np.pi * np.array([1.0, 1.5, 2.0]) * t + [0.0, 1.0, 2.0])


def poses_of(states):
    return np.array([state.coordinates for state in states])


@pytest.mark.parametrize('viscous', [[0.0, 0.0, 0.0], [2.5, 2.0, 3.0]])
@pytest.mark.parametrize(('start', 'amplitude'), [(PAPER_START, 3.0), (PI12_START, 1.0)])
def test_one_second_of_torques_agrees_with_mujoco(robot, start, amplitude, viscous):
    torques = sines(amplitude)
    ours = poses_of(open_loop(resolve(start, friction__viscous=viscous), torques))
    theirs = mujoco_open_loop(robot, start, torques, 1e-3, viscous)
    assert np.ptp(ours, axis=0).max() > 0.03  # it moved
    assert np.abs(ours - theirs).max() < 2e-10


def test_an_uneven_robot_agrees_with_mujoco(robot):
    changes = {'l1': 0.45, 'lc1': 0.1, 'lc2': 0.5, 'm1': 3.0, 'mp': 6.0, 'I2': 0.1, 'Ip': 0.2}
    values = resolve(**{f'true_robot__{key}': value for key, value in changes.items()})
    torques = sines(2.0, 500)
    theirs = mujoco_open_loop(robot._replace(**changes), PAPER_START, torques, 1e-3)
    assert np.abs(poses_of(open_loop(values, torques)) - theirs).max() < 2e-10


def motion(values, state, torque, period, count):
    """States under one torque."""
    setup = make_plant(values).setup
    states = [state]
    for _ in range(count):
        states.append(on_vectors(plant.step)(setup, states[-1], torque, period))
    return states


def moving(rate, start=PAPER_START):
    return as_vectors(plant.PlantState(start, np.array(rate), np.zeros(3), 0.0))


def test_energy_stays_without_torque_and_friction(robot):
    states = motion(resolve(), moving([0.1, -0.15, 0.5]), np.zeros(3), 1e-3, 1000)
    energy = [kinetic_energy(robot, state.coordinates, state.rate) for state in states[::50]]
    assert energy[0] > 0.1 and np.ptp([state.coordinates for state in states], axis=0).max() > 0.05
    assert np.ptp(energy) < 1e-8 * energy[0]


@pytest.mark.parametrize('rate', [[0.1, -0.2, 0.5], [-0.2, 0.2, -1.0]])
def test_power_balance(robot, rate):
    """Motor power less friction power is the rate of the kinetic energy."""
    values = resolve(friction__viscous=[2.5, 2.0, 3.0], friction__coulomb=[0.5, 0.3, 0.4])
    torque, h = np.array([3.0, -2.0, 1.0]), 1e-4
    states = motion(values, moving(rate), torque, h, 100)
    energy = np.array([kinetic_energy(robot, s.coordinates, s.rate) for s in states])
    gained = (energy[2:] - energy[:-2]) / (2 * h)
    poses = poses_of(states)
    theta_dot = wrap(np.gradient(legs(robot, poses)[0], h, axis=0)[1:-1])
    assert (np.abs(theta_dot) > 0.01).all()  # no reversal
    lost = np.array([2.5, 2.0, 3.0]) * theta_dot + np.array([0.5, 0.3, 0.4]) * np.sign(theta_dot)
    power = ((torque - lost) * theta_dot).sum(axis=1)
    assert np.abs(gained - power).max() < 1e-4 < 1e-3 * np.abs(power).max()


@pytest.mark.parametrize(('integrator', 'order'), [('ode3', 3), ('rk4', 4)])
def test_order_of_the_plant_by_step_halving(integrator, order):
    torque, start = np.array([10.0, -10.0, 5.0]), moving([0.2, -0.3, 1.0])

    def end(substeps, integrator=integrator):
        values = resolve(plant__integrator=integrator, plant__substeps=substeps)
        return np.concatenate(motion(values, start, torque, 0.2, 1)[-1][:2])

    exact = end(1000, 'rk4')
    errors = [np.abs(end(n) - exact).max() for n in (10, 20, 40, 80)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert abs(orders[-1] - order) < 0.15


@pytest.mark.parametrize('integrator', ['ode3', 'rk4'])
def test_substeps_are_shorter_steps_under_one_torque(integrator):
    torque, start = np.array([3.0, -2.0, 1.0]), moving([0.1, -0.2, 0.5])
    in_one = motion(
        resolve(plant__integrator=integrator, plant__substeps=4), start, torque, 4e-3, 1
    )
    single = motion(
        resolve(plant__integrator=integrator, plant__substeps=1), start, torque, 1e-3, 4
    )
    assert np.allclose(in_one[-1].coordinates, single[-1].coordinates, rtol=1e-15)
    assert np.allclose(in_one[-1].rate, single[-1].rate, rtol=1e-14)


def test_motors_saturate():
    limits = [1.0, 2.0, 3.0]
    values = resolve(plant__torque_limit=limits)
    asked, given = np.array([5.0, -5.0, 2.5]), np.array([1.0, -2.0, 2.5])
    saturated, plain = (open_loop(v, [t])[-1] for v, t in ((values, asked), (resolve(), given)))
    assert np.array_equal(saturated.torque, given)
    assert np.array_equal(saturated.rate, plain.rate)


def test_a_torque_that_is_no_number_does_not_pass_unseen():
    state = open_loop(resolve(), np.array([[np.nan, 0.0, 0.0]]))[-1]
    assert np.isnan(state.rate).any()


def test_the_start_is_at_rest_at_the_initial_pose():
    state = make_plant(resolve(PI12_START)).state
    assert np.array_equal(state.coordinates, PI12_START)
    assert not state.rate.any() and not state.torque.any()


@pytest.mark.parametrize(
    ('pose', 'leg'), [([1.5, 0.2, 0.0], 1), ([-0.3, 0.6, 0.0], 2), ([0.5, -0.5, 0.0], 3)]
)
def test_an_initial_pose_out_of_reach_names_the_leg(pose, leg):
    with pytest.raises(InputError, match=f'out of reach of leg {leg}.* 0.2 to 1 m'):
        make_plant(resolve(pose))


def test_a_robot_torn_out_of_its_workspace_is_not_finite(robot):
    states = open_loop(resolve(), np.tile([150.0, 150.0, 150.0], (1000, 1)))
    last = measure(robot, states[-1].coordinates, states[-1].rate)
    assert not np.isfinite(last.velocity).all()


def test_measured_joints_close_the_loops_and_their_rates_are_derivatives(robot):
    pose, rate, h = PI12_START, np.array([0.3, -0.2, 0.7]), 1e-5

    def at(p):
        return measure(robot, p, rate)

    here, ahead, behind = at(pose), at(pose + h * rate), at(pose - h * rate)
    assert closure(robot, pose, here.position, here.position + here.passive_position).max() < 1e-14
    assert np.abs(here.velocity - (ahead.position - behind.position) / (2 * h)).max() < 1e-7
    passive = (ahead.passive_position - behind.passive_position) / (2 * h)
    assert np.abs(here.passive_velocity - passive).max() < 1e-7
    assert (np.abs(here.passive_position) <= np.pi).all()
    assert np.array_equal(here.pose, pose)
