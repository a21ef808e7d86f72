"""The Kalman filter against one written with matrices, and what it is for: states that are old."""

import numpy as np
import pytest
from assembly import simulate
from scipy.linalg import expm
from vectors import setup_of

from parallel_robot_control.assembly import assemble
from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.estimation import kalman, recent_torques
from parallel_robot_control.estimation.estimator import EstimatorParameters
from parallel_robot_control.estimation.kalman import AT_REST, DRIFT, SMOOTH
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import (
    Boxed,
    Struct,
    as_constants,
    kernel,
    read_row,
    vector,
    write_row,
    zeros_of,
)
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import build
from parallel_robot_model.robots.contract import Model

T = 1e-3
COUNT, N = 120, 2
DISTURBANCE, BANDWIDTH = np.array([0.3, 0.2]), 40.0
NOISE = np.array([5e-6, 2e-6]), np.array([5e-3, 1e-2])
OFFSET, COULOMB = np.array([1.0, 0.7]), np.array([0.5, 0.4])
M = np.array([[1.5, -0.3], [-0.3, 0.9]])
Q = np.array([[0.2, -0.1], [0.4, 0.1]])
GRAVITY = np.array([2.0, -1.0])
ZERO = vector(np.zeros(N))


@kernel
def _run(setup, model, motion, measured, torques, lates, dts, like, answers):
    for k in range(len(lates)):
        reference = JointReference(
            read_row(motion, 3 * k, like),
            read_row(motion, 3 * k + 1, like),
            read_row(motion, 3 * k + 2, like),
        )
        position, velocity = read_row(measured, 2 * k, like), read_row(measured, 2 * k + 1, like)
        zero = 0.0 * like
        found = kalman.predicted(
            setup, model, reference, position, velocity, zero, zero, k > 0, k, lates[k], dts[k]
        )
        recent_torques.record(setup, k, read_row(torques, k, like), 0.0 * like, True)
        write_row(answers, 3 * k, found.position)
        write_row(answers, 3 * k + 1, found.velocity)
        write_row(answers, 3 * k + 2, found.disturbance)


class Filter:
    """The same filter of all joints with matrices: state (q, v, w, c, f), each of N joints."""

    def __init__(self, position, velocity, velocities):
        self.x = np.concatenate([position, velocity, np.zeros(3 * N)])
        self.P = np.diag(
            np.concatenate([NOISE[0] ** 2, [AT_REST] * N, DISTURBANCE**2, OFFSET**2, COULOMB**2])
        )
        self.rows = 2 * N if velocities else N

    def advance(self, h, sign, torque):
        part = [self.x[i * N : (i + 1) * N] for i in range(5)]
        load = Q @ part[1] + GRAVITY + part[2] + part[3] + sign * part[4]
        acceleration = np.linalg.solve(M, torque - load)
        self.x[:N] += h * part[1] + h * h / 2 * acceleration
        self.x[N : 2 * N] += h * acceleration
        decay = 1.0 / (1.0 + h * BANDWIDTH)
        self.x[2 * N : 3 * N] *= decay
        A, one, mobility = np.eye(5 * N), np.eye(N), np.diag(1.0 / np.diag(M))
        A[:N, N : 2 * N] = h * one
        for i, factor in ((2, one), (3, one), (4, np.diag(sign))):
            A[N : 2 * N, i * N : (i + 1) * N] = -h * mobility @ factor
        A[2 * N : 3 * N, 2 * N : 3 * N] = decay * one
        new = [(1.0 - decay**2) * DISTURBANCE**2, h * DRIFT * OFFSET**2, h * DRIFT * COULOMB**2]
        self.P = A @ self.P @ A.T + np.diag(np.concatenate([np.zeros(2 * N), *new]))

    def measure(self, position, velocity):
        y = np.concatenate([position, velocity])[: self.rows]
        R = np.diag(np.concatenate(NOISE)[: self.rows] ** 2)
        K = self.P[:, : self.rows] @ np.linalg.inv(self.P[: self.rows, : self.rows] + R)
        self.x = self.x + K @ (y - self.x[: self.rows])
        self.P = self.P - K @ self.P[: self.rows]

    def predicted(self, steps):
        later = Filter.__new__(Filter)
        later.x, later.P = self.x.copy(), self.P
        for h, sign, torque in steps:
            later.advance(h, sign, torque)
        return later.x


def motion_of(k):
    t, w = k * T, 25.0
    both = np.array([0.3, -0.2])
    return both * np.sin(w * t), both * w * np.cos(w * t), -both * w * w * np.sin(w * t)


