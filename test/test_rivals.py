"""The laws that estimate a disturbance or settle in fixed time, against closed forms."""

import numpy as np
import pytest
from assembly import prepare
from scipy.integrate import quad
from vectors import on_vectors

from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.laws import adrc, fixed_time_smc, tdc
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots.contract import Model

observed = on_vectors(adrc.observed)
VALUES = config.resolve('paper_circle')
DT = 1e-3


def gains_of(law, name, **changes):
    return group(VALUES, law.Gains, name)._replace(**changes)


class Joints:
    """Joints M thdd + load = tau under a law that is to hold them at zero; the torque is held."""

    def __init__(self, law, gains, M, position, velocity=0.0, limit=np.inf, heard=True):
        self.law, self.gains, self.M = law, gains, np.atleast_2d(np.asarray(M, dtype=float))
        self.n = len(self.M)
        self.position = np.zeros(self.n) + position
        self.velocity = np.zeros(self.n) + velocity
        self.model = Model(self.M, np.zeros((self.n, self.n)), np.zeros(self.n))
        self.memory = law.initial_memory(self.n)
        self.excess, self.limit, self.heard = np.zeros(self.n), limit, heard

    def step(self, load=0.0, dt=DT):
        """One sample under a load that is constant in it; returns the acceleration."""
        zero = np.zeros(self.n)
        feedback = Feedback(
            self.position, self.velocity, self.excess if self.heard else zero, zero
        )
        out = on_vectors(self.law.update)(
            self.gains, self.model, JointReference(zero, zero, zero), feedback, self.memory, dt
        )
        self.memory, self.sliding = out.memory, out.sliding_variable
        torque = np.clip(out.torque, -self.limit, self.limit)
        self.excess = out.torque - torque
        acceleration = np.linalg.solve(self.M, torque - load)
        self.position = self.position + dt * self.velocity + dt * dt / 2 * acceleration
        self.velocity = self.velocity + dt * acceleration
        return acceleration


# --- adrc


def rows_of(observer):
    return np.array([observer.position[0], observer.rate[0], observer.disturbance[0]])


@pytest.mark.parametrize('w_o', [20.0, 200.0, 2000.0])
@pytest.mark.parametrize('dt', [1e-4, 1e-3, 2e-3])
def test_the_poles_of_the_observer_are_where_its_bandwidth_says(w_o, dt):
    """Its map is linear: column by column, and then its characteristic polynomial."""
    zero = np.zeros(1)
    columns = [
        rows_of(observed(w_o, adrc.Observer(*unit.reshape(3, 1)), zero, zero, dt))
        for unit in np.eye(3)
    ]
    wanted = np.poly(3 * [np.exp(-w_o * dt)])
    assert np.allclose(np.poly(np.transpose(columns)), wanted, rtol=1e-6, atol=1e-9)


def test_the_observer_follows_what_obeys_its_model_without_an_error():
    """Its own prediction is exact for a constant acceleration, whatever the bandwidth and dt."""
    z = adrc.Observer(*np.array([[0.3], [-0.2], [1.5]]))
    u, t = np.array([-4.0]), 0.0
    for dt in (1e-3, 2e-3, 5e-3, 1e-3):
        t += dt
        position = 0.3 - 0.2 * t + (1.5 - 4.0) * t * t / 2
        z = observed(200.0, z, u, np.array([position]), dt)
    assert np.allclose(rows_of(z), [position, -0.2 - 2.5 * t, 1.5], atol=1e-9)


def test_a_constant_load_is_found_and_leaves_no_error():
    joints = Joints(adrc, gains_of(adrc, 'adrc'), 1.5, 0.02)
    for _ in range(1500):
        joints.step(load=3.0)
    assert np.allclose(joints.memory.observer.disturbance, -3.0 / 1.5, atol=1e-6)
    assert np.abs(joints.position).max() < 1e-8


@pytest.mark.parametrize('w_o', [100.0, 200.0, 400.0])
def test_a_rising_load_is_followed_with_the_lag_of_three_poles(w_o):
    """f = c t leaves (c / w_o^3, 3 c / w_o^2, 3 c / w_o) in z, and what the PD law makes of it."""
    gains = gains_of(adrc, 'adrc', w_o=w_o)
    joints, rise = Joints(adrc, gains, 1.0, 0.0), 10.0  # N m/s
    for k in range(2000):
        joints.step(load=rise * k * DT)
    lag = -rise * 1999 * DT - joints.memory.observer.disturbance[0]
    error = (3 / w_o + 2 * gains.w_c * 3 / w_o**2) / gains.w_c**2 + 1 / w_o**3
    assert lag == pytest.approx(-3 * rise / w_o, rel=0.1)
    assert -joints.position[0] == pytest.approx(rise * error, rel=0.1)


