"""The command ``sweep``: a study of many runs, in parallel, and what follows from them."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.cli.commands import simulate
from parallel_robot.cli.shared import (
    add_format_argument,
    add_worker_arguments,
    show,
    tell,
    workers_of,
)
from parallel_robot.studies.sweep import study, summary
from parallel_robot.studies.sweep.plan import plan
from parallel_robot.studies.sweep.sweep import sweep
from parallel_robot_control import law_loader


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
        metavar='LAW|FILE',
        help="in place of the study's laws; a name of one of these keeps its gains",
    )
    add_worker_arguments(parser)
    add_format_argument(parser)
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    make, count = workers_of(arguments)
    workers = make()
    file = study.file_of(arguments.study)
    fixed = simulate.given(arguments)
    laws = None if arguments.laws is None else [*map(law_loader.name_of, arguments.laws)]
    fixed |= law_loader.files_of(arguments.laws or (), fixed)
    asked = study.parse(study.read(file), str(file), file.parent, laws)
    asked = asked.changed(arguments.runs, fixed)
    out: Path = arguments.out
    planned = plan(asked)
    found = sweep(planned, asked.text, out, workers, count)
    form, picture = arguments.format, out / 'distributions.png'
    show(form, summary.parts(planned, found), summary.as_data(found))
    tell(form, f'rows    {out / "runs.parquet"}')
    tell(form, f'summary {out / "summary.txt"} (.csv, .tex, .html), {picture} (.pdf)')
    return 0