def filter_of(velocities=True, command_delay=0.0, lag=0.0):
    given = {
        'kind': 'kalman', 'zero_angle': 0.0, 'bandwidth': 1.0, 'acceleration': 1.0, 'delay': 0.0,
        'command_delay': command_delay, 'lag': lag, 'velocities': velocities,
        'position_noise': NOISE[0], 'velocity_noise': NOISE[1], 'disturbance': DISTURBANCE,
        'disturbance_bandwidth': BANDWIDTH / (2.0 * np.pi), 'offset': OFFSET, 'coulomb': COULOMB,
        'levels': 0.0,
    }  # fmt: skip
    parameters = Boxed(as_constants(build(EstimatorParameters, given, joints=N)))
    torques, means = recent_torques.recent_torques(ZERO), zeros_of(kalman.KalmanMemory, ZERO)
    memory = setup_of(torques=torques, kalman=Struct(means))
    return setup_of(estimator=parameters, memory=memory, period=T)


def found(setup, measured, torques, lates, dts):
    motion = np.concatenate([np.array(motion_of(k)) for k in range(len(lates))])
    answers = np.empty((3 * len(lates), N))
    model = Model(vector(M), vector(Q), vector(GRAVITY))
    like = vector(np.zeros(N))
    _run(setup, model, motion, measured, torques, lates, dts, like, answers)
    return answers.reshape(-1, 3, N)


