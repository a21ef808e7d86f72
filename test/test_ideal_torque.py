"""The ideal torque: it holds a plant on its reference, and what it takes is no excess."""

import numpy as np
import pytest
from bags import metric_of_torques

from parallel_robot_control.configuration import resolve
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.ideal_torque import between_points, torque_of
from parallel_robot_sim.plant_run import Simulator

PERIOD, COUNT = 1e-3, 2000
TIME = PERIOD * np.arange(COUNT + 1)
LOADS = {
    'disturbance.noise': 0.5, 'disturbance.bandwidth': 10.0, 'disturbance.constant': 0.4,
    'disturbance.amplitude': 0.3, 'disturbance.frequency': 8.0, 'disturbance.pulse': 0.5,
    'disturbance.pulse_start': 0.7, 'disturbance.pulse_duration': 0.2, 'seed': 7,
}  # fmt: skip


def of(scenario, **changes):
    return configure(resolve(scenario, {'duration': PERIOD * COUNT, **changes}))


@pytest.mark.parametrize('loads', [{}, LOADS], ids=['alone', 'disturbed'])
@pytest.mark.parametrize('scenario', ['axes_step', 'paper_line'])
def test_it_alone_holds_a_plant_on_its_reference(scenario, loads):
    """Without feedback; dry friction aside, which has no sign at rest, where motions begin."""
    joints = len(of(scenario).loop.joints)
    changes = {**loads, 'friction.coulomb': [0.0] * joints}
    reference = of(scenario, **changes).trajectory.sample(TIME).pose
    configuration = of(scenario, **changes, **{'plant.initial_pose': reference[0].tolist()})
    torque, plant = torque_of(configuration), Simulator(configuration)
    missed = []
    for k in range(1, COUNT + 1):
        plant.advance(torque[k])
        missed.append(np.abs(plant.pose - reference[k]).max())
    assert max(missed) < 1e-4 * np.ptp(reference, axis=0).max()


def test_dry_friction_is_that_of_the_reference():
    coulomb = [0.2, 0.3, 0.4, 0.5, 0.6]
    still, rubbing = (
        torque_of(of('axes_step', **{'friction.coulomb': each})) for each in ([0.0] * 5, coulomb)
    )
    velocity = of('axes_step').trajectory.sample(TIME - 0.5 * PERIOD).velocity
    assert (rubbing - still)[1:] == pytest.approx((coulomb * np.sign(velocity))[1:])


def test_gears_resist_what_they_transmit_and_viscous_friction_is_none_of_it():
    loads = {'friction.offset': 0.4, 'friction.load': 0.3, 'disturbance.constant': 0.7}
    bare, geared = (
        torque_of(
            of('axes_step', **{'friction.viscous': 2.0, 'friction.coulomb': 0.0, **changes})
        )[1:]
        for changes in ({}, loads)
    )
    velocity = of('axes_step').trajectory.sample(TIME[1:] - 0.5 * PERIOD).velocity
    transmitted = bare - 2.0 * velocity  # a disturbance that is held acts before the gear
    expected = bare + 0.7 + 0.4 + 0.3 * np.abs(transmitted) * np.sign(velocity)
    assert geared == pytest.approx(expected)


def test_its_disturbances_are_those_of_the_seed():
    a, b, c = (torque_of(of('paper_circle', **{**LOADS, 'seed': seed})) for seed in (1, 2, 1))
    assert np.array_equal(a, c) and np.std(a - b) > 0.3


def test_between_points_a_polynomial_of_degree_5_is_itself_and_a_few_points_do():
    times, wanted = np.linspace(3.0, 7.0, 40), np.linspace(2.9, 7.1, 500)
    curve = np.polynomial.Polynomial([1.0, -2.0, 3.0, 0.5, -0.2, 0.02])
    values = np.stack([curve(times), times], axis=1)
    expected = np.stack([curve(wanted), wanted], axis=1)
    assert between_points(times, values, wanted) == pytest.approx(expected, rel=1e-11)
    line = between_points(times[[0, -1]], values[[0, -1], 1:], wanted)
    assert line[:, 0] == pytest.approx(wanted)
    smooth = between_points(times, np.sin(times)[:, np.newaxis], wanted[20:-20])
    assert smooth[:, 0] == pytest.approx(np.sin(wanted[20:-20]), abs=1e-8)


def chattering_of(torque):
    return metric_of_torques('chattering_nm', TIME, torque)


def excess(torque, ideal):
    return metric_of_torques('excess_chattering_nm', TIME, torque, ideal)


def test_what_cancels_a_disturbance_is_no_excess_and_noise_is():
    chance = np.random.default_rng(1)
    time = TIME[:, np.newaxis]
    sine = np.sin(2.0 * np.pi * 40.0 * time) * [1.0, 0.0, 0.2]
    noise = 0.1 * chance.standard_normal((COUNT + 1, 3))
    chattering = chattering_of(sine)
    assert chattering > 0.3 and chattering_of(noise) > 0.09
    assert excess(sine, sine) == pytest.approx(0.0, abs=1e-12)
    assert excess(0.4 * sine + 5.0, sine) == pytest.approx(0.0, abs=1e-12)  # does a part of it
    assert excess(0.0 * sine, sine) == 0.0  # does nothing about it
    noisy = chattering_of(noise)
    assert excess(noise, 0.0 * sine) == noisy
    assert excess(sine + noise, sine) == pytest.approx(noisy, rel=1e-3)
    assert excess(2.0 * sine, sine) == pytest.approx(chattering)  # too much
    assert excess(-sine, sine) == pytest.approx(chattering)  # the wrong way
    late = np.sin(2.0 * np.pi * 40.0 * time - 0.5 * np.pi) * [1.0, 0.0, 0.2]
    assert excess(late, sine) == pytest.approx(chattering, rel=5e-3)
    late = np.sin(2.0 * np.pi * 40.0 * time - 0.3) * [1.0, 0.0, 0.2]
    assert excess(late, sine) == pytest.approx(np.sin(0.3) * chattering, rel=1e-2)


def test_a_sine_on_an_axis_that_is_cancelled_leaves_no_excess():
    """The ideal torque of a plant with a sine disturbance, and that sine as a torque."""
    changes = {
        'trajectory.shape': 'hold', 'hold.pose': [0.0] * 5, 'plant.initial_pose': [0.0] * 5,
        'disturbance.amplitude': 0.7, 'disturbance.frequency': 30.0,
    }  # fmt: skip
    ideal = torque_of(of('axes_step', **changes))
    sine = 0.7 * np.sin(2.0 * np.pi * 30.0 * (TIME - 0.5 * PERIOD))[:, np.newaxis] * np.ones(5)
    assert chattering_of(sine) > 0.2
    assert metric_of_torques('excess_chattering_nm', TIME, sine, ideal, COUNT // 2) < 1e-9
