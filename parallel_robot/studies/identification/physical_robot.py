"""A robot that can be built and has given base parameters, as near to the nominal as possible.

Second moments, centre and mass of each body make a matrix that is linear in them and positive
definite for whatever can be built. So this is one convex problem, with one answer:

    min 1/2 |R (beta(z) - beta)|^2 + WEIGHT sum_i (tr(P0_i^-1 P_i(z)) - log det P_i(z)),
        R^T R = covariance^-1

subject to friction that dissipates and to what is known of the robot. Base parameters determine
fewer numbers than a robot has; the second term, a distance of the bodies from the nominal ones
whatever the frame and the units, keeps the others there. It is its own barrier, and is reduced
step by step to its weight (path of an interior point, Newton's method).

Source:
    Wensing, Kim, Slotine (2018), Linear matrix inequalities for physically consistent inertial
    parameter identification, IEEE Robotics and Automation Letters 3(1); Lee, Wensing, Park (2020),
    Geometric robot dynamic identification: a convex programming approach, IEEE Trans. Robotics
    36(2), for the distance.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from parallel_robot.studies.identification.base_parameters import (
    BaseParameters,
    linear_model,
    sizes,
)
from parallel_robot.studies.identification.least_squares import Fit
from parallel_robot_model.common.errors import InputError, RobotError, UnknownNameError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import PerJoint, plain
from parallel_robot_model.robots.contract import Bodies
from parallel_robot_model.robots.joint_load import MOST_LOAD, FrictionParameters
from parallel_robot_model.robots.registry import RobotModel

WEIGHT = 1e-2  # of the distance: bodies are believed to a factor of 10
SHARPEST = 1e-6  # of the size of a parameter, the smallest standard error that is believed
MISFIT = 0.05  # standard errors that a constraint may cost before it counts as active
BARRIER = 1e-3  # of the weight, that of the distance of inequalities from their centre
REDUCTION = 0.1  # of the weight from one step of the path to the next
ITERATIONS = 2000  # of Newton's method at a step of the path
CLOSE = 1e-12  # decrement over the weight at which it ends
FIRM = 1e2  # of how far the inequalities are missed, while a robot is looked for that meets them
SHORTEST = 1e-12  # share of a step of Newton's method
ACTS = 1e-2  # of the nominal distance from a bound, below which it acts
ROUNDED = 1e-3  # of a standard error, what rounding may change

# Friction that dissipates, in the unit of each kind: with it a search begins.
INSIDE = {'viscous': 1.0, 'coulomb': 1.0, 'offset': 0.0, 'stribeck': 0.0, 'load': 0.1}

Bounds = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class PhysicalRobot:
    """Physical parameters."""

    robot: dict[str, Any]  # keys of the robot that were chosen, with their values
    nominal: dict[str, Any]  # the same keys with their nominal values
    friction: FrictionParameters
    values: Array  # base parameters of this robot, shape (B + F,)
    misfit: float  # largest difference to the estimate [standard errors]
    bounds: tuple[str, ...] = ()  # what is known of the robot and acts, with the range

    @property
    def active(self) -> bool:
        """Whether no robot that can be built has the estimated base parameters."""
        return self.misfit > MISFIT


def nearest(
    robot: RobotModel,
    base: BaseParameters,
    fit: Fit,
    scale: Array,
    friction: FrictionParameters,
    bounds: Bounds | None = None,
    start: Array | None = None,
) -> PhysicalRobot:
    """Find the physical robot.

    Args:
        robot: The nominal robot.
        base: Its base parameters.
        fit: Their estimate.
        scale: Their sizes, shape (B + F,).
        friction: Nominal friction.
        bounds: What is known of the robot, see :class:`Bodies`: ranges by name.
        start: Numbers of the bodies with which the search begins, shape (Z,); None: the nominal
            ones. The answer is the same.
    """
    model, count = linear_model(robot), len(base.friction)
    bodies: Bodies = model.bodies(robot.parameters)
    errors = np.sqrt(np.diag(fit.covariance) + (SHARPEST * scale) ** 2)
    sharp = np.diag((SHARPEST * scale / errors) ** 2)
    root = _root(fit.covariance / np.outer(errors, errors) + sharp) / errors
    of_friction = scale[-count:]  # the unit in which the search has it
    before = base.of(0.0 * bodies.fixed, friction)[-count:]
    centre = np.concatenate([bodies.numbers, before / of_friction])
    ranges = _ranges(bodies, bounds or {})
    known = [bodies.known[name].rows(*each) for name, each in ranges.items()]
    of_bodies = len(bodies.numbers)
    losses = _losses(base, of_friction)
    first = len(losses)
    rows = np.zeros((first + sum(map(len, known)), len(centre) + 1))
    rows[:first, of_bodies:] = losses
    rows[first:, [*range(of_bodies), -1]] = np.concatenate([np.zeros((0, of_bodies + 1)), *known])
    fixed = np.append(base.K @ bodies.fixed, np.zeros(count))
    problem, basis = _whitened(
        root @ block_diag(base.K @ bodies.linear, np.diag(of_friction)),
        root @ (fit.values - fixed),
        [np.pad(each, ((0, 0), (0, 0), (0, count))) for each in bodies.pseudo_inertias],
        rows,
        centre,
    )
    inside = [INSIDE[each.kind] for each in base.friction]
    begin = np.concatenate([bodies.numbers if start is None else start, inside])
    y = problem.minimum(
        np.linalg.solve(basis, begin - centre), lambda row: _beyond(ranges, known, row - first)
    )
    found = centre + basis @ y
    acting = np.flatnonzero(problem.rows[first:] @ np.append(y, 1.0) < ACTS)
    given = model.parameters(robot.parameters, found[:of_bodies])
    chosen = _rounded(robot, base, errors, given)
    step = ROUNDED * errors[-count:]
    friction = base.with_values(
        friction, _shortened(found[of_bodies:] * of_friction, step, before)
    )
    least = np.maximum(friction.stribeck, np.negative(friction.coulomb))  # after rounding, too
    friction = friction._replace(stribeck=PerJoint(tuple(least.tolist())))
    values = base.of(model.values(robot.parameters._replace(**chosen)), friction)
    return PhysicalRobot(
        {key: plain(each) for key, each in chosen.items()},
        {key: plain(getattr(robot.parameters, key)) for key in chosen},
        friction,
        values,
        float(np.max(np.abs(values - fit.values) / errors)),
        tuple(dict.fromkeys(_beyond(ranges, known, int(row)) for row in acting)),
    )


def _losses(base: BaseParameters, unit: Array) -> Array:
    """Rows r with r (friction / unit, 1) >= 0 where friction dissipates, shape (R, F + 1)."""
    place = {(each.kind, each.joint): k for k, each in enumerate(base.friction)}
    rows = []
    for kind, joint in place:
        row = np.zeros(len(place) + 1)
        if kind == 'offset':
            continue
        row[place[kind, joint]] = unit[place[kind, joint]]
        if kind == 'stribeck':  # with it, dry friction at rest
            row[place['coulomb', joint]] = unit[place['coulomb', joint]]
        rows.append(row)
        if kind == 'load':
            rows.append(np.append(np.zeros(len(place)), MOST_LOAD) - row)
    return np.array(rows)


class _Problem(NamedTuple):
    """min 1/2 |s y - b|^2 + weight * (distance of 1 + T y from 1), with r (y, 1) >= 0."""

    s: Array  # singular values, shape (N,)
    b: Array  # shape (N,)
    matrices: list[Array]  # T, each of shape (k, k, N)
    rows: Array  # r, shape (R, N + 1)

    def minimum(self, y: Array, name: Callable[[int], str]) -> Array:
        """The y of the minimum, from one at which the matrices are positive definite.

        Raises:
            InputError: no y meets the inequalities, of which `name` tells which.
        """
        slack = self.rows @ np.append(y, 1.0)
        if slack.min() <= 0.0:
            lengths = np.linalg.norm(self.rows[:, :-1], axis=1)
            wider = _Problem(
                np.append(0.0 * self.s, FIRM),
                np.append(0.0 * self.b, -FIRM),
                [np.pad(T, ((0, 0), (0, 0), (0, 1))) for T in self.matrices],
                np.insert(self.rows, -1, lengths, axis=1),
            )
            *inside, beyond = wider._on_path(np.append(y, 1.0 + np.max(-slack / lengths)))
            y = np.array(inside)
            slack = self.rows @ np.append(y, 1.0)
            if beyond >= 0.0:
                raise InputError(f'no robot that can be built has {name(int(slack.argmin()))}')
        return self._on_path(y)

    def _on_path(self, y: Array) -> Array:
        weight = max(WEIGHT, 0.5 * float(np.sum((self.s * y - self.b) ** 2)))
        while True:
            y = self._newton(y, weight)
            if weight <= WEIGHT:
                return y
            weight = max(REDUCTION * weight, WEIGHT)

    def _newton(self, y: Array, weight: float) -> Array:
        slope, root = self._slopes(y, weight)
        for _ in range(ITERATIONS):
            R = np.linalg.qr(root, mode='r')
            step = -solve_triangular(R, solve_triangular(R, slope, trans='T'))
            decrement, share, new = float(-slope @ step), 1.0, y
            while share > SHORTEST and new is y:
                tried = y + share * step
                share *= 0.5
                if self._inside(tried):
                    there = self._slopes(tried, weight)
                    if there[0] @ step <= 0.5 * decrement:  # not far beyond the minimum on the way
                        new, (slope, root) = tried, there
            if new is y or not decrement > CLOSE * weight:
                return new
            y = new
        return y

    def _inside(self, y: Array) -> bool:
        if (self.rows @ np.append(y, 1.0) <= 0.0).any():
            return False
        try:
            for T in self.matrices:
                np.linalg.cholesky(np.eye(len(T)) + T @ y)
        except np.linalg.LinAlgError:
            return False
        return True

    def _slopes(self, y: Array, weight: float) -> tuple[Array, Array]:
        """First derivative, and J of the second one, J^T J."""
        slope, root = self.s * (self.s * y - self.b), [np.diag(self.s)]
        for T in self.matrices:
            one, flat = np.eye(len(T)), T.reshape(-1, len(y))
            half = np.linalg.inv(np.linalg.cholesky(one + T @ y))
            slope += weight * (one - half.T @ half).ravel() @ flat
            root.append(np.sqrt(weight) * np.kron(half, half) @ flat)
        each = self.rows[:, :-1] / (self.rows @ np.append(y, 1.0))[:, np.newaxis]
        inside = self.rows[:, -1] > 0.0  # at the centre, from which this does not draw away, then
        slope += BARRIER * weight * (self.rows[inside, :-1].sum(axis=0) - each.sum(axis=0))
        return slope, np.concatenate([*root, np.sqrt(BARRIER * weight) * each])


def _whitened(
    A: Array, b: Array, matrices: list[Array], rows: Array, centre: Array
) -> tuple[_Problem, Array]:
    """The problem in y, with z = centre + basis y, where |y| is the distance near the centre.

    Its basis vectors are what the data tell, and what they do not tell: however sharp the data
    are, rounding in the former is not felt in the latter.
    """
    scaled = []
    for matrix in matrices:
        half = np.linalg.inv(np.linalg.cholesky(matrix @ centre))
        scaled.append(np.einsum('ai,ijz,bj->abz', half, matrix, half))
    flat = np.concatenate([T.reshape(-1, len(centre)) for T in scaled])
    free = 1.0 - (np.abs(flat).max(axis=0) > 0.0)  # friction
    basis = np.linalg.inv(np.linalg.cholesky(flat.T @ flat + np.diag(free))).T
    left, singular, right = np.linalg.svd(A @ basis)
    basis = basis @ right.T
    s, told = np.zeros((2, len(centre)))
    s[: len(singular)] = singular
    told[: len(singular)] = (left.T @ (b - A @ centre))[: len(singular)]
    turned = np.column_stack([rows[:, :-1] @ basis, rows @ np.append(centre, 1.0)])
    lengths = np.linalg.norm(turned[:, :-1], axis=1)
    turned /= np.where(turned[:, -1] > 0.0, turned[:, -1], lengths)[:, np.newaxis]
    return _Problem(s, told, [T @ basis for T in scaled], turned), basis


def _ranges(bodies: Bodies, bounds: Bounds) -> dict[str, tuple[float, float]]:
    """Range of all that can be known; those that were given, and the widest of the others."""
    for name, (low, high) in bounds.items():
        if name not in bodies.known:
            raise UnknownNameError('name in --bounds', name, bodies.known)
        if not low < high:
            raise InputError(f'--bounds {name} must be LOW:HIGH, not {low:g}:{high:g}')
    return {name: bounds.get(name, (each.low, each.high)) for name, each in bodies.known.items()}


def _beyond(ranges: Bounds, known: list[Array], row: int) -> str:
    """Which range an inequality is of."""
    last = np.cumsum([len(each) for each in known])
    name, (low, high) = [*ranges.items()][int(np.searchsorted(last, row, side='right'))]
    return f'{name} from {low:.4g} to {high:.4g}'


def _rounded(
    robot: RobotModel, base: BaseParameters, errors: Array, given: dict[str, Any]
) -> dict[str, Any]:
    """Values of the keys with no more digits than are known, of which a robot can be built."""
    model, nominal = linear_model(robot), robot.parameters
    least = np.append(errors[: len(base.K)], sizes(robot) * SHARPEST)
    begin = {key: np.ravel(getattr(nominal, key)) for key in given}
    steps = {key: np.full(len(each), np.inf) for key, each in begin.items()}
    for key, value in given.items():
        for k in np.flatnonzero(np.ravel(value) != begin[key]):
            moved = np.ravel(value).astype(complex)
            moved[k] += 1e-20j
            changed = given | {key: tuple(moved) if np.ndim(value) else moved[0]}
            slopes = np.abs(model.values(nominal._replace(**changed)).imag) * 1e20
            of_base = np.abs(base.K) @ slopes
            both = np.append(of_base, slopes * (not of_base.any()))
            steps[key][k] = ROUNDED * np.min(least[both > 0.0] / both[both > 0.0], initial=np.inf)
    for finer in 10.0 ** -np.arange(9):
        found = {
            key: _shortened(np.ravel(value), finer * steps[key], begin[key])
            for key, value in given.items()
        }
        chosen = {
            key: tuple(each.tolist()) if np.ndim(given[key]) else float(each[0])
            for key, each in found.items()
        }
        with contextlib.suppress(RobotError):
            robot.module.validate(nominal._replace(**chosen))
            return chosen
    return given


def _shortened(values: Array, steps: Array, nominal: Array) -> Array:
    """Values with the decimals that some steps have; the nominal ones that are as near."""
    decimals = np.ceil(-np.log10(np.clip(steps, 1e-300, 1.0))).astype(int)
    pairs = zip(values.tolist(), decimals.tolist(), strict=True)
    short = np.array([round(value, places) for value, places in pairs])
    return np.where(np.abs(values - nominal) > 0.5 * steps, short, nominal)


def _root(correlation: Array) -> Array:
    """R with R^T R = C^-1, also where C is singular but for rounding, shape (B, B)."""
    sizes, vectors = np.linalg.eigh(correlation)
    least = SHARPEST**2 * sizes[-1]
    return np.asarray(vectors.T / np.sqrt(np.maximum(sizes, least))[:, np.newaxis])
