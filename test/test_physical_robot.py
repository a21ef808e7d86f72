"""The robot that can be built: one answer, the least cost, within what is known."""

import numpy as np
import pytest
from scipy.optimize import minimize

from parallel_robot.studies.identification import base_parameters, physical_robot
from parallel_robot.studies.identification.base_parameters import BaseParameters
from parallel_robot.studies.identification.least_squares import Fit
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.registry import robot_of

FRICTION = 0.5


def problem(scenario, seed=0, shift=0.1, error=0.02):
    """A robot, and an estimate that is off: [robot, base, fit, sizes, friction]."""
    robot, rng = robot_of(resolve(scenario, {})), np.random.default_rng(seed)
    model = base_parameters.linear_model(robot)
    p, n = model.values(robot.parameters), robot.module.joints(robot.parameters)
    K = rng.normal(size=(len(p) // 2, len(p)))
    columns = base_parameters.columns_of(('viscous', 'coulomb'), n)
    base = BaseParameters({}, ({},) * n, (), K, tuple(columns))
    each = (FRICTION,) * n
    friction = FrictionParameters(each, each, (0.0,) * n, 0.01, 0.0, *((0.0,) * n,) * 2)
    scale = base.scale(base_parameters.sizes(robot), friction)
    root = rng.normal(size=(len(scale), len(scale))) / np.sqrt(len(scale))
    covariance = error**2 * np.outer(scale, scale) * (root @ root.T + np.eye(len(scale)))
    values = base.of(p, friction) + shift * scale * rng.normal(size=len(scale))
    nothing = np.zeros(n)
    fit = Fit(values, covariance, np.ones(len(scale)), 1.0, nothing, nothing)
    return robot, base, fit, scale, friction


def others(bodies, rng):
    """Numbers of bodies, each heavier or lighter than the nominal one."""
    found = bodies.numbers.copy()
    for each in bodies.pseudo_inertias:
        found[np.abs(each).max(axis=(0, 1)) > 0.0] *= np.exp(rng.normal())
    return found


@pytest.mark.parametrize('scenario', ['paper_circle', 'serial_2r_circle', 'five_bar_circle'])
@pytest.mark.parametrize('shift', [0.01, 0.3])
def test_the_answer_is_the_same_whatever_the_start(scenario, shift):
    given = problem(scenario, shift=shift)
    bodies = given[0].module.linear_model.bodies(given[0].parameters)
    found = physical_robot.nearest(*given)
    rng = np.random.default_rng(1)
    for _ in range(4):
        again = physical_robot.nearest(*given, start=others(bodies, rng))
        assert again.robot == found.robot and again.bounds == found.bounds
        assert again.friction == found.friction


@pytest.mark.parametrize('scenario', ['paper_circle', 'serial_2r_circle'])
def test_the_cost_is_the_least_that_another_search_finds(scenario):
    """Bodies by Cholesky factors, friction by logarithms: no constraint is left."""
    robot, base, fit, scale, friction = problem(scenario, shift=0.2)
    model, n = robot.module.linear_model, base.joints
    bodies = model.bodies(robot.parameters)
    count = len(bodies.numbers)
    flat = np.concatenate([each.reshape(-1, count) for each in bodies.pseudo_inertias])
    precision = np.linalg.inv(fit.covariance)
    sizes = [len(each) for each in bodies.pseudo_inertias]

    def numbers_of(x):
        blocks, x = [], list(x)
        for k in sizes:
            L = np.zeros((k, k))
            L[np.tril_indices(k)] = [x.pop(0) for _ in range(k * (k + 1) // 2)]
            blocks.append((L @ L.T).ravel())
        return np.linalg.lstsq(flat, np.concatenate(blocks), rcond=None)[0]

    def cost_of(numbers, viscous, coulomb):
        acting = friction._replace(viscous=viscous, coulomb=coulomb)
        left = base.of(bodies.linear @ numbers + bodies.fixed, acting) - fit.values
        total = 0.5 * left @ precision @ left
        for each in bodies.pseudo_inertias:
            ratio = np.linalg.solve(each @ bodies.numbers, each @ numbers)
            sign, size = np.linalg.slogdet(ratio)
            if sign <= 0.0:
                return np.inf
            total += physical_robot.WEIGHT * (np.trace(ratio) - size - len(each))
        return total

    def cost(x):
        rest = len(x) - 2 * n
        return cost_of(numbers_of(x[:rest]), *np.split(np.exp(x[rest:]), 2))

    factors = [np.linalg.cholesky(each @ bodies.numbers) for each in bodies.pseudo_inertias]
    begin = [*(L[np.tril_indices(len(L))] for L in factors), *np.log(np.full((2, n), FRICTION))]
    best = minimize(cost, np.concatenate(begin), method='BFGS', options={'maxiter': 20000})
    found = physical_robot.nearest(robot, base, fit, scale, friction)
    numbers = model.bodies(robot.parameters._replace(**found.robot)).numbers
    floor = 1e-9  # friction of which the logarithm is far away
    acting = found.friction
    mine = cost_of(numbers, np.maximum(acting.viscous, floor), np.maximum(acting.coulomb, floor))
    assert not found.bounds
    assert mine <= best.fun + 1e-3 * abs(best.fun)


def test_what_is_not_told_stays_to_the_last_bit():
    robot, base, fit, scale, friction = problem('five_bar_circle', shift=0.0, error=1e3)
    found = physical_robot.nearest(robot, base, fit, scale, friction)
    assert found.robot == found.nominal and not found.active
    assert found.friction == friction


def test_bounds_hold_and_are_told_when_they_act():
    robot, base, fit, scale, friction = problem('five_bar_circle', shift=0.1)
    free = physical_robot.nearest(robot, base, fit, scale, friction)
    model = robot.module.linear_model

    def mass(found):
        parameters = robot.parameters._replace(**found.robot)
        return robot.module.mechanism(parameters).mass.sum()

    low, high = 2.0 * mass(free), 3.0 * mass(free)
    heavy = physical_robot.nearest(robot, base, fit, scale, friction, {'mass': (low, high)})
    assert f'mass from {low:.4g} to {high:.4g}' in heavy.bounds
    assert mass(heavy) == pytest.approx(low, rel=1e-3)
    wide = physical_robot.nearest(robot, base, fit, scale, friction, {'mass': (0.0, high)})
    assert wide.robot == free.robot and wide.bounds == free.bounds
    names = model.bodies(robot.parameters).known
    assert {'mass', 'm[left]', 'x[left]', 'z[right_elbow]'} <= {*names}


@pytest.mark.parametrize(
    ('bounds', 'message'),
    [
        ({'mas': (0.0, 1.0)}, r"unknown name in --bounds 'mas'.*'mass'"),
        ({'mass': (2.0, 1.0)}, '--bounds mass must be LOW:HIGH, not 2:1'),
        ({'mass': (0.0, 1.0), 'm[left]': (2.0, 3.0)}, 'no robot that can be built has'),
    ],
)
def test_bounds_that_cannot_be_cost_one_line(bounds, message):
    with pytest.raises(InputError, match=message):
        physical_robot.nearest(*problem('five_bar_circle'), bounds)
