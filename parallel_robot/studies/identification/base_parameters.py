"""Base parameters: the combinations of parameters on which the torques depend.

Source:
    Gautier (1991), Numerical calculation of the base inertial parameters of robots, J. Robotic
    Systems 8(4).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import LinearModel
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel

STATES = 200  # with which combinations are found
MOST = 5  # parameters that are told of a combination, beside the first
ROUNDING = 1e-12  # of the largest column of a regressor: one that is zero
NOTHING = 1e-9  # of the largest pivot: a column that depends on those before it


@dataclass(frozen=True)
class BaseParameters:
    """Base parameters beta = K p of a robot, then its friction."""

    # names of the base parameters of the inertia, e.g. ``a + 0.05333 mp``, then of the friction
    names: tuple[str, ...]
    units: tuple[str, ...]  # their units
    kept: tuple[int, ...]  # columns of the regressor that are independent
    K: Array  # base parameters of the inertia by p, shape (B, P)
    joints: int  # number of the actuated joints

    def of(self, inertia: Array, viscous: Array, coulomb: Array) -> Array:
        """Base parameters with these values, shape (B + 2 n,)."""
        return np.concatenate([self.K @ inertia, viscous, coulomb])

    def scale(self, inertia: Array, viscous: Array, coulomb: Array) -> Array:
        """Sizes to which errors are compared: sums of magnitudes, shape (B + 2 n,)."""
        sizes = np.concatenate([np.abs(self.K) @ np.abs(inertia), viscous, coulomb])
        return np.where(sizes > 0.0, sizes, 1.0)


def find(
    robot: RobotModel, positions: Iterable[Array], count: int, guess: Array
) -> BaseParameters:
    """Find the base parameters at some joint positions, whatever velocity and acceleration are.

    Args:
        robot: The robot.
        positions: Joint positions in the order of a motion, part by part [rad], each shape (N, n).
        count: How many there are in all.
        guess: Pose near the first one, shape (m,).

    Raises:
        InputError: the robot has no linear model.
        KinematicsError: a position has no pose.
    """
    model = linear_model(robot)
    wanted = np.linspace(0, count - 1, STATES).astype(int)
    kept, first = [], 0
    for part in positions:
        pose = poses_of(robot, part, guess, any_mode=True, first=first)
        rows = wanted[(wanted >= first) & (wanted < first + len(part))] - first
        kept.append((part[rows], pose[rows]))
        if len(part):
            guess, first = pose[-1], first + len(part)
    position, pose = (np.concatenate(each) for each in zip(*kept, strict=True))
    rng = np.random.default_rng(1)
    velocity, acceleration = rng.normal(size=(2, STATES, position.shape[1]))
    Y = model.regressor(robot.parameters, pose, position, velocity, acceleration)
    Y = Y.reshape(-1, Y.shape[-1])
    size = np.linalg.norm(Y, axis=0)
    Y[:, size <= ROUNDING * size.max()] = 0.0  # of what moves nothing
    # A column without a new direction has a zero on the diagonal of R (no pivoting).
    R = np.linalg.qr(Y / size.clip(1e-300), mode='r')
    pivots = np.abs(np.diag(R))
    columns = np.flatnonzero(pivots > NOTHING * pivots.max())
    K: Array = np.linalg.lstsq(Y[:, columns], Y, rcond=None)[0].astype(np.float64)
    K[np.abs(K) < NOTHING] = 0.0
    units = model.units(robot.parameters)
    symbols = list(units)
    names = [_sum(K[row], symbols, column) for row, column in enumerate(map(int, columns))]
    n = position.shape[1]

    def each(unit: str) -> list[str]:
        return [robot.joint_units.one(k).of(unit) for k in range(n)]

    friction = [f'{kind}{k}' for kind in ('viscous', 'coulomb') for k in range(1, n + 1)]
    return BaseParameters(
        (*names, *friction),
        (*(units[symbols[column]] for column in columns), *each('N m s/rad'), *each('N m')),
        tuple(map(int, columns)),
        K,
        n,
    )


def linear_model(robot: RobotModel) -> LinearModel:
    """Linear model of a robot.

    Raises:
        InputError: it has none.
    """
    model: LinearModel | None = getattr(robot.module, 'linear_model', None)
    if model is None:
        raise InputError(
            f'the robot {robot.name} cannot be identified: its module has no linear_model, '
            'see docs/identification.md'
        )
    return model


def sizes(robot: RobotModel) -> Array:
    """Magnitudes of the parameters of its inertia, shape (P,)."""
    model = linear_model(robot)
    own = getattr(model, 'sizes', model.values)
    return np.asarray(own(robot.parameters))


def _sum(factors: Array, symbols: list[str], own: int) -> str:
    """A base parameter as a formula, e.g. ``Ip - 0.04 mp``."""
    text, others = symbols[own], [k for k in np.flatnonzero(factors) if k != own]
    for column in others[:MOST]:
        factor = factors[column]
        times = f'{abs(factor):.4g} '.removeprefix('1 ')
        text += f' {"+" if factor > 0.0 else "-"} {times}{symbols[column]}'
    more = len(others) - MOST
    return f'{text} + {more} more' if more > 0 else text