def test_a_limited_torque_is_no_disturbance():
    """While the motors are too weak z3 is still the load; an observer that is not told is not."""

    def found(heard):
        M = np.array([[1.5, 0.4], [0.4, 0.8]])
        joints = Joints(adrc, gains_of(adrc, 'adrc'), M, 0.1, limit=2.0, heard=heard)
        for _ in range(100):
            joints.step(load=np.array([0.3, -0.2]))
        assert np.abs(joints.excess).min() > 1.0
        return joints.memory.observer.disturbance + np.linalg.solve(M, [0.3, -0.2])

    assert np.abs(found(heard=True)).max() < 1e-3 < 1.0 < np.abs(found(heard=False)).max()


def test_an_observer_that_is_too_slow_is_warned_about():
    assert adrc.validate_gains(gains_of(adrc, 'adrc', w_c=30.0, w_o=90.0)) == []
    (warning,) = prepare('adrc', VALUES | {'adrc.w_o': 59.0}).warnings
    assert 'w_o = 59 1/s is less than 3 w_c = 60 1/s' in warning


@pytest.mark.parametrize('key', ['adrc.w_c', 'adrc.w_o', 'tdc.inertia', 'fixed_time_smc.u'])
@pytest.mark.parametrize('value', [0.0, -1.0, float('nan')])
def test_what_must_be_positive_is_refused_otherwise(key, value):
    with pytest.raises(InputError, match=key):
        prepare(key.partition('.')[0], VALUES | {key: value})


# --- tdc


@pytest.mark.parametrize('ratio', [0.1, 0.5, 1.0, 1.5])
def test_the_error_of_the_estimate_decays_by_what_the_inertia_lacks(ratio):
    """One joint that nothing else drives: thdd_k = -(1 - Mbar / M)^k load / M."""
    M, load = 1.3, 0.7
    joints = Joints(tdc, tdc.Gains(ratio * M, 0.0, 0.0), M, 0.0)
    found = [joints.step(load=load)[0] for _ in range(20)]
    assert np.allclose(found, -load / M * (1 - ratio) ** np.arange(20), atol=1e-12)


def test_with_the_true_inertia_a_constant_load_is_cancelled_from_the_second_sample_on():
    """The error then obeys e'' = -Kd e' - Kp e, sampled; the first sample knows nothing."""
    gains = gains_of(tdc, 'tdc', inertia=1.3)
    joints = Joints(tdc, gains, 1.3, 0.02, velocity=-0.1)
    joints.step(load=5.0)
    for _ in range(50):
        wanted = -gains.Kp * joints.position - gains.Kd * joints.velocity
        assert np.allclose(joints.step(load=5.0), wanted, atol=1e-10)


def test_the_inertia_may_be_twice_the_least_eigenvalue_at_most():
    M = np.array([[1.507, -0.267, -0.028], [-0.267, 1.433, -0.093], [-0.028, -0.093, 0.956]])
    bound = 2.0 * np.linalg.eigvalsh(M)[0]
    assert np.linalg.norm(np.eye(3) - 0.999 * bound * np.linalg.inv(M), 2) < 1.0

    def largest(inertia):
        joints = Joints(tdc, tdc.Gains(inertia, 0.0, 0.0), M, 0.0)
        return np.abs([joints.step(load=np.array([0.1, 0.2, 0.3])) for _ in range(2000)][-1]).max()

    assert largest(0.98 * bound) < 1e-9 < 1e9 < largest(1.02 * bound)


@pytest.mark.parametrize('dt', [1e-3, 4e-3])
def test_the_inertia_must_not_be_too_small_for_the_gains_either(dt):
    """Estimate and error together: dt M / Mbar s^3 + s^2 + Kd s + Kp, for slow poles (Routh)."""
    M = 2.0
    bound = dt * M * 400.0 / 40.0

    def rest(inertia):
        joints = Joints(tdc, gains_of(tdc, 'tdc', inertia=inertia), M, 0.01)
        for _ in range(round(8.0 / dt)):
            joints.step(dt=dt)
        return np.abs(joints.position).max()

    assert rest(1.4 * bound) < 1e-6 < 1.0 < rest(0.7 * bound)


def test_a_load_that_rises_is_one_sample_late():
    """At the true inertia: N lags by what the load changes in one period, and no more."""
    joints, rise = Joints(tdc, gains_of(tdc, 'tdc', inertia=1.0), 1.0, 0.0), 10.0
    for k in range(1000):
        joints.step(load=rise * k * DT)
    assert joints.position[0] == pytest.approx(-rise * DT / 400.0, rel=1e-3)


def test_a_limited_torque_does_not_wind_up():
    """What the limits cut off is not asked for again: the demand stays that of the motion."""
    joints = Joints(tdc, gains_of(tdc, 'tdc', inertia=1.0), 1.0, 1.0, limit=2.0)
    for _ in range(200):
        wanted = -400.0 * joints.position - 40.0 * joints.velocity
        joints.step(load=0.5)
    assert np.allclose(joints.memory.torque, wanted + 0.5, atol=1e-9)
    assert np.abs(joints.excess).min() > 100.0


