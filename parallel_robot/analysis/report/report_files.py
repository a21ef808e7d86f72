"""A report as a directory: its page and the figures of the paper."""

from __future__ import annotations

import itertools
import re
import tempfile
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from parallel_robot.analysis.pictures import STYLES, UNDATED, Style
from parallel_robot.analysis.report import page
from parallel_robot.analysis.report.charts import Chart, Panel, charts
from parallel_robot.analysis.report.looks import AUTO, check
from parallel_robot.analysis.report.runs import Run, read_runs
from parallel_robot.analysis.thinned import envelope
from parallel_robot.bags import output
from parallel_robot.bags.bag_reader import view
from parallel_robot.bags.output import tracked, without_mathematics
from parallel_robot.bags.run.recorded_robot import code_of
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import path, paths
from parallel_robot_model.configuration.config import Place, Places

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Charts as vector files for a paper: column width, its font sizes, legible in grey.

FORMATS = ('pdf', 'svg')
COLUMN_WIDTH = 3.45  # in, of a journal with two columns
PAGE_WIDTH = 7.1  # in, of both
ROW = 1.25  # in, height of a panel over time
LOWEST = 1.7  # in, of all rows together
TALLEST = 9.0  # in, of all rows together
POINTS = 72  # per inch, of both formats
RC: dict[Any, Any] = {
    'axes.grid': True,
    'axes.labelsize': 8,
    'axes.linewidth': 0.6,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlelocation': 'left',
    'axes.titlepad': 3,
    'axes.titlesize': 8,
    'axes.xmargin': 0,
    'font.family': ['STIXGeneral', 'DejaVu Sans'],
    'font.size': 8,
    'grid.color': '0.9',
    'grid.linewidth': 0.5,
    'legend.columnspacing': 1.2,
    'legend.fontsize': 8,
    'legend.frameon': False,
    'legend.handlelength': 2.2,
    'pdf.fonttype': 42,  # TrueType, which journals ask for
    'svg.hashsalt': 'parallel_robot',  # the same run, the same bytes
    'xtick.labelsize': 7.5,
    'ytick.labelsize': 7.5,
}


