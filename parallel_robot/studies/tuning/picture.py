"""Pictures of a tuning: error against effort, and the best trial so far."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from parallel_robot.analysis.report.looks import RUNS
from parallel_robot.bags.output import without_mathematics
from parallel_robot.studies.sweep.results import Quantity
from parallel_robot.studies.tuning.trial import Trial, Verdict
from parallel_robot.studies.tuning.tune import Tuning

SIZE = (6.0, 4.2)  # inches
SUFFIXES = ('svg', 'png')


def front(
    title: str, trials: Sequence[Trial], points: Sequence[Trial], chosen: Trial, tuning: Tuning
) -> dict[str, bytes]:
    """Draw error against effort: all trials, the front, the default gains and those chosen.

    Args:
        title: What was tuned.
        trials: All trials; the first is that of the default gains.
        points: The front.
        chosen: The trial whose gains are taken.
        tuning: Tells what error and effort are.

    Returns:
        Suffix to content.
    """
    error, effort = tuning.error, tuning.effort.quantity
    figure, panel = new(SIZE)

    def show(some: Sequence[Trial], form: str, **style: Any) -> None:
        errors = [error.scale * trial.error for trial in some]
        panel.plot(errors, [effort.scale * trial.effort for trial in some], form, **style)

    feasible = [trial for trial in trials if trial.feasible]
    show(feasible, '.', color='#bbbbbb', label='trials')
    show(points, '.-', color=RUNS[3].light, linewidth=1.2, label='Pareto front')
    if trials[0].feasible:
        show(trials[:1], 'D', color=RUNS[2].light, label='default gains')
    show([chosen], '*', color=RUNS[0].light, markersize=13, label='chosen')
    label(panel, title, error, effort)
    panel.legend(fontsize=8, loc='lower left')
    return saved(figure)


def convergence(
    title: str, trials: Sequence[Trial], best: Sequence[float], verdict: Verdict, tuning: Tuning
) -> dict[str, bytes]:
    """Draw the best figure after each trial.

    Args:
        title: What was tuned.
        trials: All trials.
        best: The best figure after each, see :meth:`Tuning.best`.
        verdict: Whether the search has converged.
        tuning: Tells what the figure is.

    Returns:
        Suffix to content.
    """
    scale = tuning.error.scale if tuning.weights is None else 1.0
    figure, panel = new(SIZE)
    each = scale * np.array([tuning.figure(trial, trials[0]) for trial in trials])
    panel.plot(np.where(np.isfinite(each), each, np.nan), '.', color='#bbbbbb', label='trials')
    curve = scale * np.where(np.isfinite(best), best, np.nan)
    panel.step(range(len(best)), curve, where='post', color=RUNS[3].light, label='best so far')
    ran = [k for k, trial in enumerate(trials) if trial.ran]
    if len(ran) > verdict.rule.patience:
        begin = ran[-verdict.rule.patience]
        panel.axvspan(begin, len(trials) - 1, color='#e0e0e0', zorder=0, label='looked at')
    panel.set_yscale('log')
    said = 'converged' if verdict.converged else 'not converged'
    panel.set_title(without_mathematics(f'{title}: {said}'), fontsize=10)
    panel.set_xlabel('trial')
    unit = f' [{tuning.error.unit}]' if tuning.weights is None else ''
    panel.set_ylabel(without_mathematics(f'{tuning.goal}{unit}'), fontsize=8)
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8, loc='upper right')
    return saved(figure)


def new(size: tuple[float, float]) -> tuple[Figure, Any]:
    """A figure and its panel."""
    figure = Figure(figsize=size, layout='constrained')
    FigureCanvasAgg(figure)
    return figure, figure.subplots()


def label(panel: Any, title: str, across: Quantity, up: Quantity) -> None:
    """Name the axes, both logarithmic."""
    panel.set_xscale('log')
    panel.set_yscale('log')
    panel.set_title(without_mathematics(title), fontsize=10)
    panel.set_xlabel(f'{across.name} [{across.unit}], median')
    panel.set_ylabel(f'{up.name} [{up.unit}], median')
    panel.grid(alpha=0.3)


def saved(figure: Figure) -> dict[str, bytes]:
    """The figure as files: suffix to content."""
    pictures = {}
    with matplotlib.rc_context({'svg.hashsalt': 'front'}):  # the same file from the same trials
        for suffix in SUFFIXES:
            stream = io.BytesIO()
            metadata = {'Date': None} if suffix == 'svg' else None
            figure.savefig(stream, format=suffix, dpi=150, metadata=metadata)
            pictures[suffix] = stream.getvalue()
    return pictures
