"""The price of calm, held against a controller that runs, another solver and the limit."""

import csv

import numpy as np
import pytest
import scipy.linalg
from bags import metric_of_torques

from parallel_robot.cli.command_line import main
from parallel_robot.studies import calm
from parallel_robot.studies.limit import LinearMotion, Noise, least, linearise, noise_of
from parallel_robot_control.configuration import resolve
from parallel_robot_sim.configuration import configure

PERIOD, MASS, LATE = 1e-3, 0.5, 2
SIGMA, MEMORY = 0.4, 0.94
TOLD = Noise(*(np.array([each]) for each in (1e-5, 5e-3, SIGMA)), MEMORY, np.array([0.05]), LATE)
STAY = np.array([[1.0, PERIOD], [0.0, 1.0 - 2.0 * PERIOD]])
PUSH = np.array([[0.5 * PERIOD**2], [PERIOD]]) / MASS


@pytest.fixture(scope='module')
def mass():
    """One joint with a mass and some friction."""
    each = (STAY, PUSH, np.eye(2), np.eye(2)[:1])
    return LinearMotion(np.array([0.0, 0.4]), *(np.array([part, part]) for part in each))


@pytest.fixture(scope='module')
def point(mass):
    return calm.point_of(mass, TOLD, PERIOD, 0)


