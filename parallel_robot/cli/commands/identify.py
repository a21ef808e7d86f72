"""The command ``identify``: inertia and friction of the robot from the motion in a bag."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from parallel_robot.analysis.report import figures
from parallel_robot.bags import new_files, recording
from parallel_robot.bags.limits import add_memory_argument
from parallel_robot.cli.commands import simulate
from parallel_robot.studies.identification import (
    design,
    identified,
    measured_motion,
    readable,
    rest,
    robot_file,
    unexplained,
)
from parallel_robot.studies.identification.regression_rows import CUTOFF, highest_cutoff
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import BagError, InputError

TRIALS = 2500
SEED = 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, nargs='?', help='bag with a motion that excites')
    parser.add_argument(
        '--rest',
        action='store_true',
        help='only the noise of the sensors, e.g. of a robot whose drives are off',
    )
    parser.add_argument(
        '--validate', type=Path, metavar='BAG', help='another bag, whose torques are predicted'
    )
    parser.add_argument(
        '--out', type=Path, metavar='FILE', help='write the robot as YAML, for --param-file'
    )
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='torques, measured and predicted: png, pdf, svg',
    )
    parser.add_argument('--format', choices=('text', 'json'), help='of the results, default: text')
    parser.add_argument(
        '--cutoff',
        type=float,
        metavar='HZ',
        help=f'bandwidth, default {CUTOFF:g}, or a tenth of the rate',
    )
    parser.add_argument(
        '--design',
        metavar='SCENARIO',
        help='no bag: search for the coefficients of its exciting trajectory, write them to --out',
    )
    parser.add_argument('--trials', type=int, metavar='N', help=f'of --design, default {TRIALS}')
    parser.add_argument('--seed', type=int, help=f'of --design, default {SEED}')
    simulate.add_set_argument(parser)
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.out:
        new_files.check(arguments.out, '--out')
    if (arguments.bag is None) == (arguments.design is None):
        raise InputError('identify takes either a bag or --design SCENARIO')
    if arguments.design is not None:
        return _design(arguments)
    _refuse(
        arguments, ('assignments', 'param_files', 'trials', 'seed'), '{} goes with --design alone'
    )
    if arguments.rest:
        return _rest(arguments)
    return _identify(arguments)


NAMES = {'assignments': 'set', 'param_files': 'param-file'}  # of options by what holds them


def _refuse(arguments: argparse.Namespace, options: Iterable[str], why: str) -> None:
    """Refuse options that have no meaning.

    Args:
        arguments: The arguments.
        options: What must not be given.
        why: What is said of one.

    Raises:
        InputError: one is given.
    """
    for option in options:
        given = getattr(arguments, option)
        if not (given is None or given is False or given == []):
            raise InputError(why.format(f'--{NAMES.get(option, option)}'))


def _rest(arguments: argparse.Namespace) -> int:
    """Tell the noise of the sensors alone."""
    _refuse(
        arguments, ('out', 'validate', 'figure', 'cutoff'), '--rest identifies no robot: no {}'
    )
    still = rest.of(recording.read(arguments.bag, memory=arguments.max_memory).log)
    if still is None:
        raise BagError(f'{arguments.bag}: {rest.NONE}')
    if arguments.format == 'json':
        print(json.dumps({'rest': still.as_data()}, indent=2))
    else:
        print('\n'.join(still.lines()))
    return 0


def _identify(arguments: argparse.Namespace) -> int:
    """Identify a robot, check it on a second bag, write what was asked for."""
    cutoff = arguments.cutoff
    if cutoff is not None and not np.isfinite(cutoff):
        raise InputError(f'--cutoff must be a frequency in Hz, not {cutoff:g}')
    if arguments.figure:
        figures.check_format(arguments.figure)
        new_files.check(arguments.figure, '--figure')
    if arguments.validate and arguments.validate.resolve() == arguments.bag.resolve():
        raise InputError(f'--validate needs another bag than {arguments.bag}')
    memory = arguments.max_memory
    log, recorded = measured_motion.read(arguments.bag, memory)
    nominal = identified.nominal_of(log)
    still = rest.of(log)
    second = None
    if arguments.validate:
        second = measured_motion.read(arguments.validate, memory)
        identified.check_same_robot(log, second[0])
        _warn(arguments.validate, (*second[0].warnings, *second[1].left_out))
    _warn(arguments.bag, (*log.warnings, *recorded.left_out))
    if cutoff is None:
        cutoff = min(CUTOFF, highest_cutoff(recorded))
    with _naming(arguments.bag):
        found = identified.identify(nominal, recorded, cutoff)
    if found.left.doubt:
        print(f'warning: {arguments.bag}: {found.left.doubt}', file=sys.stderr)
    if second is None:
        title, checked = 'torque error, rms, same bag [N m]', identified.compare(found, found.rows)
    else:
        title = 'torque error, rms, validation [N m]'
        with _naming(arguments.validate):
            guess = identified.nominal_of(second[0]).guess
            checked = identified.predict(found, second[1], guess, cutoff)
    try:
        with contextlib.ExitStack() as written:
            if arguments.out:
                noise = still.parameters() if still else {}
                content = robot_file.text(found, str(arguments.bag), noise).encode()
                written.enter_context(new_files.written(arguments.out, content))
            if arguments.figure:
                rows = checked.rows
                figures.draw_prediction(
                    rows.time, log.joints, rows.torque, checked.torque, arguments.figure
                )
    except OSError as error:
        raise InputError(f'cannot write {error.filename}: {error.strerror}') from None
    if arguments.format == 'json':
        data = readable.as_data(found, checked, log.joints)
        data['rest'] = still.as_data() if still else None
        print(json.dumps(data, indent=2))
        return 0
    noise_lines = still.lines() if still else [rest.NONE]
    tables = (readable.table(found), readable.prediction(title, checked, log.joints), noise_lines)
    print('\n'.join(line for table in tables for line in table))
    for name, path in (('robot', arguments.out), ('figure', arguments.figure)):
        if path:
            print(f'{name:<7} {path}')
    return 0


def _design(arguments: argparse.Namespace) -> int:
    """Search for an exciting trajectory and write its parameters."""
    _refuse(arguments, ('rest', 'validate', 'figure', 'cutoff'), '--design reads no bag: no {}')
    if arguments.format == 'json':
        raise InputError('--design reads no bag: no --format json')
    if arguments.out is None:
        raise InputError('--design needs --out FILE for the coefficients')
    trials = TRIALS if arguments.trials is None else arguments.trials
    seed = SEED if arguments.seed is None else arguments.seed
    if trials < 1:
        raise InputError(f'--trials must be at least 1, not {trials}')
    if seed < 0:
        raise InputError(f'--seed must not be negative, not {seed}')
    values = resolve(arguments.design, simulate.given(arguments))
    found = design.design(values, trials, seed)
    comment = (
        f'# Exciting trajectory for {values["robot_model"]}: condition number '
        f'{found.quality.condition:.4g} ({trials} trials, seed {seed}).\n'
    )
    tree = {design.SHAPE: found.parameters, 'plant': {'initial_pose': found.parameters['center']}}
    try:
        new_files.write(arguments.out, (comment + robot_file.dump(tree)).encode())
    except OSError as error:
        raise InputError(f'cannot write {arguments.out}: {error.strerror}') from None
    for name, quality in (('before', found.before), ('now', found.quality)):
        if quality is not None:
            print(
                f'{name:<13}weakest combination {quality.weakest:.4g} N m, '
                f'condition number {quality.condition:.4g}'
            )
    print(f'{"coefficients":<13}{arguments.out}')
    return 0


def _warn(bag: Path, lines: Iterable[str]) -> None:
    for line in lines:
        text = line if line.startswith(str(bag)) else f'{bag}: not used: {line}'
        print(f'warning: {text}', file=sys.stderr)


@contextlib.contextmanager
def _naming(bag: Path) -> Iterator[None]:
    """Errors of a bag with its name."""
    try:
        yield
    except BagError as error:
        raise BagError(f'{bag}: {error}') from None
    except np.linalg.LinAlgError as error:
        raise BagError(f'{bag}: {unexplained.UNKNOWN}: {error}') from None
