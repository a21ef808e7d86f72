"""Torque constants of motors whose currents were measured, from the bodies that joints share.

Each joint's current is u (Y beta) plus friction in A, with u one over its torque constant. A body
that several joints move has the same parameters in all of them, which tells how their constants
are to each other. What they are in N m/A, joints tell whose constants are known, or else bodies.

Source:
    Gautier, Briot (2014), Global identification of joint drive gains and dynamic parameters of
    robots, J. Dynamic Systems, Measurement, and Control 136(5); Golub, Pereyra (1973), The
    differentiation of pseudo-inverses and nonlinear least squares problems whose variables
    separate, SIAM J. Numerical Analysis 10(2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.optimize import least_squares

from parallel_robot.studies.identification import regression_rows
from parallel_robot.studies.identification.base_parameters import columns_of
from parallel_robot.studies.identification.identified import Nominal, Regression
from parallel_robot.studies.identification.least_squares import (
    RANK,
    USUAL,
    Estimate,
    Squares,
    squares_of,
    typical,
    with_uncertainty,
)
from parallel_robot.studies.identification.measured_motion import RunMotion
from parallel_robot.studies.identification.regression_rows import Rows
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import Array, JointUnits

CLOSE = 1e-5  # of their logarithms, where the search ends
WEIGHTS = 3  # times that the joints are weighted anew
DOUBTFUL = 0.25  # relative half width of an interval that is told
RANGE = np.log(100.0)  # of the ratio of two constants, either way

Some = TypeVar('Some', Rows, Squares)


class TorqueConstants(NamedTuple):
    """What was found."""

    joints: tuple[str, ...]  # their names
    values: Array  # torque constants, gears in them [N m/A], shape (n,)
    half_width: Array  # half widths of their 95 % intervals; 0 where they were given
    by_bodies: bool  # whether the bodies of the nominal robot tell their common factor
    units: JointUnits  # units of the joints

    def wider_than(self, share: float) -> str:
        """Names of those whose half interval is above a share of them; empty for none."""
        pairs = zip(self.joints, self.half_width > share * np.abs(self.values), strict=True)
        return ', '.join(name for name, wide in pairs if wide)

    @property
    def doubt(self) -> str:
        """Which ones are hardly told; empty for none."""
        names = self.wider_than(DOUBTFUL)
        return f'the motion hardly tells the torque constant of {names}' if names else ''

    def check(self) -> None:
        """Refuse what is not told at all."""
        if names := self.wider_than(1.0):
            raise BagError(
                f'the motion does not tell the torque constant of {names}: give it by '
                '--torque-constant, with that of a joint that moves others'
            )

    def parts(self) -> list[Part]:
        """What is told of them."""
        own = 'by bodies' if self.by_bodies else 'given'
        rows = [
            [name, f'{value:.4g}', f'+- {half:.2g}' if half else own]
            for name, value, half in zip(self.joints, self.values, self.half_width, strict=True)
        ]
        told: list[Part] = [
            Table(['joint', self.units.label('torque constant [N m/A]'), ''], rows)
        ]
        if self.by_bodies:
            what = 'bodies of the robot file; intervals are of what they are to each other'
            told.append(f'their common factor is that of the {what}')
        return told

    def as_data(self) -> list[dict[str, Any]]:
        """The same as plain data."""
        return [
            {'joint': name, 'value': float(value), 'half_width': float(half)}
            for name, value, half in zip(self.joints, self.values, self.half_width, strict=True)
        ]


def find(
    nominal: Nominal,
    motion: RunMotion,
    cutoff: float,
    joints: Sequence[str],
    given: Array,
    hold_out: float = 0.0,
) -> TorqueConstants:
    """Find torque constants of motors.

    Args:
        nominal: The nominal robot.
        motion: Its motion, with currents [A] in place of torques.
        cutoff: Bandwidth of the regression [Hz].
        joints: Names of the joints.
        given: Those that are known [N m/A], shape (n,); NaN for the others.
        hold_out: Share of the time, at the end, that is not used.
    """
    base = regression_rows.base_of(motion, nominal.robot, nominal.guess)
    columns = columns_of(['viscous', 'coulomb', 'offset'], base.joints)
    speed = USUAL * typical(motion.speed)
    base = base.with_friction([*columns, *columns_of(['stribeck'], base.joints, speed)])
    if hold_out:
        motion = motion.before(motion.begin + (1.0 - hold_out) * motion.duration)
    regression = Regression(nominal, base, motion, cutoff)
    squares, scale = squares_of(regression.rows()), regression.scale
    B, n = len(base.inertias), len(joints)
    current, Y = squares.torque, squares.Y * scale
    free = np.isnan(given)
    by_bodies = bool(free.all())
    if by_bodies:
        free[np.argmax(squares.rms(np.zeros(len(scale))))] = False
    work = np.einsum('kj,kjj->j', current, squares.Y[..., B : B + n])  # viscous friction's: > 0
    usual = 1.0 if by_bodies else np.median(np.abs(given[~free]))
    start = 1.0 / np.where(np.isnan(given), np.where(work < 0.0, -usual, usual), given)

    def shares(x: Array) -> Array:
        found = start.copy()
        found[free] *= np.exp(x)
        return found

    def solved(x: Array, weight: Array) -> tuple[Array, Array]:
        """Parameters over their sizes, and an orthonormal basis of what they may explain."""
        columns = np.concatenate([shares(x)[:, np.newaxis] * Y[..., :B], Y[..., B:]], axis=2)
        U, size, V = np.linalg.svd(
            (weight[:, np.newaxis] * columns).reshape(-1, len(scale)), full_matrices=False
        )
        told = size > RANK * size[0]
        U = U[:, told]
        return V[told].T @ (U.T @ (weight * current).ravel() / size[told]), U

    def left(x: Array, weight: Array) -> Array:
        """Weighted currents that no parameters explain."""
        flat, U = (weight * current).ravel(), solved(x, weight)[1]
        return np.asarray(flat - U @ (U.T @ flat))

    def slopes(x: Array, weight: Array) -> Array:
        """Those of `left` by x, without those of U on what is left (Kaufman)."""
        z, U = solved(x, weight)
        moved = (weight * shares(x) * (Y[..., :B] @ z[:B]))[..., np.newaxis] * axes
        flat = moved.reshape(-1, len(x))
        return np.asarray(U @ (U.T @ flat) - flat)

    axes, x, weight = np.eye(n)[:, free], np.zeros(int(free.sum())), np.ones(n)
    for _ in range(WEIGHTS):
        some = left(x, weight).reshape(-1, n) / weight
        size = np.sqrt((some**2).sum(axis=0) / np.maximum(np.diag(squares.together), 1.0))
        weight = 1.0 / np.maximum(size, 1e-9 * size.max() + 1e-15)
        x = least_squares(
            left, x, slopes, bounds=(-RANGE, RANGE), xtol=CLOSE, kwargs={'weight': weight}
        ).x
    z, share = solved(x, weight)[0], shares(x)
    values = np.concatenate([z * scale, np.zeros(len(x))])

    def linear(of: Some) -> Some:
        """Rows, or their squares, with the slopes by log(u) of what is free."""
        bodies = share[:, np.newaxis] * of.Y[..., :B]
        by_share = (bodies @ values[:B])[..., np.newaxis] * axes
        return replace(of, Y=np.concatenate([bodies, of.Y[..., B : len(scale)], by_share], 2))

    found = Estimate(values, np.diag(weight**2), 0.0)
    sizes = np.append(scale, np.ones(len(x)))
    fit = with_uncertainty(found, linear(squares), sizes, map(linear, regression.rows()))
    half = np.zeros(n)
    half[free] = fit.half_widths[len(scale) :] / np.abs(share[free])
    factor = 1.0
    if by_bodies:
        own, theirs = squares.Y[..., :B] @ values[:B], squares.Y[..., :B] @ regression.before[:B]
        factor = float(np.sum(own * theirs) / np.sum(own**2))
    return TorqueConstants(
        tuple(joints), factor / share, np.abs(factor) * half, by_bodies, nominal.robot.joint_units
    )
