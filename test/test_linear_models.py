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


def test_bodies_are_those_of_the_parameters_and_give_them_back(case):  # noqa: F811
    linear, rng = case.robot.linear_model, np.random.default_rng(3)
    bodies = linear.bodies(case.parameters)
    for k in range(3):
        numbers = bodies.numbers
        if k:  # of other bodies: what can be built is convex, and so is a cone
            numbers = numbers * rng.uniform(0.99, 1.01, len(numbers))
        assert all(np.linalg.eigvalsh(each @ numbers)[0] > 0.0 for each in bodies.pseudo_inertias)
        given = linear.parameters(case.parameters, numbers)
        changed = case.robot.validate(case.parameters._replace(**given))
        expected = bodies.linear @ numbers + bodies.fixed
        assert np.allclose(linear.values(changed), expected, rtol=1e-9, atol=1e-12)
        assert np.allclose(linear.bodies(changed).numbers, numbers, rtol=1e-9, atol=1e-12)
        for name, known in bodies.known.items():
            rows = known.rows(known.low, known.high)
            assert (rows @ np.append(numbers, 1.0) >= 0.0).all(), name
