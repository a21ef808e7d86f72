"""Error against chattering: all trials, the front, the default gains and those chosen."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from parallel_robot_analysis.report.palette import RUNS
from parallel_robot_analysis.study.results import Quantity
from parallel_robot_analysis.tuning.trial import Trial
from parallel_robot_bags.printable_output import without_mathematics

SIZE = (6.0, 4.2)  # inches
SUFFIXES = ('svg', 'png')


def draw(
    title: str, trials: Sequence[Trial], points: Sequence[Trial], chosen: Trial, error: Quantity
) -> dict[str, bytes]:
    """Draw the front.

    Args:
        title: What was tuned.
        trials: All trials; the first is that of the default gains.
        points: The front.
        chosen: The trial whose gains are taken.
        error: Which metric the error is.

    Returns:
        Suffix to content.
    """
    figure = Figure(figsize=SIZE, layout='constrained')
    FigureCanvasAgg(figure)
    panel = figure.subplots()

    def show(some: Sequence[Trial], form: str, **style: Any) -> None:
        errors = [error.scale * trial.error for trial in some]
        panel.plot(errors, [trial.chattering for trial in some], form, **style)

    feasible = [trial for trial in trials if trial.feasible]
    show(feasible, '.', color='#bbbbbb', label='trials')
    show(points, '.-', color=RUNS[3].light, linewidth=1.2, label='Pareto front')
    if trials[0].feasible:
        show(trials[:1], 'D', color=RUNS[2].light, label='default gains')
    show([chosen], '*', color=RUNS[0].light, markersize=13, label='chosen')
    panel.set_xscale('log')
    panel.set_yscale('log')
    panel.set_title(without_mathematics(title), fontsize=10)
    panel.set_xlabel(f'{error.name} [{error.unit}], median')
    panel.set_ylabel('torque, chattering [N m], median')
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
    pictures = {}
    with matplotlib.rc_context({'svg.hashsalt': 'front'}):  # the same file from the same trials
        for suffix in SUFFIXES:
            stream = io.BytesIO()
            metadata = {'Date': None} if suffix == 'svg' else None
            figure.savefig(stream, format=suffix, dpi=150, metadata=metadata)
            pictures[suffix] = stream.getvalue()
    return pictures
