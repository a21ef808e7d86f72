"""A report as a directory: its page and the figures of the paper."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from parallel_robot.analysis.report import page, paper_figures
from parallel_robot.analysis.report.charts import charts
from parallel_robot.analysis.report.looks import AUTO
from parallel_robot.analysis.report.runs import Run, read_runs
from parallel_robot.bags import output
from parallel_robot.bags.output import tracked
from parallel_robot.bags.reading.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.run.recorded_robot import NONE, RobotCode
from parallel_robot_model.common.errors import InputError

PAGE = 'report.html'


class Report(NamedTuple):
    """A report that was written.

    Attributes:
        page: Its page.
        figures: Number of files of the figures, in the directory of the page.
        warnings: What bags lack, one line each.
    """

    page: Path
    figures: int
    warnings: tuple[str, ...]


def make(
    bags: Sequence[Path],
    directory: Path,
    scale: str = AUTO,
    code: RobotCode = NONE,
    view: BagView = AS_RECORDED,
) -> Report:
    """Write the report of some bags; it appears complete or not at all.

    Args:
        bags: Directories of the bags, or one file of each.
        directory: Directory of the report; must not exist.
        scale: Of errors, see scale.SCALES.
        code: What may run to know their robots.
        view: What bags do not say themselves, and which part is wanted.

    Raises:
        InputError: bags are too many or no bags, or the directory cannot be written.
    """
    output.check_directory(directory)
    groups = read_runs(bags, code, view)
    try:
        figures = write(groups, directory, scale)
    except OSError as error:
        raise InputError(f'cannot write {directory}: {error.strerror}') from None
    lacking = [run.bag for runs in groups.values() for run in runs if run.cross_coupling is None]
    warnings = (f'{bag} has no cross-coupling error: left out' for bag in lacking)
    return Report(directory / PAGE, figures, tuple(warnings))


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
