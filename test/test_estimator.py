"""The estimators of the velocity: closed forms, exactness, and that the loop needs no other."""

import numpy as np
import pytest
from assembly import simulate
from vectors import setup_of

from parallel_robot import simulate as run_scenario
from parallel_robot_control.estimation.estimator import (
    FILTER,
    LEVANT,
    Estimated,
    EstimatorParameters,
    estimated,
)
from parallel_robot_model.compiler import kernel, read_row, vector, write_row
from parallel_robot_model.configuration.fields import group

H = 1e-3  # s
T = np.arange(2001) * H


@kernel
def _estimates(estimator, state, known, positions, like, found):
    for k in range(len(positions)):
        state = estimated(estimator, state, known or k > 0, read_row(positions, k, like), H)
        write_row(found, k, state.velocity)


def estimates(kind, positions, first=None, bandwidth=20.0, acceleration=10.0):
    """Estimates of the velocity over samples of a position, which begin at rest or at `first`."""
    estimator = setup_of(kind=kind, bandwidth=bandwidth, acceleration=vector([acceleration]))
    state = Estimated(vector([positions[0]]), vector([first or 0.0]))
    rows = np.empty((len(positions), 1))
    _estimates(estimator, state, first is not None, positions[:, None], state.position, rows)
    return rows[:, 0]


def test_filter_has_the_closed_form_of_a_ramp():
    expected = 0.7 * (1.0 - np.exp(-2 * np.pi * 20.0 * T))
    assert np.abs(estimates(FILTER, 0.7 * T) - expected).max() < 1e-9


def test_filter_attenuates_as_its_bandwidth_says():
    """White noise of the positions passes with a variance of 2 (a / h)^2 / (2 - a)."""
    noise = np.random.default_rng(1).standard_normal(200_000)
    share = 1.0 - np.exp(-2 * np.pi * 20.0 * H)
    expected = np.sqrt(2.0 / (2.0 - share)) * share / H
    assert estimates(FILTER, noise).std() == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize('first', [None, -2.0, 5.0])
def test_levant_differentiates_a_ramp_exactly_after_a_finite_time(first):
    found = estimates(LEVANT, 0.3 + 0.7 * T, first)
    wrong = np.flatnonzero(np.abs(found - 0.7) > 1e-9)
    assert 0 < wrong[-1] < 1500 and np.abs(found[wrong[-1] + 1 :] - 0.7).max() < 1e-9


def test_levant_follows_any_motion_within_its_bound():
    """Of a signal whose second derivative stays below L, it lags by about a sample."""
    found = estimates(LEVANT, np.sin(3.0 * T), acceleration=10.0)
    assert np.abs(found - 3.0 * np.cos(3.0 * T))[1000:].max() < 9.0 * 1.5 * H


def test_levant_does_not_chatter():
    assert not np.ptp(estimates(LEVANT, np.full(2001, 0.4)))


def test_levant_is_robust_to_noise_within_its_known_bound():
    """The error is of the order of sqrt(L noise), with a constant of a few units."""
    noise = 1e-3 * np.random.default_rng(2).uniform(-1.0, 1.0, len(T))
    found = estimates(LEVANT, 0.7 * T + noise, 0.7, acceleration=10.0)
    assert 0.01 < np.abs(found - 0.7).max() < 5.0 * np.sqrt(10.0 * 1e-3)


@pytest.mark.parametrize('kind', ['filter', 'levant'])
def test_the_loop_needs_no_measured_velocity(kind):
    """With positions alone the robot follows about as well as with exact velocities."""
    exact = simulate('paper_circle', 3.0, {'law': 'computed_torque'}).steady_rms()
    more = {'law': 'computed_torque', 'sensor.velocity_noise': 5.0, 'estimator.kind': kind}
    blind = simulate('paper_circle', 3.0, {**more, 'safety.speed_limit': 1e3})
    assert not blind.out.fault.any()
    assert blind.steady_rms() < 1.5 * exact + 1e-5


@pytest.mark.parametrize(
    ('kind', 'velocities', 'taken'),
    [
        ('auto', False, True),  # the next law may ask for another kind
        ('none', False, True),
        ('filter', True, False),
        ('levant', True, False),
        ('kalman', True, True),
        ('kalman', False, False),
    ],
)
def test_measured_velocities_count_where_the_node_asks_for_them_alone(kind, velocities, taken):
    """The node reads states without velocities where they do not count, as zeros."""
    keys = {'estimator.kind': kind, 'estimator.velocities': velocities}
    exact, noisy = (
        run_scenario('paper_circle', duration=0.02, **keys, **{'sensor.velocity_noise': noise})
        for noise in (0.0, 0.1)
    )
    parameters = group(exact.values, EstimatorParameters, 'estimator')
    assert parameters.takes_velocities is taken
    assert np.array_equal(exact.torque, noisy.torque) is not taken
