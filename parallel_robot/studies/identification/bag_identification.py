"""The robot of a bag identified, checked on a second bag, told and written."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.run import joint_table
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.bags.run.run_windows import AlikeLines, RunWindows
from parallel_robot.studies.estimate import OF_BAG, named_errors
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
from parallel_robot_model.common.options import refuse
from parallel_robot_model.common.units import DEGREES
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
    bag: Path,
    validate: Path | None = None,
    cutoff: float | None = None,
    view: BagView = AS_RECORDED,
    bounds: Bounds | None = None,
    hold_out: float = HOLD_OUT,
) -> Identification:
    """Identify the robot of a bag.

    Args:
        bag: Directory of the bag, its MCAP file, or a table of joints, CSV or Parquet.
        validate: Another bag of the same robot, whose torques are predicted, or FROM:TO [s]: that
            part of the bag, of which `view` leaves another part.
        cutoff: Bandwidth of the regression [Hz]; None: CUTOFF, or a tenth of the rate.
        view: What they do not say themselves; the part of it is of the first one.
        bounds: What is known of the robot: ranges by name.
        hold_out: Share of the time, at the end, on which a fit to what is before it is judged; 0:
            the robot is judged on what it was fitted to.

    Raises:
        BagError: one is no bag of a run, too little of it can be used, or of another robot; its
            efforts are no torques, or what is found does not explain them.
        InputError: a value is wrong, or the robot has no linear model.
    """
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


def at_rest(bag: Path, view: BagView = AS_RECORDED) -> Rest:
    """Noise of the sensors of a bag, where the robot rests.

    Args:
        bag: Directory of the bag, or its MCAP file.
        view: What it does not say itself, and which part is wanted.

    Raises:
        BagError: it is no bag of a run, or its robot never rests.
    """
    run = RunWindows(bag, view)

    def look(windows: Iterator[RunLog]) -> Rest | None:
        still = Resting(run.period)
        for log in windows:
            still.add(log)
        return still.rest()

    found = run.evaluated(look)
    if found is None:
        raise BagError(f'{bag}: {motor_lag.NO_REST}')
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


# What identifying is asked for: a robot, only the noise at rest, or an exciting motion.

OF_ROBOT = ('validate', 'figure', 'cutoff', 'bounds', 'hold-out', 'torque-constant')


def check_options(options: Mapping[str, Any]) -> None:
    """Refuse options that do not go together.

    Args:
        options: What was given, by the names of the command's options; None, False or an empty
            list or mapping where nothing was.

    Raises:
        InputError: options do not go together.
    """
    if (options['bag'] is None) == (options['design'] is None):
        raise InputError('identify takes either a bag or --design SCENARIO')
    if options['design'] is not None:
        refuse(options, ('rest', *OF_ROBOT, 'scenario', *OF_BAG), '--design reads no bag: no {}')
        return
    refuse(options, ('trials', 'seed'), '{} goes with --design alone')
    if options['rest']:
        refuse(options, ('out', *OF_ROBOT), '--rest identifies no robot: no {}')