def draw_chart(chart: Chart, directory: Path, name: str, scale: str = AUTO) -> list[Path]:
    """Draw a chart once in each of FORMATS.

    Args:
        chart: The chart.
        directory: Directory of the files.
        name: Name of the files, without suffix.
        scale: Of errors, see looks.SCALES.

    Returns:
        The files.

    Raises:
        OSError: a file cannot be written.
    """
    import matplotlib as mpl  # slow to import: only when drawn
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    log, widths = chart.logarithmic(scale), chart.widths
    rows = -(-len(chart.panels) // len(widths))
    width = PAGE_WIDTH if len(widths) > 1 else COLUMN_WIDTH
    with mpl.rc_context(RC):
        height = 0.6 + (
            3.0 * _slope(chart) if chart.equal else float(np.clip(ROW * rows, LOWEST, TALLEST))
        )
        figure = Figure(figsize=(width, height), dpi=POINTS)
        grid = figure.subplots(
            rows,
            len(widths),
            sharex='none' if chart.equal else 'col',
            sharey='col' if chart.spans else 'none',
            squeeze=False,
            width_ratios=widths,
        )
        pairs = itertools.product(ascii_lowercase, repeat=2)
        letters = itertools.chain(ascii_lowercase, map(''.join, pairs))  # a to z, then aa, ab
        for letter, axes, panel in zip(letters, grid.flat, chart.panels, strict=False):
            _draw_panel(axes, panel, log)
            if len(chart.panels) > 1:
                axes.set_title(f'({letter}) {without_mathematics(panel.title)}'.rstrip())
        for axes, panel in zip(grid[-1], chart.panels[-len(widths) :], strict=True):
            axes.set_xlabel(panel.x_label or chart.x_label)
        if chart.equal:
            for axes in grid.flat:
                axes.set_aspect('equal', adjustable='datalim')
                axes.margins(0.05)
        _add_legend(figure, chart.panels, width)
        ConstrainedLayoutEngine().execute(figure)  # here: an engine of the figure draws each twice
        files = [directory / f'{name}.{kind}' for kind in FORMATS]
        for file, kind in zip(files, FORMATS, strict=True):
            figure.savefig(file, metadata=UNDATED[kind])
    return files


def _slope(chart: Chart) -> float:
    """Height of the curves over their width, between 0.4 and 1.2."""
    whole = (
        np.concatenate([getattr(curve, axis) for panel in chart.panels for curve in panel.curves])
        for axis in 'xy'
    )
    spans = [np.nanmax(values) - np.nanmin(values) for values in whole]
    return float(np.clip(spans[1] / max(spans[0], 1e-9), 0.4, 1.2))


def _draw_panel(axes: Axes, panel: Panel, log: bool) -> None:
    for curve in panel.curves:
        y = envelope(curve.y) if log else curve.y
        axes.plot(curve.x, y, **_look(STYLES[curve.style], panel.dashed))
    for time in panel.marks:
        axes.axvline(time, color='0.4', linestyle=':', linewidth=0.6)
    if log:
        axes.set_yscale('log', nonpositive='mask')
        axes.set_ylabel(f'|{panel.quantity}| [{panel.unit}]')
    else:
        axes.set_ylabel(f'{panel.quantity} [{panel.unit}]')


def _look(style: Style, dashed: bool) -> dict[str, Any]:
    if style.marker:
        return {'color': style.light, 'linestyle': '', 'marker': 'o', 'markersize': 3.5}
    dash = (0, style.dash) if style.dash and dashed else '-'
    return {'color': style.light, 'linestyle': dash, 'linewidth': style.width}


def _add_legend(figure: Figure, panels: list[Panel], width: float) -> None:
    """One legend above all panels, in as few rows as fit."""
    from matplotlib.lines import Line2D

    styles = {curve.label: STYLES[curve.style] for panel in panels for curve in panel.curves}
    labels = [without_mathematics(label) for label in styles]
    dashed = any(panel.dashed for panel in panels)
    handles = [Line2D([], [], **_look(style, dashed)) for style in styles.values()]
    entry = 0.5 + 0.055 * max(map(len, labels))  # in, of line, text and gap
    columns = max(1, min(len(labels), int(width / entry)))
    figure.legend(handles, labels, loc='outside upper center', ncols=columns)


PAGE = 'report.html'


class Report(NamedTuple):
    """A report that was written."""

    page: Path
    figures: int  # number of files of the figures, in the directory of the page
    warnings: tuple[str, ...]  # what bags lack, one line each

    def __str__(self) -> str:
        """What the command prints."""
        files = f'page     {self.page}\nfigures  {self.figures} files in {self.page.parent}\n'
        return ''.join(f'{warning}\n' for warning in self.warnings) + files


def report(
    bags: Places,
    out: Place,
    *,
    scale: Literal['auto', 'linear', 'log'] = 'auto',
    trust: bool = False,
    **options: Any,
) -> Report:
    """Write the paper's figures and one interactive page, as ``parallel_robot report`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/smc')
    >>> pr.report('runs/smc', 'runs/report').page
    PosixPath('runs/report/report.html')

    Args:
        bags: A bag, or several, up to 8, of which the runs are compared.
        out: Directory of the report, which must not exist; it appears complete or not at all.
        scale: Of errors; log: their magnitude; auto, the default: log where the spread asks for
            it.
        trust: Whether the code of the robots that bags hold runs, with all your rights; on a
            terminal, it is shown first.
        options: What bags do not say themselves, see ``load``, and keys of their configuration,
            such as `custom_robots`, files that take the place of those in bags.

    Returns:
        Its page, the number of figures beside it, and warnings.

    Raises:
        InputError: bags are too many or no bags, or the directory cannot be written.
    """
    check(scale)
    found, directory = paths('a bag', bags), path('out', out)
    asked = view(**options)
    code = code_of(trust, asked)
    output.check_directory(directory)
    groups = read_runs(found, code, asked)
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
        scale: Of errors, see looks.SCALES.

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
            group = re.sub(r'[^A-Za-z0-9_-]', '_', scenario)
            stem = f'figure_{chart.number}_{chart.name}_{group}'
            draw_chart(chart, draft, stem, scale)
        figures = len(list(draft.iterdir())) - 1
        draft.rename(directory)
    return figures
