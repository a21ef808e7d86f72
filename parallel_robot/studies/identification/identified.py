"""A robot identified from one run, and how well it predicts the torques of another."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.run import two_sources
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.studies.identification import (
    base_parameters,
    least_squares,
    physical_robot,
    regression_rows,
)
from parallel_robot.studies.identification.base_parameters import BaseParameters
from parallel_robot.studies.identification.least_squares import (
    Fit,
    Squares,
    Uncertainty,
    Unexplained,
)
from parallel_robot.studies.identification.measured_motion import Begin, Motion
from parallel_robot.studies.identification.physical_robot import Bounds, PhysicalRobot
from parallel_robot.studies.identification.regression_rows import Rows, SomeRows
from parallel_robot_control import configuration
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.registry import RobotModel, robot_of

LATEST = 0.02  # s, largest delay that is looked for
COUNTS = 0.2  # of a period, a delay that is taken into account
ITERATIONS = 5  # of the delay


@dataclass(frozen=True)
class Nominal:
    """The robot and friction of a bag's configuration."""

    robot: RobotModel
    friction: FrictionParameters  # friction of its joints
    guess: Array  # pose near the first one, shape (m,)

    @property
    def inertia(self) -> Array:
        """Parameters of the linear model, shape (P,)."""
        model = base_parameters.linear_model(self.robot)
        return np.asarray(model.values(self.robot.parameters))

    @property
    def both_frictions(self) -> tuple[Array, Array]:
        """Viscous and Coulomb friction, each shape (n,)."""
        return np.array(self.friction.viscous), np.array(self.friction.coulomb)


@dataclass(frozen=True)
class Delay:
    """How much older positions are than torques of the same stamp."""

    value: float  # the estimate [s]
    half_width: float  # half width of its 95 % interval [s]
    counts: bool  # whether it is so large that it is taken into account


@dataclass(frozen=True)
class Identified:
    """What was found of a robot."""

    nominal: Nominal  # its nominal values
    base: BaseParameters  # names of the base parameters
    before: Array  # their nominal values, shape (B,)
    scale: Array  # their sizes, shape (B,)
    fit: Fit  # their estimate
    robot: PhysicalRobot  # a physical robot that has them
    # combinations that the motion hardly shows, with their relative standard errors
    poor: list[tuple[str, float]]
    squares: Squares  # all rows of the regression, by their squares
    rows: Rows  # some of them, evenly, see :class:`SomeRows`
    delay: Delay  # how much older positions are than torques of the same stamp
    period: float  # time between two states [s]
    held_out: Prediction | None  # end of the motion by a robot that was fitted to what is before

    @property
    def left(self) -> Unexplained:
        """What the fit leaves of the torques."""
        return least_squares.unexplained(self.squares, self.fit)


@dataclass(frozen=True)
class Prediction:
    """Torques of a run, and how far off the predicted ones are."""

    rows: Rows  # some rows of the run, evenly, with the measured torques
    torque: Array  # the torques that are predicted of them [N m], shape (T, n)
    error: Array  # rms of their error per joint [N m], shape (n,)
    nominal_error: Array  # the same of the nominal robot
    size: Array  # rms of the measured torques per joint [N m], shape (n,)

    @property
    def share(self) -> Array:
        """The errors over the torques, shape (n,)."""
        return self.error / np.maximum(self.size, 1e-300)


def nominal_of(log: RunLog) -> Nominal:
    """What a bag's configuration says of the robot.

    Raises:
        InputError: its robot cannot be built.
    """
    robot, guess = configuration.nominal_of(log.config)
    return Nominal(robot, group(log.config, FrictionParameters, 'friction'), guess)


