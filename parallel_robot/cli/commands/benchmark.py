"""The command ``benchmark``: laws judged against the limit by a fixed protocol."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path

from parallel_robot.cli.shared import (
    add_format_argument,
    add_worker_arguments,
    show,
    tell,
    workers_of,
)
from parallel_robot.studies.benchmark.benchmark import SCORE, benchmarked, checked
from parallel_robot.studies.benchmark.judged_runs import competitors
from parallel_robot.studies.benchmark.protocol import DEFAULT, read
from parallel_robot.studies.sweep.workers import Workers
from parallel_robot_model.common.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'laws',
        nargs='*',
        metavar='LAW',
        help='name of a law, or the file of one of yours: .py, .so, .fmu',
    )
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='results; must not exist, or hold a part of the same benchmark, which is continued',
    )
    parser.add_argument(
        '--quick', action='store_true', help='a first look in a minute, which is not the protocol'
    )
    parser.add_argument(
        '--phrase', metavar='WORDS', help='draw other samples, by words nobody knew before'
    )
    parser.add_argument(
        '--protocol',
        default=DEFAULT,
        metavar='NAME|FILE',
        help=f'of config/benchmarks, or a file; default {DEFAULT}',
    )
    parser.add_argument(
        '--check',
        type=Path,
        metavar='SCORE.json',
        help='run the benchmark of a score again and tell whether it is the same; '
        'LAW: the files of its laws that are not of the suite',
    )
    add_worker_arguments(parser)
    add_format_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    workers, _ = workers_of(arguments)
    if arguments.check is not None:
        return _check(arguments, workers)
    if not arguments.laws:
        raise InputError('name a law, or the file of one')
    if arguments.out is None:
        raise InputError('--out is missing: the directory of the results')
    protocol = read(arguments.protocol, arguments.quick, arguments.phrase)
    laws = competitors(arguments.laws)
    scores = benchmarked(protocol, arguments.phrase, laws, arguments.out, workers)
    form = arguments.format
    show(form, scores.parts(), scores.as_data())
    tell(form, f'score   {arguments.out / SCORE}')
    tell(form, f'page    {arguments.out / "page.html"} (.pdf)')
    return 0


def _check(arguments: argparse.Namespace, workers: Callable[[], Workers]) -> int:
    """Run the benchmark of a score again; 1 if something differs."""
    for name in ('phrase', 'quick'):
        if getattr(arguments, name):
            raise InputError(f'--check takes the {name} of the score: leave --{name} out')
    with tempfile.TemporaryDirectory() as folder:
        out = arguments.out or Path(folder) / 'benchmark'
        found = checked(arguments.check, arguments.protocol, arguments.laws, out, workers)
    show(arguments.format, found.parts(), found.as_data())
    return int(bool(found.differences))
