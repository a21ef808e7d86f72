"""The disturbance: its formula, its sign in the equation of motion, and its time in the plant."""

import numpy as np
from assembly import make_plant, open_loop

from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots.joint_load import DisturbanceParameters, disturbance_torque

DISTURBED = config.resolve('disturbed_circle')
DISTURBANCE = group(DISTURBED, DisturbanceParameters, 'disturbance')


def test_formula():
    for t in (0.0, 0.01, 7.3):
        expected = 5.0 * np.sin(2 * np.pi * 3.0 * t + np.array([0.0, np.pi / 2, 1.0]))
        assert np.allclose(disturbance_torque(DISTURBANCE, t), expected, rtol=1e-12, atol=1e-12)


def test_a_motor_that_opposes_it_keeps_the_robot_still():
    """delta stands on the side of friction in eq. (1): tau = delta cancels it."""
    values = DISTURBED | {'disturbance.frequency': 0.0}
    torques = np.tile(5.0 * np.sin([0.0, np.pi / 2, 1.0]), (200, 1))
    states = open_loop(values, torques)
    assert np.abs(states[-1].coordinates - states[0].coordinates).max() < 1e-12


def test_it_acts_at_every_moment_of_a_step():
    """Halving the step changes the motion by far less than holding delta over it would."""
    values = DISTURBED | {'plant.integrator': 'rk4', 'friction.coulomb': [0.0, 0.0, 0.0]}
    torques = np.zeros((100, 3))
    ends = [open_loop(values | {'plant.substeps': n}, torques)[-1].coordinates for n in (1, 2)]
    assert np.abs(ends[0] - ends[1]).max() < 1e-9


def test_the_paper_has_none():
    assert not any(make_plant(config.resolve('paper_circle')).setup.load.disturbance.amplitude)
