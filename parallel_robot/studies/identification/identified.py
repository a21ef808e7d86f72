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
from parallel_robot.studies.identification.base_parameters import (
    ALWAYS,
    FRICTION,
    BaseParameters,
    FrictionColumn,
    columns_of,
)
from parallel_robot.studies.identification.least_squares import (
    SPEEDS,
    USUAL,
    Blocks,
    Choice,
    Estimate,
    Fit,
    Squares,
    Unexplained,
)
from parallel_robot.studies.identification.measured_motion import RunMotion, rows_of
from parallel_robot.studies.identification.physical_robot import Bounds, PhysicalRobot
from parallel_robot.studies.identification.regression_rows import NOWHERE, At, Rows, SomeRows
from parallel_robot_control import configuration
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.registry import RobotModel, robot_of

LATEST = 0.02  # s, largest delay that is looked for
COUNTS = 0.2  # of a period, a delay that is taken into account
ITERATIONS = 12  # of what is not linear
# Half widths of the 95 % interval, the value of a column of friction that stays: where what it
# saves is above its interval, and where it is not.
SURE, SURER = 1.5, 1.8
CLOSE = 1e-4  # relative, of torques and of the speed of the Stribeck effect: it is found


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
    held_out: Prediction | None  # end of the motion by a robot that was fitted to the rest
    choice: Choice  # the friction that pays

    @property
    def left(self) -> Unexplained:
        """What the fit leaves of the torques."""
        size = np.maximum(self.squares.rms(np.zeros(len(self.fit.values))), 1e-300)
        return Unexplained(self.fit.residual / size, float(np.median(self.fit.correlation)))


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
        return _share(self.error, self.size)

    @property
    def share_before(self) -> Array:
        """The same of the nominal robot, shape (n,)."""
        return _share(self.nominal_error, self.size)


def _share(error: Array, size: Array) -> Array:
    """Errors over torques; NaN where there are none."""
    return np.where(size > 0.0, error / np.where(size > 0.0, size, 1.0), np.nan)


def nominal_of(log: RunLog) -> Nominal:
    """What a bag's configuration says of the robot."""
    robot, guess = configuration.nominal_of(log.config)
    return Nominal(robot, group(log.config, FrictionParameters, 'friction'), guess)


