"""What the controller takes for the motion of the joints: measured, derived or predicted."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from parallel_robot_control.contract import Law
from parallel_robot_control.estimation.lock_in import LockInParameters
from parallel_robot_control.estimation.recent_torques import MOST
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, internal, kernel, multiply, select
from parallel_robot_model.configuration.fields import Field, PerJoint, ZeroAngle
from parallel_robot_model.robots.contract import Model

KINDS = ('auto', 'none', 'filter', 'levant', 'kalman', 'aged')
AUTO, NONE, FILTER, LEVANT, KALMAN, AGED = range(6)
MEASURED = (NONE, AGED)  # aged, of laws alone: with the age, and the reference of now
IDENTIFY = 'identify'


class EstimatorParameters(NamedTuple):
    """Where the controller has the motion of the joints from."""

    kind: Annotated[
        Literal['auto', 'none', 'filter', 'levant', 'kalman'],
        Field(
            '',
            'auto: as the law asks; none: as measured; velocities by filter: filtered difference, '
            'levant: differentiator; kalman: motion and disturbance when the torque acts',
        ),
    ]
    zero_angle: ZeroAngle
    bandwidth: Annotated[float, Field('Hz', 'of the filter', 1e-3)]
    acceleration: Annotated[
        PerJoint, Field('rad/s^2', 'bound of the accelerations for the differentiator', 1e-3)
    ]
    delay: Annotated[
        float | Literal['stamp', 'identify'],
        Field(
            's',
            'age of the states that their stamps do not tell; stamp: none; identify: found while '
            'the robot moves, see lock_in',
            0.0,
        ),
    ]
    command_delay: Annotated[float, Field('s', 'from a command until it acts (kalman)', 0.0)]
    lag: Annotated[float, Field('s', 'time constant of the motors after that (kalman)', 0.0)]
    velocities: Annotated[bool, Field('', 'measured velocities are used (kalman)')]
    position_noise: Annotated[
        PerJoint, Field('rad', 'noise of the positions, rms (kalman)', 1e-12)
    ]
    velocity_noise: Annotated[
        PerJoint, Field('rad/s', 'noise of the velocities, rms (kalman)', 1e-9)
    ]
    disturbance: Annotated[PerJoint, Field('N m', 'disturbance that varies, rms (kalman)', 1e-9)]
    disturbance_bandwidth: Annotated[float, Field('Hz', 'its bandwidth (kalman)', 1e-3)]
    offset: Annotated[
        PerJoint, Field('N m', 'constant disturbance, rms before it is known (kalman)', 0.0)
    ]
    coulomb: Annotated[
        PerJoint, Field('N m', 'dry friction, rms before it is known (kalman)', 0.0)
    ]
    levels: Annotated[
        float | Literal['auto'],
        Field(
            's',
            'time over which both noises and the disturbance are found while the robot moves; '
            '0: as given; auto: as the law asks (kalman)',
            0.0,
        ),
    ]

    @property
    def takes_velocities(self) -> bool:
        """Whether measured velocities are used, whichever law is active."""
        known = self.kind in ('filter', 'levant')
        return not known and (self.kind != 'kalman' or self.velocities)


class Estimated(NamedTuple):
    """Estimate of position [rad] and velocity [rad/s], each shape (n,)."""

    position: Array
    velocity: Array


def kind_for(parameters: EstimatorParameters, law: Law) -> int:
    """Number of the kind for a law: what the parameters say, or else what the law asks for."""
    wanted = (law.foreign or law).ESTIMATOR
    return KINDS.index(wanted if parameters.kind == KINDS[AUTO] else parameters.kind)


def levels_for(parameters: EstimatorParameters, law: Law) -> float:
    """Time over which levels are found for a law [s]; 0 for none."""
    return law.LEVELS if parameters.levels == KINDS[AUTO] else float(parameters.levels)


def resolved(
    parameters: EstimatorParameters, identification: LockInParameters, law: Law, period: float
) -> EstimatorParameters:
    """The parameters with numbers in place of words.

    Args:
        parameters: The parameters.
        identification: How the delay is identified, if it is.
        law: The law that gets the estimates.
        period: Control period [s].

    Raises:
        InputError: states and commands together are later than can be predicted.
    """
    key, delay = 'estimator.delay', 0.0
    if isinstance(parameters.delay, float):
        delay = parameters.delay
    elif parameters.delay == IDENTIFY:
        key, delay = 'lock_in.delay', identification.delay
    late = delay + parameters.command_delay + parameters.lag
    if late > MOST * period:
        others = 'estimator.command_delay' + (' and .lag' if parameters.lag else '')
        raise InputError(
            f'{key} and {others} must together be at most '
            f'{MOST} periods, {MOST * period:g} s, not {late:g}',
            key,
        )
    kind: Any = kind_for(parameters, law)
    return parameters._replace(kind=kind, delay=delay, levels=levels_for(parameters, law))


@kernel
def filtered(estimator: Any, before: Estimated, position: Array, dt: float) -> Estimated:
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
def differentiated(estimator: Any, before: Estimated, position: Array, dt: float) -> Estimated:
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
    estimator: Any, before: Estimated, initialized: bool, position: Array, dt: float
) -> Estimated:
    """Estimates at a sample; at the first one, the robot is taken to be at rest.

    Args:
        estimator: Which one, FILTER or LEVANT.
        before: The last estimates.
        initialized: Whether there are any.
        position: Measured angles [rad], shape (n,).
        dt: Time since the last sample [s].
    """
    if estimator.kind == FILTER:
        estimate = filtered(estimator, before, position, dt)
    else:
        estimate = differentiated(estimator, before, position, dt)
    return select(initialized, estimate, Estimated(position, np.zeros_like(position)))


# Which torque acts on the robot besides that of the motors: a generalised-momentum observer.
#
# It tells that commands do not act where joint states report no efforts.


class Observed(NamedTuple):
    """What the observer keeps from one state to the next, each shape (n,)."""

    momentum: Array  # generalised momentum p = M qd [N m s]
    drift: Array  # rate of the momentum without any torque, C^T qd - g [N m]
    residual: Array  # external torque r, as far as it is known [N m]


@internal
def observed(
    bandwidth: float,
    before: Observed,
    initialized: bool,
    model: Model,
    velocity: Array,
    torque: Array,
    dt: float,
) -> Observed:
    """Compare the change of the momentum with what the commanded torque makes of it.

    With p = M qd, and as M' - 2 Q is skew-symmetric, p' = tau + Q^T qd - g + tau_ext, and

        r = K (p - integral of (tau + Q^T qd - g + r) dt),  that is  r' = K (tau_ext - r):

    it needs no accelerations and no inverse of M. Friction, and what the nominal robot is wrong
    by, count as external torque; so does a command that does not act, with its sign reversed.
    The equation is solved exactly from state to state, for a torque and an external torque that
    are constant in between and a drift that changes evenly.

    Args:
        bandwidth: K [1/s].
        before: What the last state left.
        initialized: Whether there was one; if not, there is no residual yet.
        model: Nominal model at the state; Q^T qd is its C^T qd.
        velocity: Rates of the joints there [rad/s], shape (n,).
        torque: Commanded torque since the last state [N m], shape (n,).
        dt: Time since then [s].

    Source:
        De Luca, Mattone (2005), Sensorless robot collision detection and hybrid force/motion
        control, IEEE ICRA; De Luca, Albu-Schaeffer, Haddadin, Hirzinger (2006), Collision
        detection and safe reaction with the DLR-III lightweight manipulator arm, IEEE/RSJ IROS.
    """
    momentum = multiply(model.M, velocity)
    drift = -model.gravity
    for i in range(len(velocity)):
        drift = drift + velocity[i] * model.Q[i]
    decay = math.exp(-bandwidth * dt)
    external = (momentum - before.momentum) / dt - torque - 0.5 * (drift + before.drift)
    residual = decay * before.residual + (1.0 - decay) * external
    return Observed(momentum, drift, select(initialized, residual, np.zeros_like(velocity)))