@pytest.mark.parametrize('gain', ['Kp', 'Kd'])
def test_an_error_that_would_not_vanish_is_refused(gain):
    with pytest.raises(InputError, match=r'tdc: .*Hurwitz'):
        prepare('tdc', VALUES | {f'tdc.{gain}': 0.0})


# --- fixed_time_smc

SHARP = gains_of(fixed_time_smc, 'fixed_time_smc', u=1e-6)  # a sign, but for rounding


def times(gains):
    """Bounds of Polyakov (2012), Lemma 1, for reaching and for sliding [s]."""
    reaching = 2 / np.sqrt(gains.alpha2) + 2 / np.sqrt(gains.beta2)
    return reaching, 2 / np.sqrt(gains.alpha1 / 2) + 2 / np.sqrt(gains.beta1 / 2)


def settled(joints, duration, load, dt, size):
    """Times after which each error stays below `size` [s]."""
    last = np.zeros(joints.n)
    for k in range(round(duration / dt)):
        joints.step(load=load(k * dt), dt=dt)
        last[np.abs(joints.position) > size] = (k + 1) * dt
    return last


def test_the_default_gains_are_those_of_a_settling_time_of_four_seconds():
    gains = gains_of(fixed_time_smc, 'fixed_time_smc')
    assert sum(times(gains)) == pytest.approx(4.0)


def test_every_error_vanishes_before_the_settling_time_whatever_it_was():
    """Errors over five decades, a load at the bound that switches: one time for all of them."""
    start = np.array([1e-2, -0.1, 1.0, -10.0, 100.0, 1000.0])
    joints = Joints(fixed_time_smc, SHARP, np.eye(6), start)
    dt = 2e-4
    found = settled(joints, 4.5, lambda t: 0.99 * SHARP.G * np.sign(np.sin(9 * t)), dt, 5e-3)
    assert found.max() < sum(times(SHARP))
    assert found[-1] < 1.2 * found[-3]  # a hundred times as far, hardly later
    assert found[-1] > 4 * found[0] > 0.0


def test_the_surface_is_the_motion_that_the_source_proves():
    """S = 0 exactly where e' = -sig((alpha1 e + beta1 e^3) / 2, 1/2)."""
    e = np.array([-3.0, -0.2, 1e-4, 0.5, 40.0])
    drive = (SHARP.alpha1 * e + SHARP.beta1 * e**3) / 2
    joints = Joints(fixed_time_smc, SHARP, np.eye(5), -e, np.sign(e) * np.sqrt(np.abs(drive)))
    joints.step()
    assert np.allclose(joints.sliding, 0.0, atol=1e-6 * np.sqrt(np.abs(drive).max()))


@pytest.mark.parametrize('start', [0.05, 0.5, 5.0])
def test_on_the_surface_the_time_is_the_integral_of_the_motion(start):
    """From there the reaching time is zero, and the rest is a quadrature."""

    def slowness(e):
        return 1 / np.sqrt((SHARP.alpha1 * e + SHARP.beta1 * e**3) / 2)

    exact, bound = quad(slowness, 0.0, start)[0], times(SHARP)[1]
    joints = Joints(fixed_time_smc, SHARP, 1.0, start, -1 / slowness(start))
    found = settled(joints, 1.5 * exact, lambda t: 0.0, 1e-4, 1e-5)[0]
    assert found == pytest.approx(exact, rel=0.02)
    assert exact < bound


@pytest.mark.parametrize('u', [0.05, 0.15])
def test_the_boundary_layer_leaves_an_error_that_goes_with_its_square(u):
    """At rest under a constant load: gain S / u + sqrt(alpha2 S) = load, e = S^2 / alpha1."""
    gains, load = gains_of(fixed_time_smc, 'fixed_time_smc', u=u), 1.5
    joints = Joints(fixed_time_smc, gains, 1.0, 0.1)
    for _ in range(4000):
        joints.step(load=load)
    root = np.sqrt(gains.alpha2)
    slope = (gains.alpha1 / 2 + gains.G) / u
    S = ((-root + np.sqrt(root**2 + 4 * slope * load)) / (2 * slope)) ** 2
    assert -joints.position[0] == pytest.approx(S**2 / gains.alpha1, rel=0.02)
    assert u > S


@pytest.mark.parametrize('gain', ['alpha1', 'beta1', 'alpha2', 'beta2'])
def test_gains_without_a_settling_time_are_refused(gain):
    with pytest.raises(InputError, match=f'fixed_time_smc: {gain} must be positive'):
        prepare('fixed_time_smc', VALUES | {f'fixed_time_smc.{gain}': 0.0})
