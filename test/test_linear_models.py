"""Equations of motion that are linear in the parameters against those of the kernels."""

import numpy as np
from test_robots import case, estimate, measure, states  # noqa: F401
from vectors import on_vectors

from parallel_robot_model.robots.contract import FOUND, inverse_dynamics


def test_the_regressor_gives_the_torques_of_the_model(case):  # noqa: F811
    linear = case.robot.linear_model
    values = linear.values(case.parameters)
    for coordinates, rate in states(case):
        measured = measure(case, coordinates, rate)
        found = estimate(case, measured)
        assert found.fault == FOUND
        acceleration = case.rng.normal(size=case.n)
        expected = on_vectors(inverse_dynamics)(found.model, acceleration, measured.velocity)
        Y = linear.regressor(
            case.parameters,
            measured.pose[np.newaxis],
            measured.position[np.newaxis],
            measured.velocity[np.newaxis],
            acceleration[np.newaxis],
        )
        assert Y.shape == (1, case.n, len(linear.units(case.parameters)))
        assert np.allclose(Y[0] @ values, expected, rtol=1e-9, atol=1e-12)


def test_free_keys_are_parameters_that_change_the_torques(case):  # noqa: F811
    linear = case.robot.linear_model
    before = linear.values(case.parameters)
    for key, (low, high) in linear.free(case.parameters).items():
        value = getattr(case.parameters, key)
        assert np.all(low <= np.array(value)) and np.all(np.array(value) <= high)
        more = tuple(1.1 * np.array(value)) if isinstance(value, tuple) else 1.1 * value
        changed = linear.values(case.parameters._replace(**{key: more}))
        assert not np.array_equal(before, changed), key
