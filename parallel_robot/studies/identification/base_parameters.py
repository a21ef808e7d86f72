"""Base parameters: the combinations of parameters on which the torques depend.

Source:
    Gautier (1991), Numerical calculation of the base inertial parameters of robots, J. Robotic
    Systems 8(4).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.contract import LinearModel
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel

STATES = 200  # with which combinations are found
MOST = 5  # parameters that are told of a combination, beside the first
ROUNDING = 1e-9  # of the largest column of a regressor: one that is zero
# Of the largest pivot: a column that depends on those before it. A file that says 1.5708 has axes
# that are 4e-6 from parallel, which no torque tells. Of the largest column: one that comes last.
PARALLEL = 1e-5
NOTHING = 1e-9  # of a combination: a share that is none


# Kinds of friction of a joint, see FrictionParameters, with their units. The first two are always
# there, the others where they pay.
FRICTION = {
    'viscous': 'N m s/rad', 'coulomb': 'N m', 'offset': 'N m', 'stribeck': 'N m', 'load': '',
}  # fmt: skip
ALWAYS = 2


class FrictionColumn(NamedTuple):
    """A column of the regressor."""

    kind: str  # of FRICTION
    joint: int
    speed: float = 0.0  # that of the Stribeck effect [rad/s]


def columns_of(kinds: Iterable[str], joints: int, speed: float = 0.0) -> list[FrictionColumn]:
    """Columns of some kinds of friction, of all joints."""
    return [FrictionColumn(kind, joint, speed) for kind in kinds for joint in range(joints)]


@dataclass(frozen=True)
class BaseParameters:
    """Base parameters beta = K p of a robot, then its friction: F columns."""

    inertias: dict[str, str]  # names of the base parameters, as ``a + 0.05333 mp``, with units
    frictions: tuple[dict[str, str], ...]  # units of each kind of friction, joint by joint
    kept: tuple[int, ...]  # columns of the regressor that are independent
    K: Array  # base parameters of the inertia by p, shape (B, P)
    friction: tuple[FrictionColumn, ...]  # its columns

    @property
    def joints(self) -> int:
        """Number of the actuated joints."""
        return len(self.frictions)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all, e.g. ``viscous1`` of the friction."""
        return *self.inertias, *(f'{each.kind}{each.joint + 1}' for each in self.friction)

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        friction = (self.frictions[each.joint][each.kind] for each in self.friction)
        return *self.inertias.values(), *friction

    def with_friction(self, columns: Iterable[FrictionColumn]) -> BaseParameters:
        """The same with other columns of friction."""
        return replace(self, friction=tuple(columns))

    def of(self, inertia: Array, friction: FrictionParameters) -> Array:
        """Base parameters with these values, shape (B + F,)."""
        values = [getattr(friction, each.kind)[each.joint] for each in self.friction]
        return np.concatenate([self.K @ inertia, values])

    def scale(self, inertia: Array, friction: FrictionParameters) -> Array:
        """Sizes to which errors are compared: sums of magnitudes, shape (B + F,)."""
        magnitudes = replace(self, K=np.abs(self.K)).of(np.abs(inertia), friction)
        return np.where(magnitudes != 0.0, np.abs(magnitudes), 1.0)

    def with_values(self, friction: FrictionParameters, values: Array) -> FrictionParameters:
        """Friction with the values of its columns; kinds of the others are none."""
        found = {kind: [0.0] * self.joints for kind in FRICTION}
        for each, value in zip(self.friction, values.tolist(), strict=True):
            found[each.kind][each.joint] = value
        speed = max((each.speed for each in self.friction), default=0.0)
        changed: dict[str, Any] = {kind: tuple(each) for kind, each in found.items()}
        if speed:
            changed['stribeck_velocity'] = speed
        return friction._replace(**changed)


def find(
    robot: RobotModel, positions: Iterable[Array], count: int, guess: Array
) -> BaseParameters:
    """Find the base parameters at some joint positions, whatever velocity and acceleration are.

    Args:
        robot: The robot.
        positions: Joint positions in the order of a motion, part by part [rad], each shape (N, n).
        count: How many there are in all.
        guess: Pose near the first one, shape (m,).
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
    order = np.argsort(size <= PARALLEL * size.max(), kind='stable')
    R = np.linalg.qr((Y / size.clip(1e-300))[:, order], mode='r')
    pivots = np.abs(np.diag(R))
    columns = np.sort(order[pivots > PARALLEL * pivots.max()])
    K: Array = np.linalg.lstsq(Y[:, columns], Y, rcond=None)[0].astype(np.float64)
    K[np.abs(K) < NOTHING] = 0.0
    units = model.units(robot.parameters)
    symbols = list(units)
    own, n = tuple(map(int, columns)), position.shape[1]
    return BaseParameters(
        {_sum(K[row], symbols, k): units[symbols[k]] for row, k in enumerate(own)},
        tuple(
            {kind: each.of(unit) for kind, unit in FRICTION.items()}
            for each in map(robot.joint_units.one, range(n))
        ),
        own,
        K,
        tuple(columns_of([*FRICTION][:ALWAYS], n)),
    )


def linear_model(robot: RobotModel) -> LinearModel:
    """Linear model of a robot."""
    model = robot.module.linear_model
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
