"""The price of calm: the least error of any controller with a given chattering.

The linearised plant, held at a point of its motion, with a quadratic cost of error and
chattering, is the problem of linear-quadratic-Gaussian control: in the steady state no causal
controller, linear or not, has less of both. What is least is E |e|^2 + rho E |c|^2, c the torque
minus its moving mean. With the state, the disturbance and the torques of the last 20 ms as one
state X, the torque is u(k) = -K X(k | k-d), K from the Riccati equation of the cost. With P_j the
covariance of a prediction over j samples,

    Z = (A - B K) Z (A - B K)^T + P_(d+1) - P_d,    E |e|^2 = trace(J (Z + P_d) J^T).

The moving mean, which looks ahead, is 10 ms late here, and its zeros outside the unit circle are
reflected into it; neither changes a mean square.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import SMOOTH, samples_beside
from parallel_robot.studies.limit import (
    EXACT,
    LinearMotion,
    Noise,
    geometry_error,
    least,
    linearise,
    noise_of,
)
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_sim.configuration import Configuration, assemble_plant
from parallel_robot_sim.ideal_torque import coordinates_of, points_of

POINTS = 3  # of the second half of a motion
WEIGHTS = np.logspace(4.0, -4.5, 18)  # of chattering against error, in units of the model's own
REST = 1e-4  # usual weight of joints that the error does not see, relative
STEPS, ENOUGH = 60, 1e-10  # doublings, and the relative change after which there are no more


class Calm(NamedTuple):
    """Least errors by chattering, from the calmest controller to the busiest."""

    chattering: Array  # as the metrics have it [N m], shape (W,)
    error: Array  # least root mean square error [m], or [rad] without a plane, shape (W,)

    def at(self, chattering: float) -> float:
        """Least error with at most some chattering [N m]; NaN where it is calmer than all."""
        if not self.chattering[0] <= chattering:
            return math.nan
        near = np.log(np.maximum.accumulate(self.chattering))
        return float(np.exp(np.interp(math.log(chattering), near, np.log(self.error))))

    def own(self, chattering: float) -> float:
        """Least error at the chattering of a run [N m]; calmer than all: that of the calmest."""
        return self.at(max(chattering, float(self.chattering[0])))


class Point(NamedTuple):
    """The plant with its disturbance and its last torques, held at a point of the motion."""

    transition: Array  # from a sample to the next, shape (N, N)
    torque: Array  # what a torque adds to the next, shape (N, n)
    error: Array  # what the error is computed from, shape (p, N)
    rough: Array  # a signal with the mean square of the chattering, by state, shape (n, N)
    now: float  # and by the present torque
    rest: Array  # joint positions, with the weight of the rest, shape (n, N)
    late: Array  # covariance of the prediction that the controller has, shape (N, N)
    fresh: Array  # covariance of what it learns in a sample, shape (N, N)
    motor: float  # variance of the chattering that the motors themselves add [N^2 m^2]


def price_of_calm(motion: LinearMotion, noise: Noise, period: float, rest: float = REST) -> Calm:
    """Compute the least errors of controllers that are calm, some, or not at all.

    Args:
        motion: The linearised motion.
        noise: What is not known.
        period: Of the samples [s].
        rest: Weight of joints that the error does not see, relative.

    Raises:
        numpy.linalg.LinAlgError: there is no steady state.
    """
    ends = len(motion.times) - 1
    places = np.unique(np.linspace(ends // 2, ends, POINTS, endpoint=False).astype(int))
    points = [point_of(motion, noise, period, place, rest) for place in places]
    unit = np.mean([_unit(each, period) for each in points])
    squares = np.array([[variances(each, unit * w) for w in WEIGHTS] for each in points])
    error, chattering = np.sqrt(np.mean(squares, axis=0)).T
    return Calm(chattering, error)


def point_of(
    motion: LinearMotion, noise: Noise, period: float, place: int, weight: float = REST
) -> Point:
    """The plant at a point of the motion, and what its controller knows; `weight` of the rest."""
    # 1. Plant and disturbance, whose sign does not matter, and the filter in its steady state.
    A, B = motion.transition[place], motion.torque[place]
    states, joints = B.shape
    size = states + joints
    F = np.block([[A, B], [np.zeros((joints, states)), noise.memory * np.eye(joints)]])
    W = np.zeros((size, size))
    W[:states, :states] = (B * noise.motor**2) @ B.T
    W[states:, states:] = np.diag((1.0 - noise.memory**2) * noise.disturbance**2)
    spread = np.concatenate((noise.position, noise.velocity))
    used = np.isfinite(spread)
    C = (
        np.hstack((motion.measured[place][used], np.zeros((used.sum(), joints))))
        / spread[used, np.newaxis]
    )
    late = doubled(F.T, C.T @ C, W)
    late -= late @ C.T @ np.linalg.solve(C @ late @ C.T + np.eye(len(C)), C @ late)
    for _ in range(noise.late):
        late = F @ late @ F.T + W
    fresh = F @ late @ F.T + W - late
    # 2. The last torques, as many as the moving mean has but the present one.
    shape = _shape(period)
    count = len(shape) - 1
    whole = size + count * joints
    kept = np.eye(joints)
    transition, torque = np.zeros((whole, whole)), np.zeros((whole, joints))
    transition[:size, :size], torque[:states] = F, B
    rough = np.zeros((joints, whole))
    for back in range(count):
        place_of = size + back * joints
        rough[:, place_of : place_of + joints] = shape[back + 1] * kept
        if back:
            transition[place_of : place_of + joints, place_of - joints : place_of] = kept
        else:
            torque[place_of : place_of + joints] = kept
    error, rest = np.zeros((len(motion.error[place]), whole)), np.zeros((joints, whole))
    error[:, :states] = motion.error[place]
    rest[:, :states] = motion.measured[place][:joints]
    rest *= math.sqrt(weight) * np.linalg.norm(error) / np.linalg.norm(rest)
    known = np.zeros((2, whole, whole))
    known[:, :size, :size] = late, fresh
    motor = float(np.mean(noise.motor**2)) * float(shape @ shape)
    return Point(
        transition, torque, error, rough, float(shape[0]), rest, known[0], known[1], motor
    )


def _shape(period: float) -> Array:
    """What the chattering is of the present torque and of those before, shape (2 half + 1,).

    The torque minus its moving mean is that of half a mean ago. Zeros outside the unit circle
    are reflected into it, which changes no mean square, and keeps the numbers small.
    """
    half = samples_beside(period)
    shape = np.full(2 * half + 1, -1.0 / (2 * half + 1))
    shape[half] += 1.0
    zeros = np.roots(shape)
    outside = np.abs(zeros) > 1.0
    gain = shape[0] * np.prod(np.abs(zeros[outside]))
    zeros[outside] = 1.0 / zeros[outside].conj()
    return np.asarray(gain * np.poly(zeros).real, np.float64)


def variances(point: Point, weight: float) -> tuple[float, float]:
    """Mean squares of error and chattering under the best controller for a weight.

    Args:
        point: The plant.
        weight: Of the mean square chattering [m^2/(N m)^2].
    """
    joints = point.torque.shape[1]
    K = feedback(point, weight)
    Z = _covariance(point.transition - point.torque @ K, point.fresh)
    told = point.rough - point.now * K
    error = np.trace(point.error @ (Z + point.late) @ point.error.T)
    return float(error), float(np.trace(told @ Z @ told.T)) / joints + point.motor


def feedback(point: Point, weight: float) -> Array:
    """Gain K of the torque -K x of the least |error|^2 + weight |chattering|^2, shape (n, N)."""
    joints = point.torque.shape[1]
    each = weight / joints
    Q = point.error.T @ point.error + point.rest.T @ point.rest
    # A torque u at a state x costs (rough x + now u)^2, with v = u + rough x / now: (now v)^2.
    shift = point.rough / point.now
    cost = each * point.now**2
    A = point.transition - point.torque @ shift
    X = doubled(A, point.torque @ point.torque.T / cost, Q)
    inner = cost * np.eye(joints) + point.torque.T @ X @ point.torque
    return np.linalg.solve(inner, point.torque.T @ X @ A) + shift


def doubled(A: Array, G: Array, H: Array) -> Array:
    """Stabilising solution X of X = A^T X (I + G X)^-1 A + H, by doubling.

    Source:
        Chu, Fan, Lin, Wang (2004), Structure-preserving algorithms for periodic discrete-time
        algebraic Riccati equations, Int. J. Control 77(8).

    Raises:
        numpy.linalg.LinAlgError: there is none.
    """
    one = np.eye(len(A))
    for _ in range(STEPS):
        inverse = np.linalg.inv(one + G @ H)
        through = A @ inverse
        more = A.T @ H @ inverse @ A
        G = G + through @ G @ A.T
        A = through @ A
        H = H + 0.5 * (more + more.T)
        if not np.isfinite(H).all():
            break
        if np.abs(more).max() <= ENOUGH * np.abs(H).max():
            return H
    raise np.linalg.LinAlgError('the linear model of the motion has no steady state')


def _covariance(A: Array, W: Array) -> Array:
    """Z of Z = A Z A^T + W, by doubling."""
    for _ in range(STEPS):
        more = A @ W @ A.T
        W, A = W + more, A @ A
        if np.abs(more).max() <= ENOUGH * np.abs(W).max():
            return W
    raise np.linalg.LinAlgError('the linear model of the motion has no steady state')


def _unit(point: Point, period: float) -> float:
    """Square of the error that a torque makes within SMOOTH [m^2/(N m)^2]: unit of the weights."""
    moved = point.torque.copy()
    for _ in range(round(SMOOTH / period)):
        moved = point.transition @ moved + point.torque
    return float(np.sum((point.error @ moved) ** 2)) / moved.shape[1]


# How much of the least error each cause is answerable for: the limit without it.

NEGLIGIBLE = 1e-9  # m or rad: what rounding leaves of no limit at all
WHOLE = 'as it is'
CAUSES: dict[str, Callable[[Noise], Noise]] = {
    WHOLE: lambda noise: noise,
    'without delays': lambda noise: noise._replace(late=0),
    'positions exact': lambda noise: noise._replace(
        position=np.full_like(noise.position, EXACT[0])
    ),
    'velocities exact': lambda noise: noise._replace(
        velocity=np.full_like(noise.velocity, EXACT[1])
    ),
    'no velocities': lambda noise: noise._replace(velocity=np.full_like(noise.velocity, np.inf)),
    'without disturbance': lambda noise: noise._replace(
        disturbance=np.zeros_like(noise.disturbance), motor=np.zeros_like(noise.motor)
    ),
}


class LeastError(NamedTuple):
    """The least errors of one robot, over the second half of its motion."""

    errors: dict[str, float]  # root mean square by key of CAUSES [m], or [rad] without a plane
    # distance that the reference travels while a state is late, root mean square [m]. A law
    # that believes late states to be new is that far behind. NaN without a plane, and where
    # stamps tell when states were measured, so that no law need believe it
    travelled: float
    # error of a robot whose joints, as they are measured, are exactly where they should be:
    # that of its geometry and zero angles alone. NaN where it was not asked for
    geometry: float = np.nan
    # least errors by chattering; None where it was not asked for or the limit is zero
    calm: Calm | None = None


def _in_motion(configuration: Configuration) -> Configuration:
    """An experiment up to the end of its motion, as all metrics are."""
    end, loop = configuration.trajectory.end, configuration.loop
    if end is None or end >= loop.duration:
        return configuration
    return configuration.with_parts(loop=loop._replace(duration=end))


def least_error(
    configuration: Configuration, causes: bool = True, calm: bool = False, rest: float = REST
) -> LeastError:
    """Compute the least errors of one robot.

    Args:
        configuration: The experiment; its law and gains are of no account.
        causes: Whether all CAUSES are asked for, and what geometry costs, or only WHOLE.
        calm: Whether the price of calm is asked for.
        rest: Its weight of joints that the error does not see, relative.

    Raises:
        InputError: the robot does not reach the motion; there is no steady state to be calm in,
            or the period is too long for chattering.
    """
    configuration = _in_motion(configuration)
    loop, robot = configuration.loop, configuration.true_robot
    if calm and not samples_beside(loop.period):
        raise InputError(
            f'no price of calm with a period of {loop.period:g} s: chattering is what varies '
            f'within {SMOOTH:g} s; choose a shorter period'
        )
    noise = noise_of(configuration.imperfections, loop.period, len(loop.joints))
    asked = CAUSES if causes else {WHOLE: CAUSES[WHOLE]}
    times = points_of(loop.duration)
    if noise.moves():
        motion = linearise(configuration)
        found = {
            name: least(motion, without(noise), loop.period) for name, without in asked.items()
        }
    else:  # a state that is known at the start stays known, on a motion within reach
        poses = configuration.trajectory.sample(times).pose
        coordinates_of(robot, assemble_plant(configuration), poses)
        found = dict.fromkeys(asked, 0.0)
    steady = times[times >= 0.5 * times[-1]]
    travelled, price = np.nan, None
    told = configuration.imperfections.age > 0.0
    if robot.place and not told:
        rate = configuration.trajectory.sample(steady).pose_rate[:, : robot.place]
        late = np.floor(configuration.imperfections.sensor.delay / loop.period + 0.5) * loop.period
        travelled = float(late * np.sqrt(np.mean(np.sum(rate**2, axis=1))))
    geometry = geometry_error(configuration, steady) if causes else np.nan
    if calm and found[WHOLE] > NEGLIGIBLE:
        try:
            price = price_of_calm(motion, noise, loop.period, rest)
        except np.linalg.LinAlgError as error:
            raise InputError(f'no price of calm: {error}') from None
    return LeastError(found, travelled, geometry, price)