def identify(
    nominal: Nominal,
    motion: Motion,
    cutoff: float,
    bounds: Bounds | None = None,
    hold_out: float = 0.0,
) -> Identified:
    """Identify a robot.

    Args:
        nominal: The nominal robot, of which the geometry is taken to be true.
        motion: Its motion.
        cutoff: Bandwidth of the regression [Hz].
        bounds: What is known of the robot: ranges of what can be known of its bodies, by name.
        hold_out: Share of the time, at the end, that is predicted by a fit to what is before it;
            the robot is then fitted to all.

    Raises:
        InputError: the robot has no linear model, the cut-off frequency does not fit, or no robot
            is within the bounds.
        BagError: too little of the recording can be used, or a sample has no pose.
    """
    base_parameters.linear_model(nominal.robot)
    base = regression_rows.base_of(motion, nominal.robot, nominal.guess)
    friction, sizes = nominal.both_frictions, base_parameters.sizes(nominal.robot)
    before, scale = base.of(nominal.inertia, *friction), base.scale(sizes, *friction)

    def fitted(part: Motion) -> tuple[Squares, Rows, Fit, Delay, PhysicalRobot]:
        squares, rows, fit, delay = _fit(_Regression(nominal, base, part, cutoff), before, scale)
        frictions = nominal.both_frictions
        robot = physical_robot.nearest(nominal.robot, base, fit, scale, frictions, bounds)
        return squares, rows, fit, delay, robot

    held_out = None
    if hold_out:
        split = next(motion.windows()).time[0] + (1.0 - hold_out) * motion.duration
        with contextlib.suppress(BagError):  # too little of the motion is before that
            *_, delay, robot = fitted(Begin(motion, split))
            late = delay.value if delay.counts else 0.0
            after = split + regression_rows.SUPPORT / cutoff  # filters do not see what was fitted
            whole = _Regression(nominal, base, motion, cutoff).rows(late)
            parts = [part.of(part.time > after) for part in whole]
            known = [part for part in parts if part.known.any()]
            held_out = _compared(robot.values, before, known) if known else None
    squares, rows, fit, delay, robot = fitted(motion)
    # A size that was believed to be small is that of the estimate.
    poor = least_squares.poorly_determined(
        fit, base.names, np.maximum(scale, np.abs(fit.values)), scale
    )
    period = motion.period
    return Identified(
        nominal, base, before, scale, fit, robot, poor, squares, rows, delay, period, held_out
    )


def predict(found: Identified, motion: Motion, guess: Array, cutoff: float) -> Prediction:
    """Predict the torques of a run by the physical robot.

    Args:
        found: The identified robot.
        motion: The run, of the same robot.
        guess: Pose near its first one, shape (m,).
        cutoff: Bandwidth within which torques are compared [Hz].

    Raises:
        BagError: too little of the recording can be used, or a sample has no pose.
    """
    nominal = Nominal(found.nominal.robot, found.nominal.friction, guess)
    late = found.delay.value if found.delay.counts else 0.0
    rows = _Regression(nominal, found.base, motion, cutoff).rows(late)
    return _compared(found.robot.values, found.before, rows)


def compare(found: Identified) -> Prediction:
    """Predict the torques of the run from which the robot was identified."""
    return _prediction(found.robot.values, found.before, found.squares, found.rows)


def _compared(values: Array, before: Array, parts: Iterable[Rows]) -> Prediction:
    some = SomeRows()
    squares = least_squares.squares_of(some.seen(parts))
    return _prediction(values, before, squares, some.whole())


def _prediction(values: Array, before: Array, squares: Squares, rows: Rows) -> Prediction:
    error, nominal_error, size = (
        squares.rms(each) for each in (values, before, np.zeros(len(values)))
    )
    return Prediction(rows, rows.Y @ values, error, nominal_error, size)


MOST = 0.5  # of the torques, rms: a robot that leaves more explains nothing
SMALL = 0.05  # of the torques: a nominal robot that leaves no more is as good as an identified one
FAR = 5.0  # factor between torques and those of the nominal robot that is doubted


def judge(found: Identified, checked: Prediction, joints: Sequence[str]) -> str:
    """What to doubt of an identified robot by what it leaves of the torques; empty if nothing.

    Raises:
        BagError: it is no result: most is left, or more than the nominal robot leaves.
    """
    size = np.maximum(checked.size, 1e-300)
    left, nominal = (
        float(np.sqrt(np.mean((each / size) ** 2)))
        for each in (checked.error, checked.nominal_error)
    )
    cause = _likely_cause(found, joints)
    if left > MOST or (left >= nominal and nominal > SMALL):
        raise BagError(
            f'no robot is found that explains the torques: {100.0 * left:.3g} % of them is left, '
            f'{100.0 * nominal:.3g} % by the robot of the configuration; '
            + (cause or least_squares.ANOTHER)
        )
    if left >= nominal:
        return 'the robot of the configuration explains the torques as well as what is found'
    return cause