def run(K, count=6000, paths=24):
    """A controller -K x of a filter and a predictor of its own: its error and its chattering."""
    chance = np.random.default_rng(2)
    F = np.block([[STAY, PUSH], [np.zeros((1, 2)), MEMORY * np.ones((1, 1))]])
    G, C = np.vstack((PUSH, [[0.0]])), np.eye(3)[:2]
    V = np.diag([1e-10, 2.5e-5])
    W = np.diag([0.0, 0.0, (1.0 - MEMORY**2) * SIGMA**2])
    W[:2, :2] = 0.05**2 * PUSH @ PUSH.T
    P = scipy.linalg.solve_discrete_are(F.T, C.T, W, V)
    L = P @ C.T @ np.linalg.inv(C @ P @ C.T + V)
    state, guess, last = (np.zeros((rows, paths)) for rows in (3, 3, 20))
    torques, motors, errors = np.zeros((3, count, paths))
    guesses = np.zeros((count, 3, paths))
    scales = np.array([1e-5, 5e-3, 0.05, np.sqrt(1.0 - MEMORY**2) * SIGMA])
    draws = chance.standard_normal((count, 4, paths)) * scales[:, np.newaxis]
    for k in range(count):
        guess = guess + L @ (state[:2] + draws[k, :2] - C @ guess)
        guesses[k] = guess
        if k >= LATE:  # the torque of now follows from what was measured LATE samples ago
            ahead = guesses[k - LATE]
            for j in range(k - LATE, k):
                ahead = F @ ahead + G * torques[j]
            torques[k] = -(K @ np.concatenate((ahead, last)))[0]
        errors[k], motors[k] = state[0], torques[k] + draws[k, 2]
        guess = F @ guess + G * torques[k]
        state = F @ state + G * motors[k]
        state[2] += draws[k, 3]
        last = np.concatenate((torques[k : k + 1], last[:-1]))
    part = slice(count // 6, None)
    rough = metric_of_torques('chattering_nm', PERIOD * np.arange(count), motors, first=count // 6)
    return np.sqrt(np.mean(errors[part] ** 2)), rough


@pytest.mark.parametrize('weight', [1e-8, 1e-10])
def test_a_controller_that_runs_has_its_error_and_its_chattering(weight, point):
    error, chattering = np.sqrt(calm.variances(point, weight))
    found = run(calm.feedback(point, weight))
    assert found == pytest.approx((error, chattering), rel=0.01)
    assert chattering > 0.05


def test_the_gain_is_that_of_another_solver(point):
    weight = 1e-9
    scale = 1e12  # else that solver calls it singular
    Q = point.error.T @ point.error + point.rest.T @ point.rest
    Q = scale * (Q + weight * point.rough.T @ point.rough)
    R, S = scale * weight * point.now**2 * np.eye(1), scale * weight * point.now * point.rough.T
    X = scipy.linalg.solve_discrete_are(point.transition, point.torque, Q, R, s=S)
    B = point.torque
    expected = np.linalg.solve(R + B.T @ X @ B, B.T @ X @ point.transition + S.T)
    assert calm.feedback(point, weight) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_no_gain_is_better_than_the_best(point):
    """Gains a little off cost more: the front is one."""
    chance, weight = np.random.default_rng(3), 1e-9
    best = calm.feedback(point, weight)

    def cost(K):
        loop = point.transition - point.torque @ K
        Z = scipy.linalg.solve_discrete_lyapunov(loop, point.fresh)
        told, rest = point.rough - point.now * K, point.rest
        return np.trace(point.error @ Z @ point.error.T) + np.trace(
            rest @ Z @ rest.T + weight * told @ Z @ told.T
        )

    for _ in range(5):
        assert cost(best * (1.0 + 0.02 * chance.standard_normal(best.shape))) > cost(best)


def test_without_calm_there_is_the_limit_and_calm_costs():
    changes = {
        'duration': 0.2, 'sensor.position_noise': 5e-6, 'sensor.velocity_noise': 5e-3,
        'sensor.delay': 2e-3, 'disturbance.noise': 0.5, 'disturbance.bandwidth': 10.0,
    }  # fmt: skip
    configuration = configure(resolve('paper_circle', changes))
    motion, told = linearise(configuration), noise_of(configuration.imperfections, PERIOD, 3)
    found, limit = calm.price_of_calm(motion, told, PERIOD), least(motion, told, PERIOD)
    assert (np.diff(found.chattering) > 0.0).all() and (np.diff(found.error) < 0.0).all()
    assert limit < found.error[-1] < 1.15 * limit
    assert found.at(found.chattering[3]) == pytest.approx(found.error[3])
    assert found.at(1e3) == pytest.approx(found.error[-1]) and np.isnan(found.at(1e-6))
    assert 5e-6 < found.at(0.3) < 16e-6  # less than a scalar model with other weights has


def test_a_period_without_chattering_has_no_price(capsys):
    assert main(['limit', 'paper_circle', '--calm', '--set', 'period=0.02']) == 2
    assert 'no price of calm with a period of 0.02 s' in capsys.readouterr().err
    assert main(['limit', 'paper_circle', '--set', 'period=0.02', '--duration', '1']) == 0


def test_the_command_tells_and_draws_it(tmp_path, capsys):
    out, figure = tmp_path / 'limit.csv', tmp_path / 'calm.png'
    words = ['--runs', '2', '--out', str(out), '--figure', str(figure)]
    assert main(['limit', 'robustness', *words]) == 0
    shown = capsys.readouterr().out
    assert 'with a chattering of at most [N m]; 2 robots with noise' in shown
    rows = [*csv.DictReader(out.open())]
    medians = {words[0]: words[1] for words in map(str.split, shown.splitlines()) if words}
    for level in ('0.2', '0.5', '2'):
        median = np.median([float(row[f'at_{level}_nm_m']) for row in rows])
        assert float(medians[level]) == pytest.approx(1e6 * median, rel=1e-3)  # in µm
    for row in rows:
        errors = [float(row[f'at_{level}_nm_m']) for level in ('0.2', '0.5', '2')]
        assert errors == sorted(errors, reverse=True) and errors[-1] > float(row['as_it_is_m'])
    assert figure.read_bytes().startswith(b'\x89PNG')
    assert main(['limit', 'robustness', '--figure', str(tmp_path / 'calm.doc')]) == 2
    assert 'picture format' in capsys.readouterr().err
    words = ['limit', 'paper_circle', '--duration', '1', '--calm', '--set']
    assert main([*words, 'sensor.position_noise=1e-4']) == 0  # the start is known
    assert 'the limit is zero, calm costs nothing' in capsys.readouterr().out
    assert main([*words, 'disturbance.noise=0.5']) == 0
    assert 'costs nothing' not in capsys.readouterr().out


def test_a_rotation_that_is_held_costs_error_and_its_weight_is_a_share(capsys):
    """Of the paper's robot: less error at the same chattering where the platform may turn."""
    noise = {'disturbance.noise': 0.5, 'sensor.position_noise': 1e-5, 'duration': 0.5}
    configuration = configure(resolve('paper_circle', noise))
    told = noise_of(configuration.imperfections, PERIOD, 3)
    motion = linearise(configuration)
    free, held = (calm.price_of_calm(motion, told, PERIOD, rest).at(0.3) for rest in (1e-4, 1.0))
    assert 1.05 * free < held < 2.0 * free
    assert main(['limit', 'paper_circle', '--calm', '--rest', '0']) == 2
    assert '--rest must be above 0 and at most 1, not 0' in capsys.readouterr().err
