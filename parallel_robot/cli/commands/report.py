"""The command ``report``: the paper's figures and one interactive page, of one bag or several."""

from __future__ import annotations

import argparse
import re
import tempfile
from pathlib import Path

from parallel_robot.analysis.report import page, paper_figures
from parallel_robot.analysis.report.charts import charts
from parallel_robot.analysis.report.palette import RUNS
from parallel_robot.analysis.report.runs import Run, read_runs
from parallel_robot.analysis.report.scale import AUTO, add_scale_argument
from parallel_robot.bags import new_files
from parallel_robot.bags.limits import add_memory_argument
from parallel_robot.bags.progress import tracked
from parallel_robot.cli.robot_code import add_robot_arguments, robot_code
from parallel_robot_model.common.errors import InputError

PAGE = 'report.html'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'bags', nargs='+', type=Path, metavar='BAG', help=f'bags to compare, up to {len(RUNS)}'
    )
    parser.add_argument(
        '--out', type=Path, required=True, metavar='DIR', help='of the report; must not exist'
    )
    add_scale_argument(parser)
    add_robot_arguments(parser)
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    new_files.check_directory(arguments.out)
    groups = read_runs(arguments.bags, arguments.max_memory, robot_code(arguments))
    try:
        figures = write(groups, arguments.out, arguments.scale)
    except OSError as error:
        raise InputError(f'cannot write {arguments.out}: {error.strerror}') from None
    lacking = [str(r.bag) for runs in groups.values() for r in runs if r.cross_coupling is None]
    for bag in lacking:
        print(f'{bag} has no cross-coupling error: left out')
    print(f'page     {arguments.out / PAGE}\nfigures  {figures} files in {arguments.out}')
    return 0


def write(groups: dict[str, list[Run]], directory: str | Path, scale: str = AUTO) -> int:
    """Write a report; it appears complete or not at all.

    Args:
        groups: Name of a group to its runs.
        directory: Directory of the report; must not exist.
        scale: Of errors, see scale.SCALES.

    Returns:
        Number of files of the figures.

    Raises:
        OSError: the disk is full or gone.
    """
    directory = Path(directory)
    drawn = {scenario: charts(runs) for scenario, runs in groups.items()}
    directory.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(
        dir=directory.parent, prefix=f'.{directory.name[:50]}.'
    ) as name:
        draft = Path(name) / 'report'
        draft.mkdir()
        text = page.render(groups, drawn, scale)
        (draft / PAGE).write_text(text, encoding='utf-8')
        members = [(scenario, chart) for scenario, some in drawn.items() for chart in some]
        for scenario, chart in tracked(members, len(members), 'figures'):
            stem = f'figure_{chart.number}_{chart.name}_{_file_name(scenario)}'
            paper_figures.draw(chart, draft, stem, scale)
        figures = len(list(draft.iterdir())) - 1
        draft.rename(directory)
    return figures


def _file_name(text: str) -> str:
    return re.sub(r'[^A-Za-z0-9_-]', '_', text)
