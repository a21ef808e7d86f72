"""The lag of motors, from commands and efforts: found again, with an interval that holds it."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import parallel_robot as pr
from parallel_robot.studies.identification import motor_lag

H = 1e-3  # s
N = 3000


def lag_of(log):
    """Lag of a whole run."""
    steps = np.diff(log.time)
    stretch = motor_lag.LongestStretch(float(np.median(steps)) if len(steps) else 0.0)
    stretch.add(log)
    return stretch.lag()


def log(lags, delay=0, noise=0.0, seed=0):
    """A log of motors that lag, by another integrator; white commands, as of a chattering law."""
    random = np.random.default_rng(seed)
    command = random.normal(0.0, 2.0, (N, len(lags)))
    fine = 50  # steps in a period
    effort = np.zeros_like(command)
    for joint, lag in enumerate(lags):
        held = np.repeat(command[:, joint], fine)
        out = np.append(held, held[-1])
        if lag:
            kept = np.exp(-H / fine / lag)
            out = lfilter([0.0, 1.0 - kept], [1.0, -kept], out)
        whole = (0.5 * (out[:-1] + out[1:])).reshape(N, fine).mean(axis=1)
        effort[1 + delay :, joint] = whole[: N - 1 - delay]
    effort += random.normal(0.0, noise, effort.shape)
    time = np.arange(N) * H
    return SimpleNamespace(time=time, answer=command, effort=effort, has_efforts=True)


def test_time_constants_and_a_delay_are_found_again():
    found = lag_of(log([2e-3, 5e-3, 0.5e-3], delay=3))
    assert found.found and found.delay == pytest.approx(3e-3)
    np.testing.assert_allclose(found.values, [2e-3, 5e-3, 0.5e-3], rtol=1e-3)
    assert (
        'lag of the motors: 2' in found.parts()[0] and 'estimator.lag: 0.0025' in found.parts()[1]
    )


def test_time_constants_are_told_in_milliseconds_and_as_a_scenario_takes_them():
    found = motor_lag.MotorLag(np.array([2e-3, 3e-3]), np.array([1e-4, 2e-4]), 4e-3, 1e-3)
    assert found.parts() == [
        'lag of the motors: 2 +- 0.1, 3 +- 0.2 ms, 4 ms late; for a scenario',
        '  estimator.lag: 0.0025',
    ]


def test_the_interval_holds_the_lag_about_as_often_as_it_says():
    lags, held = [1e-3, 2e-3, 4e-3], []
    for seed in range(20):
        found = lag_of(log(lags, noise=0.5, seed=seed))
        held += (np.abs(found.values - lags) < found.half_widths).tolist()
        assert (found.half_widths < 0.1 * np.array(lags)).all()
    assert 51 <= sum(held) <= 60


@pytest.mark.parametrize('noise', [0.0, 0.5])
def test_motors_without_a_lag_have_none(noise):
    found = lag_of(log([0.0, 0.0], noise=noise))
    assert not found.found and found.delay == 0.0
    assert found.parts() == ['efforts follow the commands without a lag']


def test_a_gap_ends_what_is_used_and_little_tells_nothing():
    whole = log([2e-3])
    whole.answer[1000:1010] = np.nan
    np.testing.assert_allclose(lag_of(whole).values, [2e-3], rtol=1e-3)
    whole.answer[::100] = np.nan
    assert lag_of(whole) is None
    assert lag_of(SimpleNamespace(**vars(log([2e-3])) | {'has_efforts': False})) is None
    still = log([2e-3])
    still.answer[:] = 1.0
    assert lag_of(still) is None


def test_identify_finds_the_lag_of_a_simulated_robot(tmp_path):
    changes = {'actuator.lag': 0.002, 'actuator.noise': 0.05, 'sensor.position_noise': 1e-5}
    run = pr.simulate('excitation', law='pid', duration=5.0, **changes)
    pr.save(run, tmp_path / 'bag')
    found = pr.identify(tmp_path / 'bag')
    assert found.lag.found and found.lag.delay == 0.0
    assert (np.abs(found.lag.values - 0.002) < found.lag.half_widths).all()
    assert (found.lag.half_widths < 1e-4).all()
    assert 'lag of the motors' in str(found) and found.as_data()['motor_lag']['found']
