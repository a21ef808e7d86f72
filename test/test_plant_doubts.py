"""Plants that do not suit the law or the period."""

import math

import numpy as np
import pytest
import yaml

from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_control.laws import adaptive_s_fotsmc
from parallel_robot_model.configuration import config
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.scenario_run import simulate
from parallel_robot_sim.simulation import noise_warnings

LAW = {
    'law': 'adaptive_s_fotsmc',
    'adaptive_s_fotsmc.width': 21.0,
    'adaptive_s_fotsmc.slope': 40.0,
}


def doubts(**changes):
    named = {key.replace('__', '.'): value for key, value in changes.items()}
    return noise_warnings(configure(resolve('paper_circle', LAW | named)))


def test_a_barrier_inside_the_noise_is_warned_about():
    """3 sqrt(2) 0.005 / 0.001 = 21.2 rad/s^2."""
    (text,) = doubts(sensor__velocity_noise=0.005)
    assert text.startswith('adaptive_s_fotsmc: the noise of S') and '= 7.07 rad/s^2' in text
    assert text.endswith('width = 21, at least 21.2')
    assert doubts() == doubts(sensor__velocity_noise=0.0049) == ()
    assert doubts(sensor__velocity_noise=0.005, period=0.002) == ()
    assert doubts(sensor__velocity_noise=[0.0, 0.0, 0.005])
    assert doubts(sensor__velocity_noise=0.005, estimator__kind='filter') == ()
    assert doubts(sensor__velocity_noise=0.005, law='s_fotsmc') == ()


def test_the_noise_of_the_sliding_variable_is_that_of_two_rates():
    noise, dt = 0.005, 1e-3
    rates = np.random.default_rng(0).normal(0.0, noise, 100_000)
    found = np.std(np.diff(rates) / dt)
    width = adaptive_s_fotsmc.INSIDE * found
    gains = adaptive_s_fotsmc.Gains(0.9, 20.0, width, 500.0, 16.0, 6.5, 0.5, 0.67)
    assert found == pytest.approx(math.sqrt(2.0) * noise / dt, rel=0.01)
    assert adaptive_s_fotsmc.noise_warnings(gains, 0.98 * noise, dt) == []
    assert adaptive_s_fotsmc.noise_warnings(gains, 1.02 * noise, dt)


def test_simulate_says_so(tmp_path, capsys):
    words = ['simulate', 'paper_circle', '--law', 'adaptive_s_fotsmc', '--duration', '0.01']
    words += ['--set', 'adaptive_s_fotsmc.width=1', '--set', 'sensor.velocity_noise=0.005']
    assert main([*words, '--out', str(tmp_path / 'bag')]) == 0
    assert 'width = 1, at least 21.2' in capsys.readouterr().err


def test_a_slope_that_the_noise_drives_to_the_largest_gain_is_warned_about():
    gains = adaptive_s_fotsmc.Gains(0.9, 50.0, 45.0, 500.0, 16.0, 6.5, 0.5, 0.67)
    (text,) = adaptive_s_fotsmc.noise_warnings(gains, 0.01, 1e-3)
    most = float(text.rpartition(' ')[2])
    s = math.sqrt(2.0) * 0.01 / 1e-3
    assert most * s / (1.0 - s / 45.0) == pytest.approx(500.0, rel=5e-3)  # the barrier's G at s
    assert adaptive_s_fotsmc.noise_warnings(gains._replace(slope=0.99 * most), 0.01, 1e-3) == []


def test_the_gains_of_the_study_suit_its_noise():
    study = yaml.safe_load((config.directory() / 'studies' / 'robustness.yaml').read_text())
    noise = study['uncertainty']['sensor.velocity_noise']['high']
    own = study['laws']['adaptive_s_fotsmc']
    changes = {f'adaptive_s_fotsmc.{key}': value for key, value in own.items()}
    values = resolve('paper_circle', {'law': 'adaptive_s_fotsmc', **changes})
    assert noise_warnings(configure(values | {'sensor.velocity_noise': noise})) == ()


def test_dry_friction_that_is_stiff_for_the_period_is_told_with_what_it_takes():
    """A joint that stops and turns between two samples faults; with the value told it does not."""
    run = {'scenario': 'arm6_circle', 'law': 'computed_torque', 'duration': 1.1}
    dry = np.array(resolve('arm6_circle', {})['friction.coulomb'])
    stiff = simulate(**run, **{'friction.coulomb': (30.0 * dry).tolist()})
    assert 'is not the derivative' in stiff.fault[1]
    texts = [text for text in stiff.warnings if 'friction' in text]
    assert len(texts) == 2 and 'dry friction changes the rate' in texts[0]
    enough = float(texts[1].split('; ')[1].split()[0])
    held = simulate(
        **run, **{'friction.coulomb': (30.0 * dry).tolist(), 'safety.rate_tolerance': enough}
    )
    assert held.fault is None and not [text for text in held.warnings if 'dry' in text]
    usual = simulate(**run, **{'friction.coulomb': (3.0 * dry).tolist()})
    assert usual.fault is None and not [text for text in usual.warnings if 'dry' in text]