def _likely_cause(found: Identified, joints: Sequence[str]) -> str:
    """How the torques are those of the nominal robot but for order, sign or unit; else empty."""
    torque = found.squares.Y @ found.before
    ratio = two_sources.ratio_of_rows(found.squares.torque, torque)
    order, own = ratio.order, np.arange(len(joints))
    factors, alike = ratio.factors[own, order], ratio.left[own, order] < MOST
    if order != own.tolist() and alike.all():
        names = ', '.join(joints[k] for k in order)
        return f'they are those of its joints in the order {names}: efforts in another order?'
    wrong = [name for name, k in zip(joints, own, strict=True) if alike[k] and factors[k] < 0.0]
    if wrong:
        return f'those of {", ".join(wrong)} have the sign of the opposite torque: a wrong sign?'
    factor = float(np.median(factors))
    if alike.all() and not 1.0 / FAR < factor < FAR:
        unit = found.nominal.robot.joint_units.of('N m')
        what = f'the torques are {factor:.2g} of those of the robot of the configuration'
        return f'{what}: are the efforts in {unit}?'
    return ''


def check_same_robot(first: RunLog, second: RunLog) -> None:
    """Refuse a second run whose robot has another geometry or other joints.

    Raises:
        BagError: with the first key that differs.
    """
    robot = robot_of(first.config).parameters
    model = base_parameters.linear_model(robot_of(first.config))
    free = {f'robot.{key}' for key in model.parameters(robot, model.bodies(robot).numbers)}
    keys = ['robot_model', 'joints']
    keys += [key for key in first.config if key.startswith('robot.') and key not in free]
    for key in keys:
        one, other = first.config[key], second.config.get(key)
        if one != other:
            raise BagError(
                f'--validate needs a bag of the same robot: {key} is {other}, not {one}'
            )


class _Regression(NamedTuple):
    """Rows of a run, made anew each time; see :func:`regression_rows.rows`."""

    nominal: Nominal
    base: BaseParameters
    motion: Motion
    cutoff: float

    def rows(self, late: float, step: float = 0.0) -> Iterator[Rows]:
        """Stretch by stretch."""
        robot, friction, guess = self.nominal.robot, self.nominal.friction, self.nominal.guess
        return regression_rows.rows(
            self.motion, robot, self.base, guess, friction.smoothing, self.cutoff, late, step
        )


def _fit(regression: _Regression, before: Array, scale: Array) -> tuple[Squares, Rows, Fit, Delay]:
    """Fit the base parameters, together with a delay of the positions if there is one.

    A delay d shifts the torques that belong to the positions: Y beta = tau(t - d), which is
    linearised in d again and again (Gauss-Newton). The rows are made anew for each d, and once
    more for the uncertainties.
    """
    period, parameters = regression.motion.period, len(before)
    step = 0.1 * period  # the slope is for a period of delay
    both = np.append(before, 0.0), np.append(scale, 1.0)
    value = 0.0
    undelayed: Squares | None = None
    for _ in range(ITERATIONS):
        squares = least_squares.squares_of(regression.rows(value, step))
        undelayed = undelayed or squares
        found = least_squares.estimate(squares, *both)
        change = period * float(found.values[-1])
        estimate = float(np.clip(value + change, -LATEST, LATEST))
        at = value
        if abs(change) < 0.01 * period:
            break
        value = estimate
    delayed = Uncertainty(found, squares, both[1])
    some = SomeRows()
    for rows in some.seen(regression.rows(at, step)):
        delayed.add(rows)
    fit = delayed.fit()
    half = period * float(fit.interval[-1] * fit.standard_errors[-1])
    delay = Delay(estimate, half, abs(estimate) > max(half, COUNTS * period))
    if delay.counts:
        kept = replace(
            fit,
            values=fit.values[:-1],
            covariance=fit.covariance[:-1, :-1],
            interval=fit.interval[:-1],
        )
        return squares.first(parameters), some.whole().first(parameters), kept, delay
    assert undelayed is not None  # of the first iteration
    squares = undelayed.first(parameters)
    plain = Uncertainty(least_squares.estimate(squares, before, scale), squares, scale)
    some = SomeRows()
    for rows in some.seen(regression.rows(0.0)):
        plain.add(rows)
    return squares, some.whole(), plain.fit(), delay
