"""Velocities from positions, for robots that do not measure them: a filter or a differentiator."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.fields import Field, PerJoint
from parallel_robot_base.kernel import kernel
from parallel_robot_base.vector_select import clip, select
from parallel_robot_base.vector_types import vector

Array = NDArray[np.float64]

NONE, FILTER, LEVANT = 0, 1, 2
KINDS = {'none': NONE, 'filter': FILTER, 'levant': LEVANT}


class EstimatorParameters(NamedTuple):
    """Where the controller has the velocities from."""

    kind: Annotated[
        Literal['none', 'filter', 'levant'],
        Field('', 'none: as measured; filter: filtered difference; levant: differentiator'),
    ]
    bandwidth: Annotated[float, Field('Hz', 'of the filter', 1e-3)]
    acceleration: Annotated[
        PerJoint, Field('rad/s^2', 'bound of the accelerations for the differentiator', 1e-3)
    ]


class Estimator(NamedTuple):
    """The parameters as the kernels take them: a number, [Hz], [rad/s^2] of shape (n,)."""

    kind: int
    bandwidth: float
    acceleration: Array


class Estimated(NamedTuple):
    """Estimate of position [rad] and velocity [rad/s], each shape (n,)."""

    position: Array
    velocity: Array


def estimator_of(parameters: EstimatorParameters) -> Estimator:
    """Make the estimator from its parameters."""
    kind = KINDS[parameters.kind]
    return Estimator(kind, parameters.bandwidth, vector(parameters.acceleration))


@kernel
def filtered(estimator: Estimator, before: Estimated, position: Array, dt: float) -> Estimated:
    """Difference of two positions behind a low-pass filter of first order.

    v <- v + (1 - exp(-2 pi f dt)) ((q - q_before) / dt - v)

    Args:
        estimator: Its bandwidth f.
        before: The last position, and the last estimate v of the velocity.
        position: Measured angles q [rad], shape (n,).
        dt: Time since the last sample [s].
    """
    share = 1.0 - math.exp(-2.0 * math.pi * estimator.bandwidth * dt)
    difference = (position - before.position) / dt
    return Estimated(position, before.velocity + share * (difference - before.velocity))


@kernel
def differentiated(
    estimator: Estimator, before: Estimated, position: Array, dt: float
) -> Estimated:
    """Levant's differentiator of first order, solved for its next state (backward Euler).

    With sigma = z - q, where q is the position, z its estimate and v that of the velocity,

        dz/dt = -1.5 L^(1/2) |sigma|^(1/2) sgn(sigma) + v,  dv/dt = -1.1 L sgn(sigma),

    L bounds the acceleration. Its step is the root of a quadratic equation in |sigma|^(1/2), or
    sigma = 0, where the sign is any number from -1 to 1: so it does not chatter.

    Args:
        estimator: Its bound L of the accelerations.
        before: The last estimates z and v.
        position: Measured angles q [rad], shape (n,).
        dt: Time since the last sample [s].

    Source:
        Levant (1998), Robust exact differentiation via sliding mode technique, Automatica 34(3).
    """
    a = 1.5 * dt * np.sqrt(estimator.acceleration)
    c = 1.1 * dt * dt * estimator.acceleration
    b = before.position + dt * before.velocity - position
    over = np.abs(b) - c
    root = 0.5 * (np.sqrt(a * a + 4.0 * select(over > 0.0, over, 0.0)) - a)
    sign = clip(b / c, -1.0, 1.0)
    return Estimated(position + root * root * sign, before.velocity - c * sign / dt)


@kernel
def estimated(
    estimator: Estimator, before: Estimated, known: bool, position: Array, dt: float
) -> Estimated:
    """Estimates at a sample; at the first one, the robot is taken to be at rest.

    Args:
        estimator: Which one, FILTER or LEVANT.
        before: The last estimates.
        known: Whether there are any.
        position: Measured angles [rad], shape (n,).
        dt: Time since the last sample [s].
    """
    if estimator.kind == FILTER:
        found = filtered(estimator, before, position, dt)
    else:
        found = differentiated(estimator, before, position, dt)
    return select(known, found, Estimated(position, np.zeros_like(position)))
