"""Noise and disturbance that the Kalman filter finds, against those that were drawn."""

import numpy as np
import pytest

from parallel_robot_control.configuration import resolve
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import assemble, configure

QUIET, LOUD = (2e-6, 2e-3, 0.15), (9e-6, 9e-3, 0.8)  # rad, rad/s and N m, rms


def levels(truth, over):
    """Torques of 6 s; levels after them, rms, shape (3, 3): of position, rate and disturbance."""
    position, velocity, disturbance = truth
    values = {
        'law': 'lqg_tracking', 'approach.duration': 0.4, 'estimator.levels': over, 'seed': 3,
        'sensor.position_noise': position, 'sensor.velocity_noise': velocity, 'duration': 6.0,
        'disturbance.noise': disturbance, 'disturbance.bandwidth': 6.4,
    }  # fmt: skip
    parts = assemble(configure(resolve('paper_circle', values)))
    motion = parts.trajectory.sample(np.arange(6001) * 1e-3)
    torques = run(parts.control, parts.plant, motion, 1e-3).command
    return torques, np.sqrt(parts.control.setup.memory.kalman.levels)


@pytest.mark.parametrize('truth', [QUIET, LOUD])
def test_they_are_those_of_the_robot(truth):
    """A disturbance of 6.4 Hz has few independent values in a second, the noises have many."""
    _, found = levels(truth, 1.0)
    assert np.allclose(found[:2], np.array(truth[:2])[:, np.newaxis], rtol=0.15)
    assert np.allclose(found[2], truth[2], rtol=0.5)


def test_zero_keeps_what_was_given_and_auto_is_what_the_law_asks_for():
    assert np.array_equal(levels(LOUD, 0.0)[0], levels(LOUD, 'auto')[0])
