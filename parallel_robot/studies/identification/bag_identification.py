"""The robot of a bag identified, checked on a second bag, told and written."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.bag_reader import BagView, view
from parallel_robot.bags.run import joint_table
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.bags.run.run_windows import AlikeLines, RunWindows
from parallel_robot.studies.estimate import check_files, named_errors
from parallel_robot.studies.identification import (
    identified,
    least_squares,
    motor_lag,
    torque_constants,
)
from parallel_robot.studies.identification.measured_motion import RunMotion
from parallel_robot.studies.identification.motor_lag import LongestStretch, MotorLag, Rest, Resting
from parallel_robot.studies.identification.physical_robot import Bounds
from parallel_robot.studies.identification.readable import Identification
from parallel_robot.studies.identification.regression_rows import CUTOFF, highest_cutoff
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.common.options import optional_path, path
from parallel_robot_model.common.units import DEGREES
from parallel_robot_model.configuration.config import Place
from parallel_robot_model.configuration.fields import given_zero_angles, group
from parallel_robot_model.processes.blas_threads import one_blas_thread
from parallel_robot_model.robots.described.robot import DescribedRobot
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.plant import PlantParameters

LIMIT = 'plant.torque_limit'
HOLD_OUT = 1.0 / 3.0  # of the time, at the end
MOST_HELD_OUT = 0.9

_naming = partial(named_errors, f'{least_squares.NOT_THESE_INERTIAS}: {{}}')


@one_blas_thread()
def identify(
    bag: Place,
    *,
    validate: Place | None = None,
    hold_out: float = HOLD_OUT,
    out: Place | None = None,
    figure: Place | None = None,
    cutoff: float | None = None,
    bounds: Mapping[str, tuple[float, float]] | Sequence[str] = (),
    all: bool = False,
    torque_constant: float | str | Iterable[float | str] = (),
    **options: Any,
) -> Identification:
    """Identify inertia and friction of the robot of a bag, as ``parallel_robot identify`` does.

    >>> import parallel_robot as pr
    >>> heavy = {'true_robot.mp': 4.0}
    >>> pr.save(pr.simulate('excitation', law='pid', duration=3, **heavy), 'runs/excited')
    >>> found = pr.identify('runs/excited')
    >>> round(found.values['robot.mp'], 1)
    4.0

    Args:
        bag: Bag with a motion that excites, or a table of it, .csv or .parquet, with a header as
            t [s], q1 [rad], q2 [rad], tau1 [N m], tau2 [N m].
        validate: Another bag of the same robot, whose torques are predicted, or FROM:TO [s], a
            part of this one that `stop` or `start` leaves out.
        hold_out: Share of the time, at the end, on which a fit to what is before it is judged;
            default: a third; 0: none.
        out: YAML file of the robot, for `param_file`, which must not exist; default: none.
        figure: Picture of the torques, measured and predicted: .png, .pdf, .svg; likewise.
        cutoff: Bandwidth of the regression [Hz]; default: 10, or a tenth of the rate.
        bounds: What is known, NAME=LOW:HIGH: mass [kg] of all, payload, m[LINK], x[LINK], y[LINK]
            or z[LINK], between which [m] a link's mass lies in its frame; may be repeated; in
            Python ``{'mass': (25, 35)}``.
        all: Whether all parameters and their intervals are shown.
        torque_constant: Of the motors of a table with currents, i1 [A] ..., in place of torques:
            one for all joints, or one for each [N m/A], the gear ratio in it; auto: to be found.
        options: What a bag does not say itself, see ``load``, and keys of its configuration.

    Returns:
        The robot as keys of the configuration, ``values``, with tables and warnings.

    Raises:
        BagError: one is no bag of a run, too little of it can be used, or of another robot; its
            efforts are no torques, or what is found does not explain them.
        InputError: a value is wrong, a file cannot be written, or the robot has no linear model.
    """
    place, second_bag = path('a bag', bag), optional_path('validate', validate)
    robot_file, picture = optional_path('out', out), optional_path('figure', figure)
    check_files(robot_file, picture)
    asked = view(**options)._replace(torque_constant=_constants(torque_constant))
    limits = bounds if isinstance(bounds, Mapping) else bounds_of(bounds)
    found = _identified(place, second_bag, cutoff, asked, limits, hold_out)
    found.all = all
    found.write(robot_file, picture)
    return found


def _constants(given: float | str | Iterable[float | str]) -> tuple[float | None, ...]:
    """Torque constants [N m/A], None for those that are to be found."""
    several = [given] if isinstance(given, str) or not isinstance(given, Iterable) else given
    try:
        return tuple(None if each == joint_table.AUTO else float(each) for each in several)
    except (TypeError, ValueError):
        raise InputError(f'torque_constant must be numbers, not {given!r}') from None


def _identified(
    bag: Path,
    validate: Path | None,
    cutoff: float | None,
    view: BagView,
    bounds: Bounds,
    hold_out: float,
) -> Identification:
    if cutoff is not None and not (isinstance(cutoff, Real) and math.isfinite(cutoff)):
        raise InputError(f'--cutoff must be a frequency in Hz, not {cutoff!r}')
    if not (isinstance(hold_out, Real) and 0.0 <= hold_out <= MOST_HELD_OUT):
        raise InputError(f'--hold-out must be from 0 to {MOST_HELD_OUT:g}, not {hold_out!r}')
    window = _window(validate, bag, view)
    if window:
        validate = bag
    elif validate and validate.resolve() == bag.resolve():
        raise InputError(f'--validate needs another bag than {bag}, or FROM:TO, a part of it')
    first = _looked_through(bag, view)
    nominal = identified.nominal_of(first.log)
    if cutoff is None:
        cutoff = min(CUTOFF, highest_cutoff(first.motion))
    warnings: list[str] = []
    constants, second = None, None
    if None in view.torque_constant:
        joints = first.log.joints
        given = np.broadcast_to(np.array(view.torque_constant, float), len(joints))
        with _naming(bag):
            constants = torque_constants.find(
                nominal, first.motion, cutoff, joints, given, hold_out
            )
            constants.check()
        values = tuple(constants.values.tolist())
        view = view._replace(torque_constant=values)
        window = window and window._replace(torque_constant=values)
        first = _looked_through(bag, view)
        warnings += [f'{bag}: {constants.doubt}'] if constants.doubt else []
    if validate:
        second = _looked_through(validate, window or view._replace(start=None, stop=None))
        identified.check_same_robot(first.log, second.log)
        warnings += second.warnings
    warnings += first.warnings
    unsure = first.log.joints_differ.text or first.doubt
    with _naming(bag, unsure):
        found = identified.identify(nominal, first.motion, cutoff, bounds, hold_out)
    if hold_out and not found.held_out:
        warnings.append(f'{bag}: nothing is held out: too little motion is before, or in, its end')
    if found.left.doubt:
        warnings.append(f'{bag}: {found.left.doubt}')
    if second is None or validate is None:
        checked = identified.compare(found)
    else:
        with _naming(validate):
            guess = identified.nominal_of(second.log).guess
            checked = identified.predict(found, second.motion, guess, cutoff)
    with _naming(validate or bag, first.doubt):
        unseen = checked if second else found.held_out or checked
        doubt = identified.judge(found, unseen, first.log.joints)
    warnings += [f'{validate or bag}: {doubt}'] if doubt else []
    return Identification(
        bag,
        first.log.joints,
        found,
        checked,
        second is not None,
        first.rest,
        first.lag,
        constants,
        tuple(warnings),
    )


def _window(validate: Path | None, bag: Path, view: BagView) -> BagView | None:
    """The part of the bag that validates, if FROM:TO was given in place of a bag."""
    ends = str(validate).split(':')
    try:
        begin, end = map(float, ends)
    except ValueError:
        return None
    start, stop = view.start or 0.0, np.inf if view.stop is None else view.stop
    if begin < stop and start < end:
        fitted = f'{start:g} to {stop:g} s'.replace('inf s', 'the end')
        raise InputError(
            f'--validate {validate} is a part of what is fitted, {fitted} of {bag}: '
            '--from or --to leaves it out'
        )
    return view._replace(start=begin, stop=end)


class _LookedThrough(NamedTuple):
    """A bag that was looked through once; see :class:`Identification`."""

    log: RunLog
    motion: RunMotion
    rest: Rest | None
    lag: MotorLag | None
    warnings: list[str]
    doubt: str  # what may be why it cannot be used, empty if nothing


def _looked_through(bag: Path, view: BagView) -> _LookedThrough:
    if view.torque_constant and not joint_table.is_table(bag):
        what = f'--torque-constant is for currents in a table, not for the bag {bag}'
        raise InputError(
            f'{what}: export it, and call its efforts i1 [A], i2 [A] ... in the header'
        )
    run = RunWindows(bag, view)
    if joint_table.is_table(bag) and not run.log.has_efforts:
        raise BagError(f'{bag}: {joint_table.NO_TORQUES}')
    config = run.log.config
    limit = np.array(group(config, PlantParameters, 'plant').torque_limit)
    robot = robot_of(config)
    if run.log.foreign and isinstance(robot.module, DescribedRobot) and LIMIT not in view.values:
        made = robot.module.machine(robot.parameters)
        limit[~np.isfinite(np.subtract(made.effort, made.least_effort))] = np.inf  # is a guess

    def look(windows: Iterator[RunLog]) -> _LookedThrough:
        told, still, stretch = AlikeLines(), Resting(run.period), LongestStretch(run.period)
        velocities = measured = False

        def seen() -> Iterator[RunLog]:
            nonlocal velocities, measured
            for log in windows:
                measured |= log.has_efforts or bool(len(log.command))
                velocities |= bool(len(log.velocity)) and log.has_velocities
                told.take(bag, log)
                if log.efforts_differ.grave:
                    raise BagError(f'torques are needed: {log.efforts_differ.text}')
                still.add(log)
                stretch.add(log)
                yield log
            if not measured:
                raise BagError('torques are needed: joint states have no efforts, or not all')

        with _naming(bag, _untold(run.log)):
            motion = RunMotion(
                seen(), run.period, run.history.statuses, limit, given_zero_angles(config)
            )
        warnings = [
            line if line.startswith(str(bag)) else f'{bag}: not used: {line}'
            for line in (*told.lines, *motion.left_out)
        ]
        if velocities and joint_table.is_table(bag):
            warnings.append(f'{bag}: not used: velocities, but for the noise at rest')
        warnings += [f'{bag}: {line}' for line in motion.doubts]
        doubt = '; '.join([*motion.doubts, *filter(None, [_untold(run.log)])])
        return _LookedThrough(run.log, motion, still.rest(), stretch.lag(), warnings, doubt)

    return run.evaluated(look)


def sensor_noise(bag: Place, **options: Any) -> Rest:
    """Only the noise of the sensors, of a robot that rests, e.g. whose drives are off.

    >>> import parallel_robot as pr
    >>> noise = {'sensor.position_noise': 1e-5, 'trajectory.shape': 'hold'}
    >>> pr.save(pr.simulate('paper_circle', law='pid', duration=2, **noise), 'runs/still')
    >>> pr.sensor_noise('runs/still').position.shape
    (3,)

    Args:
        bag: Directory of the bag, its MCAP file, or a table of joints, CSV or Parquet.
        options: What it does not say itself, see ``load``, and keys of its configuration.

    Raises:
        BagError: it is no bag of a run, or its robot never rests.
        InputError: a value is wrong.
    """
    place = path('a bag', bag)
    run = RunWindows(place, view(**options))

    def look(windows: Iterator[RunLog]) -> Rest | None:
        still = Resting(run.period)
        for log in windows:
            still.add(log)
        return still.rest()

    found = run.evaluated(look)
    if found is None:
        raise BagError(f'{place}: {motor_lag.NO_REST}')
    return found


def bounds_of(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges from words ``NAME=LOW:HIGH``, of which one end may be left out.

    Raises:
        InputError: a word is none.
    """
    found = {}
    for word in words:
        name, _, text = word.rpartition('=')
        low, colon, high = text.partition(':')
        try:
            ends = float(low or -np.inf), float(high or np.inf)
        except ValueError:
            colon = ''
        if not (name and colon):
            raise InputError(f'--bounds takes NAME=LOW:HIGH, not {word!r}')
        found[name] = ends
    return found


def _untold(log: RunLog) -> str:
    """Which units are not told, or doubted, in words; empty if none."""
    found = (joint_table.UNTOLD, DEGREES)
    lines = (
        line.partition(': ')[2] for line in log.warnings if any(each in line for each in found)
    )
    return next(lines, '')
