"""The command ``sweep``: a study of many runs, in parallel, and what follows from them."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.cli.commands import simulate
from parallel_robot.cli.result_format import add_format_argument, show, tell
from parallel_robot.studies.sweep import study, summary
from parallel_robot.studies.sweep.cluster import Cluster
from parallel_robot.studies.sweep.plan import plan
from parallel_robot.studies.sweep.sweep import MOST_WORKERS, default_workers, sweep
from parallel_robot.studies.sweep.workers import Processes, Workers
from parallel_robot_model.common.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('study', help='file of a study, or the name of one in config/studies')
    parser.add_argument(
        '--out',
        type=Path,
        required=True,
        metavar='DIR',
        help='results; must not exist, or hold a part of the same sweep, which is continued',
    )
    parser.add_argument(
        '--runs', type=int, metavar='N', help="runs of each law and scenario, default: the study's"
    )
    parser.add_argument(
        '--laws',
        nargs='+',
        metavar='LAW',
        help="in place of the study's laws; a name of one of these keeps its gains",
    )
    parser.add_argument(
        '--workers', type=int, metavar='N', help='processes, default: one for each core'
    )
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', help='run on the cluster of this dask scheduler instead'
    )
    add_format_argument(parser)
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    workers, count = _workers(arguments)
    file = study.file_of(arguments.study)
    fixed = simulate.given(arguments)
    asked = study.parse(study.read(file), str(file), file.parent, arguments.laws)
    asked = asked.changed(arguments.runs, fixed)
    out: Path = arguments.out
    planned = plan(asked)
    found = sweep(planned, asked.text, out, workers, count)
    form, picture = arguments.format, out / 'distributions.png'
    show(form, summary.parts(planned, found), summary.as_data(found))
    tell(form, f'rows    {out / "runs.parquet"}')
    tell(form, f'summary {out / "summary.txt"} (.csv, .tex, .html), {picture} (.pdf)')
    return 0


def _workers(arguments: argparse.Namespace) -> tuple[Workers, int]:
    """Who runs the sweep, and how many.

    Raises:
        InputError: the arguments do not fit together.
    """
    if arguments.scheduler is not None:
        if arguments.workers is not None:
            raise InputError('--workers is for processes on this machine, not for --scheduler')
        return Cluster(arguments.scheduler), 2 * default_workers()
    count = default_workers() if arguments.workers is None else arguments.workers
    if not 1 <= count <= MOST_WORKERS:
        raise InputError(f'--workers must be from 1 to {MOST_WORKERS}, not {count}')
    return Processes(count), count
