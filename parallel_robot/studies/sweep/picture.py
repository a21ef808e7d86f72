"""The distributions of the error, one curve a law, one panel a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from parallel_robot.analysis.pictures import encoded, law_look, stacked
from parallel_robot.analysis.report.looks import law_label
from parallel_robot.bags.output import without_mathematics
from parallel_robot.studies.sweep import statistics
from parallel_robot.studies.sweep.results import ESTIMATED, LIMIT, NEGLIGIBLE, ScenarioResult
from parallel_robot_control.laws import PAPER

NamedLine = tuple[str, bool, Any, tuple[float, float]]
SIZE = (7.0, 4.2)  # in, of one panel; higher for more labels
LINE = 0.17  # in, height of a label
MARGIN = 0.9  # in, of a panel that is not for curves
LABELS = 1.05  # where they begin, in widths of the panel
LIMITED = {'color': 'black', 'linewidth': 1.6, 'linestyle': (0, (1, 1))}
LEVELS: dict[str, dict[str, Any]] = {
    LIMIT: LIMITED,
    ESTIMATED: LIMITED,
    'v d': {'color': 'dimgray', 'linewidth': 1.6, 'linestyle': (0, (6, 2, 1, 2))},
}
LEADER = {'arrowstyle': '-', 'linewidth': 0.5, 'relpos': (0.0, 0.5), 'shrinkA': 2, 'shrinkB': 0}


def draw(results: Mapping[str, ScenarioResult]) -> dict[str, bytes]:
    """Draw the distributions.

    Returns:
        Suffix to content, of a PNG and a PDF.
    """
    heights = [max(SIZE[1], MARGIN + LINE * len(result.laws)) for result in results.values()]
    figure, panels = stacked(SIZE[0], heights)
    for panel, height, (scenario, result) in zip(panels, heights, results.items(), strict=True):
        _draw_panel(panel, result, LINE / (height - MARGIN))
        panel.set_title(without_mathematics(scenario), fontsize=10)
    return encoded(figure, ('png', 'pdf'))


def spread(wanted: np.ndarray, gap: float) -> np.ndarray:
    """Places of labels between 0 and 1 near those wanted, in the same order.

    Args:
        wanted: Places in rising order, shape (N,).
        gap: Least distance between two; less if there is no room.
    """
    offsets = np.arange(len(wanted)) * min(gap, 1.0 / max(1, len(wanted) - 1))
    free = wanted - offsets  # with equal neighbours as close as they may be
    upwards = np.maximum.accumulate(free)
    downwards = np.minimum.accumulate(free[::-1])[::-1]
    return np.clip((upwards + downwards) / 2.0, 0.0, 1.0 - offsets[-1:]) + offsets


def _draw_panel(panel: Any, result: ScenarioResult, gap: float) -> None:
    """Draw the error that each share of the runs stays below; laws are named at their curves."""
    ends = {}
    for k, (law, found) in enumerate(result.laws.items()):
        values, shares = statistics.distribution(found.errors)
        (line,) = panel.step(
            [0.0, *shares] if len(shares) else [],
            [values[0], *values] if len(values) else [],
            **law_look(k, law in PAPER),
        )
        ends[law] = line, (shares[-1], values[-1]) if len(values) else (0.0, np.inf)
    for name, level in result.levels.items():
        values, shares = statistics.distribution(level.values)
        above = values > NEGLIGIBLE  # the axis is logarithmic
        panel.step(shares[above], values[above], label=name, **LEVELS[name])
    if result.levels:
        panel.legend(loc='lower right', fontsize=8)
    panel.set_yscale('log')
    panel.set_xlim(0.0, 1.0)
    error = result.quantities[0]
    panel.set_ylabel(f'{error.name} [{error.unit}]')
    panel.set_xlabel('share of the runs with at most this error')
    panel.grid(alpha=0.3)
    name_lines(
        panel,
        [
            (
                law_label(law) + ('' if np.isfinite(end[1]) else ' (no run)'),
                law in PAPER,
                line,
                end,
            )
            for law, (line, end) in ends.items()
        ],
        gap,
    )


def name_lines(panel: Any, ends: Sequence[NamedLine], gap: float) -> None:
    """Name lines to the right of a panel, with leaders to their ends.

    Args:
        panel: The panel, with a logarithmic vertical axis.
        ends: What each line is called, whether in bold, the line, and its right end; infinite for
            a line without points.
        gap: Least distance of two names, in heights of the panel.
    """
    low, high = np.log(panel.get_ylim())
    ordered = sorted(ends, key=lambda each: each[3][1])
    wanted = np.array([(np.log(end) - low) / (high - low) for *_, (_, end) in ordered])
    places = spread(np.minimum(wanted, 1.0), gap)
    for (name, bold, line, (across, end)), place in zip(ordered, places, strict=True):
        panel.annotate(
            without_mathematics(name),
            xy=(across, end) if np.isfinite(end) else (LABELS, place),
            xycoords='data' if np.isfinite(end) else 'axes fraction',
            xytext=(LABELS, place),
            textcoords='axes fraction',
            color=line.get_color(),
            fontsize=8,
            fontweight='bold' if bold else 'normal',
            verticalalignment='center',
            annotation_clip=False,
            arrowprops=LEADER | {'color': line.get_color()},
        )
