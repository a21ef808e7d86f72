"""A robot that can be built and has given base parameters, as near to the nominal one as possible.

Masses and inertias are positive, centres of mass lie on their links, friction dissipates. These
are bounds of the parameters themselves, so every candidate of the search is physical:

    min |R (beta(x) - beta)|^2 + (WEIGHT |x / x_nominal - 1|)^2,   R^T R = covariance^-1

Base parameters determine fewer numbers than a robot has; the second term, which is small,
keeps the others where they were. Centres of mass move only if nothing else does.

Source:
    Yoshida, Khalil (2000), Verification of the positive definiteness of the inertial matrix of
    manipulators using base inertial parameters, Int. J. Robotics Research 19(5).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from parallel_robot.studies.identification.base_parameters import BaseParameters, linear_model
from parallel_robot.studies.identification.least_squares import Fit
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import plain
from parallel_robot_model.robots.registry import RobotModel

WEIGHT = 1e-3  # of a relative change of a parameter, in standard errors of the fit
SMALLEST = 1e-6  # of the nominal value, the smallest that counts as positive
SHARPEST = 1e-6  # of the size of a parameter, the smallest standard error that is believed
STEPS = 500  # of the search with centres of mass that move
MISFIT = 0.05  # standard errors that a constraint may cost before it counts as active


@dataclass(frozen=True)
class PhysicalRobot:
    """Physical parameters.

    Attributes:
        robot: Keys of the robot that were chosen, with their values.
        nominal: The same keys with their nominal values.
        viscous: Viscous friction per joint [N m s/rad].
        coulomb: Coulomb friction per joint [N m].
        values: Base parameters of this robot, shape (B,).
        misfit: Largest difference to the estimate [standard errors].
    """

    robot: dict[str, Any]
    nominal: dict[str, Any]
    viscous: Array
    coulomb: Array
    values: Array
    misfit: float

    @property
    def active(self) -> bool:
        """Whether no robot that can be built has the estimated base parameters."""
        return self.misfit > MISFIT


def nearest(
    robot: RobotModel, base: BaseParameters, fit: Fit, scale: Array, friction: tuple[Array, Array]
) -> PhysicalRobot:
    """Find the physical robot.

    Args:
        robot: The nominal robot.
        base: Its base parameters.
        fit: Their estimate.
        scale: Their sizes, shape (B,).
        friction: Nominal viscous and Coulomb friction, each shape (n,).
    """
    model = linear_model(robot)
    ranges: Mapping[str, tuple[float, float]] = model.free(robot.parameters)
    nominal = {key: plain(getattr(robot.parameters, key)) for key in ranges}
    start = np.concatenate([np.ravel(value) for value in nominal.values()])
    lengths = [np.size(value) for value in nominal.values()]
    low, high = (np.repeat([bound[side] for bound in ranges.values()], lengths) for side in (0, 1))
    centre = np.repeat([bound[1] < np.inf for bound in ranges.values()], lengths)
    size = np.where(start != 0.0, np.abs(start), np.where(centre, high, 1.0))
    held = (start == 0.0) & (low >= 0.0)  # e.g. no payload: none is invented
    n = base.joints
    friction_scale = scale[-2 * n :]
    low = np.concatenate(
        [np.where(low >= 0.0, np.maximum(low / size, SMALLEST), low / size), np.zeros(2 * n)]
    )
    high = np.concatenate([high / size, np.full(2 * n, np.inf)])
    low[: len(start)][held], high[: len(start)][held] = -1e-12, 1e-12

    def named(x: Array) -> dict[str, Any]:
        every = np.where(held, start, x[: len(start)] * size)
        parts = np.split(every, np.cumsum(lengths)[:-1])
        return {
            key: tuple(part) if isinstance(nominal[key], list) else part[0]
            for key, part in zip(nominal, parts, strict=True)
        }

    def values(x: Array) -> Array:
        inertia = model.values(robot.parameters._replace(**named(x)))
        return base.of(inertia, *np.split(x[len(start) :] * friction_scale, 2))

    sharp = np.diag((SHARPEST * scale) ** 2)
    errors = np.sqrt(np.diag(fit.covariance) + np.diag(sharp))
    root = _root((fit.covariance + sharp) / np.outer(errors, errors)) / errors

    def cost(x: Array) -> Array:
        away = WEIGHT * (x[: len(start)] - start / size)
        return np.concatenate([root @ (values(x) - fit.values), away])

    def misfit(x: Array) -> float:
        return float(np.max(np.abs(values(x) - fit.values) / errors))

    nominal_x = np.concatenate([start, *friction]) / np.concatenate([size, friction_scale])
    inside = np.clip(nominal_x, low, high)
    # 1. With the centres of mass where they were, the cost is linear in x: one convex problem.
    free = np.concatenate([~centre & ~held, np.ones(2 * n, bool)])
    steps = np.eye(len(inside))[free]
    at = cost(inside)
    columns = np.array([cost(inside + step) - at for step in steps]).T
    bounds = (low - inside)[free], (high - inside)[free]
    found = inside + lsq_linear(columns, -at, bounds, method='bvls').x @ steps
    # 2. If that does not do, they move, too.
    if misfit(found) > MISFIT:
        margin = np.minimum(1e-9 * np.maximum(np.abs(found), 1.0), 0.25 * (high - low))
        begin = np.clip(found, low + margin, np.maximum(high - margin, low + margin))
        bounds = low, high
        moved = least_squares(
            cost, begin, jac='cs', bounds=bounds, x_scale='jac', max_nfev=STEPS
        ).x
        found = moved if misfit(moved) < misfit(found) else found
    viscous, coulomb = np.split(found[len(start) :] * friction_scale, 2)
    chosen = {key: plain(value) for key, value in named(found).items()}
    return PhysicalRobot(chosen, nominal, viscous, coulomb, values(found), misfit(found))


def _root(correlation: Array) -> Array:
    """R with R^T R = C^-1, also where C is singular but for rounding, shape (B, B)."""
    sizes, vectors = np.linalg.eigh(correlation)
    least = SHARPEST**2 * sizes[-1]
    return np.asarray(vectors.T / np.sqrt(np.maximum(sizes, least))[:, np.newaxis])