def driven(torque, before, h, lag):
    """Mean torque over h of motors with a lag, and that at its end, by the exponential."""
    if lag == 0.0:
        return torque, torque
    step = expm(h * np.array([[-1.0 / lag, 0.0, 1.0 / lag], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    end, total, _ = step @ np.array([before, np.zeros(N), torque])
    return total / h, end


@pytest.mark.parametrize(
    ('late', 'velocities', 'command_delay', 'lag'),
    [(0, True, 0, 0.0), (3, True, 0, 0.0), (5, False, 2, 0.0), (4, True, 1, 3.3 * T)],
)
def test_filter_and_prediction_are_those_of_the_matrices(late, velocities, command_delay, lag):
    rng = np.random.default_rng(3)
    torques, measured = rng.standard_normal((COUNT, N)), rng.standard_normal((2 * COUNT, N)) * 0.1
    delay = command_delay * T
    lates = np.full(COUNT, late * T + delay)
    dts = np.full(COUNT, T)
    answers = found(filter_of(velocities, delay, lag), measured, torques, lates, dts)
    acting, ends = [], [np.zeros(N)]  # of the motors
    for torque in torques:
        for part, new in zip((acting, ends), driven(torque, ends[-1], T, lag), strict=True):
            part.append(new)

    def steps(k, first, last):
        """From `first` to `last` samples before the torque of sample k begins to act; the lag."""
        _, rate, acceleration = motion_of(k)
        for back in range(first, last, -1):
            sign = np.clip((rate + (delay - back * T) * acceleration) / SMOOTH, -1.0, 1.0)
            yield T, sign, acting[k - back] if k >= back else np.zeros(N)
        if last == 0 and lag > 0.0:
            sign = np.clip((rate + (delay + lag) * acceleration) / SMOOTH, -1.0, 1.0)
            newest = torques[k - 1] if k else np.zeros(N)
            yield lag, sign, driven(newest, ends[k], lag, lag)[0]

    whole = late + command_delay
    for k in range(COUNT):
        position, velocity = measured[2 * k], measured[2 * k + 1]
        if k == 0:
            dense = Filter(position, velocity * velocities, velocities)
        else:
            for step in steps(k, whole + 1, whole):
                dense.advance(*step)
            dense.measure(position, velocity)
        x = dense.predicted(steps(k, whole, 0)).reshape(5, N)
        _, rate, acceleration = motion_of(k)
        sign = np.clip((rate + (delay + lag) * acceleration) / SMOOTH, -1.0, 1.0)
        wanted = x[0], x[1], x[2] + x[3] + sign * x[4]
        assert np.allclose(answers[k], wanted, rtol=1e-7, atol=1e-9), k


def test_time_is_cut_where_the_torque_changes_wherever_the_states_were_measured():
    """The course of two joints under two torques, each for a period, from rest."""
    push = np.array([[2.0, -1.0], [-1.0, 3.0], [0.0, 0.0]])
    first, second = np.linalg.solve(M, push[0]), np.linalg.solve(M, push[1])

    def course(t):
        early, late = min(t, T), max(t - T, 0.0)
        rate = early * first + late * second
        return early * first * (early / 2 + late) + late * late / 2 * second, rate

    times = np.array([0.0, 0.0001, 0.0003])  # s, of the measurements; torques act at k T
    measured = np.array([part for t in times for part in course(t)])
    lates, dts = T * np.arange(3) - times, np.diff(times, prepend=-T)
    answers = found(filter_of(), measured, push + GRAVITY, lates, dts)
    assert np.allclose(answers[2, :2], course(2 * T), rtol=2e-3)


LABORATORY = {
    'sensor.stamp': 'measured',
    'sensor.position_noise': 5e-6,
    'sensor.velocity_noise': 5e-3,
    'disturbance.constant': [0.5, -0.5, 0.3],
    'disturbance.noise': 0.5,
    'disturbance.bandwidth': 10.0,
    'approach.duration': 0.4,
    'seed': 5,
}


@pytest.mark.parametrize('law', ['observer_s_fotsmc', 'lqg_tracking'])
def test_an_old_state_costs_little_where_its_age_is_known(law):
    def error(**changes):
        keys = {key.replace('__', '.'): value for key, value in changes.items()}
        return simulate(overrides={'law': law, **LABORATORY, **keys}).steady_rms()

    fresh, old = error(), error(sensor__delay=0.004)
    assert fresh < 20e-6
    assert old < 3.0 * fresh < error(sensor__delay=0.004, sensor__stamp='sent')
    told = {'sensor__delay': 0.004, 'sensor__stamp': 'sent', 'estimator__delay': 0.004}
    assert error(**told) == old  # the same age, told by a parameter


def test_commands_that_act_late_are_predicted_too():
    def error(known):
        late = {'actuator.delay': 0.006, 'estimator.command_delay': known}
        return simulate(overrides={'law': 'lqg_tracking', **LABORATORY, **late}).steady_rms()

    assert error(0.006) < 25e-6 < 1e-3 < error(0.0)


def test_until_a_late_command_acts_the_desired_motion_goes_on_along_its_curve():
    delay, rate, radius = 0.006, 2.0, 0.05
    keys = {'actuator.delay': delay, 'estimator.command_delay': delay, 'circle.rate': rate}
    keys |= {'friction.coulomb': 0.0, 'friction.viscous': 0.0, 'circle.radius': radius}
    run = simulate(overrides={'law': 'observer_s_fotsmc', 'approach.duration': 0.4, **keys})
    assert run.steady_rms() < 0.05 * 0.5 * delay**2 * radius * rate**2  # off a tangent


def test_motors_that_lag_are_predicted_too():
    def error(known, law='lqg_tracking'):
        slow = {'actuator.lag': 0.005, 'estimator.lag': known, 'lqg_tracking.bandwidth': 106.7}
        return simulate(overrides={'law': law, **LABORATORY, **slow}).steady_rms()

    assert error(0.005) < 25e-6 < 300e-6 < error(0.0)


def test_velocities_need_not_be_measured():
    blind = {'sensor.velocity_noise': 100.0, 'estimator.velocities': False}
    keys = {'law': 'observer_s_fotsmc', **LABORATORY, **blind, 'safety.speed_limit': 10.0}
    assert simulate(overrides=keys).steady_rms() < 20e-6


def test_a_fault_is_damped_without_measured_velocities_too():
    """The safe action needs a velocity: the filter goes on during a fault."""
    keys = {'law': 'lqg_tracking', 'estimator.velocities': False, 'safety.speed_limit': 0.15}
    still = {'sensor.velocity_noise': 0.0, 'sensor.position_noise': 1e-7}
    run = simulate(duration=1.0, overrides={**keys, **still}).out
    (first, *_) = np.flatnonzero(run.fault)
    rows = slice(first + 1, first + 20)
    measured = np.gradient(run.joints, T, axis=0)[rows]
    assert np.abs(measured).max() > 0.02
    assert np.abs(run.command[rows] + 40.0 * measured).max() < 0.2 * 40.0 * np.abs(measured).max()


def test_the_observer_removes_what_the_switching_gain_had_to_cover():
    """On the exact robot the paper's surface, with a tenth of its G, is nearer to its circle."""
    observer = simulate(overrides={'law': 'observer_s_fotsmc'}).steady_rms()
    assert observer < 1e-6 < 2.5e-6 < simulate(overrides={'law': 's_fotsmc'}).steady_rms()


def test_more_than_can_be_predicted_is_refused():
    values = config.resolve('paper_circle', {'estimator.delay': 0.04})
    configure(values)
    late = values | {'estimator.command_delay': 0.02}
    with pytest.raises(InputError, match=r'at most 50 periods, 0.05 s, not 0.06'):
        assemble(configure(late))
    slow = values | {'estimator.lag': 0.03}
    with pytest.raises(InputError, match=r'command_delay and .lag must .* 0.05 s, not 0.07'):
        assemble(configure(slow))
