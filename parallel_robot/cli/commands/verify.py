"""The command ``verify``: simulated plants against MuJoCo, or a robot against its contract."""

from __future__ import annotations

import argparse
import functools
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from parallel_robot.bags.output import tracked
from parallel_robot.cli.commands import simulate
from parallel_robot.cli.shared import add_format_argument, show
from parallel_robot.studies.file_in_engine import Compared
from parallel_robot.studies.verification import (
    SCENARIOS,
    Difference,
    check_numbers,
    name_of,
    verify,
    verify_file,
    verify_machine,
    verify_robot,
)
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.configuration.plain_data import LocatedDict
from parallel_robot_model.robots.robot_checks import FINE

TOLERANCE = 1e-9  # m or rad
ROBOTS, DURATION = 10, 1.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        '--robots',
        type=int,
        metavar='N',
        help=f'of each kind against MuJoCo, default {ROBOTS}; with --set of a described machine, '
        'so many of it',
    )
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='default 0')
    parser.add_argument(
        '--duration',
        type=float,
        metavar='S',
        help=f'of each motion against MuJoCo, default {DURATION:g}',
    )
    add_format_argument(parser)
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    robots = ROBOTS if arguments.robots is None else arguments.robots
    duration = DURATION if arguments.duration is None else arguments.duration
    check_numbers(robots, arguments.seed, duration, '--')
    given = simulate.given(arguments)
    seed, form = arguments.seed, arguments.format
    if not given:
        kinds = ((kind, functools.partial(verify, kind)) for kind in SCENARIOS)
        return _against_mujoco(kinds, robots, seed, duration, form)
    if arguments.robots is not None:
        name = name_of(given)
        one = [(name, functools.partial(verify_machine, given))]
        return _against_mujoco(one, robots, seed, duration, form)
    if arguments.duration is not None:
        raise InputError('--set checks one robot without MuJoCo: no --duration without --robots')
    return _one(given, simulate.machine_file(arguments), seed, form)


def _one(given: LocatedDict, file: Path | None, seed: int, form: str | None) -> int:
    """Check one robot; print each check, of a described one what differs."""
    lines, compared = [], list[Compared]()
    if file:
        against, compared = verify_file(given, file, seed)
        differ = [each.text() for each in compared if not each.agrees]
        largest = max((each.share for each in compared), default=0.0)
        verdict = f'differs: {"; ".join(differ)}' if differ else f'agrees, {largest:.1e}'
        lines = [f'{printable(file.name)} beside {against}: {verdict}' if compared else against]
    name, found = verify_robot(given, seed)
    rows = []
    for check in found:
        known = math.isfinite(check.difference)
        sizes = f'{check.difference:.2g}' if known else 'not finite', f'{check.size:.2g}'
        verdict = 'agrees' if check.passes(FINE) else 'wrong'
        rows.append([check.function, check.what, *sizes, verdict])
    head = f'{name}: largest differences near plant.initial_pose'
    columns = ['function', 'what', 'difference', 'of', 'verdict']
    data = [{'function': 'file', **each._asdict(), 'agrees': each.agrees} for each in compared]
    data += [check._asdict() | {'agrees': check.passes(FINE)} for check in found]
    parts: list[Part] = [f'{name}: its functions agree with each other']
    if not file or any(row[-1] != 'agrees' for row in rows):
        parts = [head, Table(columns, rows, 'llrrl')]
    show(form, [*lines, *parts], data)
    return 0 if all(row['agrees'] for row in data) else 1


def _against_mujoco(
    kinds: Iterable[tuple[str, Callable[..., list[Difference]]]],
    robots: int,
    seed: int,
    duration: float,
    form: str | None,
) -> int:
    """Compare random robots of each kind; print the worst."""
    data: list[dict[str, Any]] = []
    for kind, compared in kinds:
        found = compared(tracked(range(robots), robots, kind), seed, duration)
        worst = max(found, key=lambda difference: difference.largest)
        data.append(
            {
                'kind': kind,
                'robots': len(found),
                'largest_difference': worst.largest,
                'robot': worst.robot,
                'least_path': min(difference.path for difference in found),
                'agrees': worst.largest < TOLERANCE,
            }
        )
    rows = [
        [
            each['kind'],
            f'{each["largest_difference"]:.1e}',
            f'{each["robot"]} of {each["robots"]}',
            f'{each["least_path"]:.2g}',
            'agrees' if each['agrees'] else f'more than {TOLERANCE:g}',
        ]
        for each in data
    ]
    head = f'largest difference of the poses over {duration:g} s, [m] or [rad]'
    columns = ['kind', 'difference', 'robot', 'least way', 'verdict']
    show(form, [head, Table(columns, rows, 'lrrrl')], data)
    return 0 if all(row['agrees'] for row in data) else 1