def identify(
    nominal: Nominal,
    motion: RunMotion,
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
    whole, of_begin, held_out = Regression(nominal, base, motion, cutoff), None, None
    split = motion.begin + (1.0 - hold_out) * motion.duration
    if hold_out:
        with contextlib.suppress(BagError):  # too little of the motion may be before that
            of_begin = _choice(whole._replace(motion=motion.before(split)))
    choice, fitted = of_begin or _choice(whole)
    if of_begin:
        robot = fitted.robot(bounds)
        after = split + regression_rows.SUPPORT / cutoff  # filters do not see what was fitted
        of_whole = fitted.regression._replace(motion=motion)
        parts = [
            rows_of(part, part.time > after) for part in of_whole.predicted(fitted.delay, robot)
        ]
        known = [part for part in parts if part.known.any()]
        held_out = _compared(robot.values, of_whole.before, known) if known else None
        fitted = _fit(whole.with_friction(choice.columns))
    fitted = _allowing_for_left_out(fitted)
    fit, scale, before = fitted.fit, fitted.regression.scale, fitted.regression.before
    # A size that was believed to be small is that of the estimate.
    names = fitted.regression.base.names
    sizes = np.maximum(scale, np.abs(fit.values))
    return Identified(
        nominal,
        fitted.regression.base,
        before,
        scale,
        fit,
        fitted.robot(bounds),
        least_squares.poorly_determined(fit, names, sizes, scale),
        fitted.squares,
        fitted.rows,
        fitted.delay,
        motion.period,
        held_out,
        choice,
    )


def predict(found: Identified, motion: RunMotion, guess: Array, cutoff: float) -> Prediction:
    """Predict the torques of a run by the physical robot.

    Args:
        found: The identified robot.
        motion: The run, of the same robot.
        guess: Pose near its first one, shape (m,).
        cutoff: Bandwidth within which torques are compared [Hz].
    """
    regression = Regression(replace(found.nominal, guess=guess), found.base, motion, cutoff)
    rows = regression.predicted(found.delay, found.robot)
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
    """What to doubt of an identified robot by what it leaves of the torques; empty if nothing."""
    left, nominal = (
        float(np.sqrt(np.nanmean(each**2))) for each in (checked.share, checked.share_before)
    )
    cause = _likely_cause(found, joints)
    if left > MOST or (left >= nominal and nominal > SMALL):
        raise BagError(
            f'no robot is found that explains the torques: {100.0 * left:.3g} % of them is left'
            f'{_where(checked, joints)}, {100.0 * nominal:.3g} % by the robot of the '
            f'configuration; {cause or least_squares.ANOTHER}'
        )
    if left >= nominal:
        return 'the robot of the configuration explains the torques as well as what is found'
    return cause


def _where(checked: Prediction, joints: Sequence[str]) -> str:
    """Which joints leave most, if others do not; else empty."""
    most = checked.share > MOST
    if not 0 < most.sum() < np.isfinite(checked.share).sum():
        return ''
    shares = zip(joints, 100.0 * checked.share, most, strict=True)
    told = (f'{share:.3g} % of {joint}' for joint, share, much in shares if much)
    return f' ({", ".join(told)}, less than {100.0 * MOST:g} % of the others)'


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
    told = factors[alike]
    if told.size and ((told >= FAR).all() or (told <= 1.0 / FAR).all()):
        factor = float(np.median(told))
        unit = found.nominal.robot.joint_units.of('N m')
        what = f'the torques are {factor:.2g} of those of the robot of the configuration'
        return f'{what}: are the efforts in {unit}, and no currents?'
    return ''


def check_same_robot(first: RunLog, second: RunLog) -> None:
    """Refuse a second run whose robot has another geometry or other joints."""
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


class Regression(NamedTuple):
    """Rows of a run, made anew each time; see :func:`regression_rows.rows`."""

    nominal: Nominal
    base: BaseParameters
    motion: RunMotion
    cutoff: float

    @property
    def before(self) -> Array:
        """Nominal parameters, shape (B + F,)."""
        return self.base.of(self.nominal.inertia, self.nominal.friction)

    @property
    def scale(self) -> Array:
        """Their sizes, shape (B + F,)."""
        sizes = base_parameters.sizes(self.nominal.robot)
        return self.base.scale(sizes, self.nominal.friction)

    def with_friction(self, columns: Iterable[FrictionColumn]) -> Regression:
        """The same with other columns of friction."""
        return self._replace(base=self.base.with_friction(columns))

    def rows(self, at: At = NOWHERE, step: float = 0.0) -> Iterator[Rows]:
        """Stretch by stretch."""
        robot, friction, guess = self.nominal.robot, self.nominal.friction, self.nominal.guess
        return regression_rows.rows(
            self.motion, robot, self.base, guess, friction.smoothing, self.cutoff, at, step
        )

    def predicted(self, delay: Delay, robot: PhysicalRobot) -> Iterator[Rows]:
        """Rows for the torques of a robot."""
        at = At(delay.value if delay.counts else 0.0, robot.values)
        return (rows.first(len(robot.values)) for rows in self.rows(at))


def _choice(regression: Regression) -> tuple[Choice, _Fitted]:
    """The friction that pays, of all kinds, or the usual one where there are few rows; its fit."""
    begin = regression.with_friction(columns_of([*FRICTION][: ALWAYS + 1], regression.base.joints))
    period = regression.motion.period
    _, at, squares, found = _solved(begin, step=0.1 * period)
    late = at.late if abs(at.late) > COUNTS * period else 0.0
    typical = least_squares.typical(regression.motion.speed)
    candidates = least_squares.candidates(regression.base, [share * typical for share in SPEEDS])
    every = regression._replace(base=candidates)
    time = [window.time[[0, -1]] for window in regression.motion.windows()]
    apart = regression_rows.SUPPORT / regression.cutoff
    blocks = Blocks(every.base, found, time[0][0], time[-1][-1], apart)
    nominal = every.before[len(every.base.inertias) :]
    known = [each for each, value in zip(every.base.friction, nominal, strict=True) if value]
    speeds = sorted({each.speed for each in known} - {0.0})[-1:]
    kept = [each for each in known if each.speed in (0.0, *speeds)]
    usual = Choice(tuple(dict.fromkeys([*regression.base.friction, *kept])), {})
    few = np.trace(squares.together) < regression_rows.FEWEST * len(every.base.names)
    if few or blocks.count < least_squares.FEWEST:
        return usual, _fit(regression.with_friction(usual.columns))
    values = 0.0 * every.before
    values[: len(begin.base.inertias)] = found.values[: len(begin.base.inertias)]
    for rows in every.rows(At(late, values)):
        blocks.add(rows.first(len(values)))
    choice = blocks.choose(every.before, every.scale) or usual
    while True:
        fitted = _fit(regression.with_friction(choice.columns))
        fit, first = fitted.fit, -len(choice.columns)
        values, widths = fit.values[first:], np.abs(fit.values / fit.half_widths)[first:]
        doubtful = {
            each
            for each, value, width in zip(choice.columns, values, widths, strict=True)
            if each in choice.saved
            and (
                width < (SURE if choice.pays(each) else SURER)
                or (each.kind == 'load' and value < 0.0)  # of which no robot can be built
            )
        }
        if not doubtful:
            return choice, fitted
        choice = choice.without(doubtful)


class _Fitted(NamedTuple):
    """A fit, and of what."""

    regression: Regression  # with the speed of its Stribeck effect
    squares: Squares
    rows: Rows  # some of them
    fit: Fit
    delay: Delay

    def robot(self, bounds: Bounds | None) -> PhysicalRobot:
        """The physical robot that has the estimate."""
        nominal, base, scale = self.regression.nominal, self.regression.base, self.regression.scale
        return physical_robot.nearest(
            nominal.robot, base, self.fit, scale, nominal.friction, bounds
        )


def _fit(regression: Regression) -> _Fitted:
    """Fit the parameters, together with a delay of the positions if there is one."""
    period = regression.motion.period
    step = 0.1 * period  # the slope is for a period of delay
    regression, at, squares, found = _solved(regression, step=step)
    fit, rows = _with_uncertainty(regression, at, step, squares, found)
    late = at.late + period * float(fit.values[-1])
    half = period * float(fit.half_widths[-1])
    delay = Delay(late, half, abs(late) > max(half, COUNTS * period))
    if not delay.counts:
        regression, at, squares, found = _solved(regression, At(0.0, at.values))
        fit, rows = _with_uncertainty(regression, at, 0.0, squares, found)
    count = len(regression.before)
    fit = replace(
        fit,
        values=fit.values[:count],
        covariance=fit.covariance[:count, :count],
        interval=fit.interval[:count],
    )
    return _Fitted(regression, squares.first(count), rows.first(count), fit, delay)


def _with_uncertainty(
    regression: Regression, at: At, step: float, squares: Squares, found: Estimate
) -> tuple[Fit, Rows]:
    """The estimate of a solution with its uncertainty, and some of its rows."""
    some, scale = SomeRows(), regression.scale
    scale = np.append(scale, np.ones(len(found.values) - len(scale)))
    rows = some.seen(regression.rows(at, step))
    return least_squares.with_uncertainty(found, squares, scale, rows), some.whole()


def _allowing_for_left_out(fitted: _Fitted) -> _Fitted:
    """The fit with intervals that allow for the kinds of friction that did not pay.

    A fit that has them tells what they are, and by how much the others move without them: that
    is added to their standard errors. Where a constant torque looks like gravity it does not pay,
    but gravity has it, and would be too sure (Leeb, Poetscher 2005, Model selection and inference:
    facts and fiction, Econometric Theory 21(1)).
    """
    regression, fit = fitted.regression, fitted.fit
    base, chosen = regression.base, len(fit.values)
    known = max(each.speed for each in base.friction)
    speed = known or USUAL * least_squares.typical(regression.motion.speed)
    every = least_squares.candidates(base, [speed]).friction
    left_out = [each for each in every if each not in base.friction]
    whole = regression.with_friction([*base.friction, *left_out])
    scale = whole.scale
    if np.trace(fitted.squares.together) < regression_rows.FEWEST * len(scale):
        return fitted
    values = np.append(fit.values, np.zeros(len(left_out)))
    at = At(fitted.delay.value if fitted.delay.counts else 0.0, values)
    squares = least_squares.squares_of(rows.first(len(scale)) for rows in whole.rows(at))
    of_all = least_squares.estimate(squares, whole.before, scale)
    Y = np.linalg.cholesky(of_all.weight).T @ squares.Y
    seen = (Y[..., chosen:] @ of_all.values[chosen:]).ravel()
    of_chosen = (Y[..., :chosen] * scale[:chosen]).reshape(-1, chosen)
    moved = np.linalg.lstsq(of_chosen, seen, rcond=None)[0] * scale[:chosen]
    wider = np.sqrt(1.0 + moved**2 / np.maximum(np.diag(fit.covariance), 1e-300)).round(6)
    return fitted._replace(fit=replace(fit, interval=fit.interval * wider))


def _solved(
    regression: Regression, at: At = NOWHERE, step: float = 0.0
) -> tuple[Regression, At, Squares, Estimate]:
    """Gauss-Newton's method for what is not linear: delay, Stribeck effect, friction by load.

    A delay d shifts the torques that belong to the positions: Y beta = tau(t - d), which is
    linearised in d again and again, with a `step` [s]; 0: it is known. The rows are made anew for
    each point. The regression that is returned has the speed of the Stribeck effect.
    """
    before, period = regression.before, regression.motion.period
    count, kinds = len(before), {each.kind for each in regression.base.friction}
    typical = least_squares.typical(regression.motion.speed)
    slowest, fastest = 0.5 * SPEEDS[0] * typical, 2.0 * SPEEDS[-1] * typical
    for k in range(ITERATIONS):
        fast = 'stribeck' in kinds and at.values is not None
        more = np.zeros(fast + bool(step))
        scale = np.append(regression.scale, more + 1.0)
        squares = least_squares.squares_of(regression.rows(at, step))
        found = least_squares.estimate(squares, np.append(before, more), scale)
        late = period * float(found.values[-1]) if step else 0.0
        new = found.values[:count] if kinds & {'stribeck', 'load'} else None
        faster = 0.0  # logarithm of a factor of the speed of the Stribeck effect
        if fast:
            speed = max(each.speed for each in regression.base.friction)
            wanted = speed * np.exp(np.clip(found.values[count], -1, 1))
            faster = float(np.log(np.clip(wanted, slowest, fastest) / speed))
        near = abs(late) <= 0.01 * period and abs(faster) <= CLOSE
        near = near and (new is None or _alike(squares.first(count), new, at.values))
        if near or k == ITERATIONS - 1:  # rows, estimate and uncertainty are of one point
            break
        at = At(float(np.clip(at.late + late, -LATEST, LATEST)), new)
        regression = regression.with_friction(
            each._replace(speed=float(np.exp(faster)) * each.speed)
            for each in regression.base.friction
        )
    return regression, at, squares, found


def _alike(squares: Squares, new: Array, old: Array | None) -> bool:
    """Whether torques by new values are about those by old ones, if there are any."""
    if old is None:
        return False
    size = np.maximum(squares.rms(0.0 * new), 1e-300)
    return bool(np.abs((squares.rms(new) - squares.rms(old)) / size).max() < CLOSE)
