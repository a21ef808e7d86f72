"""What a tuning leaves: front and trials as tables and pictures, the chosen gains as YAML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.metrics import Metric
from parallel_robot.analysis.pictures import RUNS, encoded, stacked
from parallel_robot.analysis.report.looks import law_label
from parallel_robot.bags.output import without_mathematics
from parallel_robot.studies.tuning.trial import Trial, Verdict
from parallel_robot.studies.tuning.tune import Store, Tuning
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.tables import comma_separated
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.configuration.yaml_file import MARK, text_of

# Pictures of a tuning: error against effort, and the best trial so far.

WIDTH, HEIGHT = 6.0, 4.2  # in
SUFFIXES = ('svg', 'png')


def _draw_front(
    title: str, trials: Sequence[Trial], points: Sequence[Trial], chosen: Trial, tuning: Tuning
) -> dict[str, bytes]:
    """Draw error against effort: all trials, the front, the default gains and those chosen."""
    error, effort = tuning.error, tuning.effort.quantity
    figure, (panel,) = stacked(WIDTH, [HEIGHT])

    def show(some: Sequence[Trial], form: str, **style: Any) -> None:
        errors = [error.scale * trial.error for trial in some]
        panel.plot(errors, [effort.scale * trial.effort for trial in some], form, **style)

    feasible = [trial for trial in trials if trial.feasible]
    show(feasible, '.', color='#bbbbbb', label='trials')
    show(points, '.-', color=RUNS[3].light, linewidth=1.2, label='Pareto front')
    if trials[0].feasible:
        show(trials[:1], 'D', color=RUNS[2].light, label='default gains')
    show([chosen], '*', color=RUNS[0].light, markersize=13, label='chosen')
    label_axes(panel, title, error, effort)
    panel.legend(fontsize=8, loc='lower left')
    return encoded(figure, SUFFIXES)


def _draw_convergence(
    title: str, trials: Sequence[Trial], best: Sequence[float], verdict: Verdict, tuning: Tuning
) -> dict[str, bytes]:
    """Draw the best figure after each trial."""
    scale = tuning.error.scale if tuning.weights is None else 1.0
    figure, (panel,) = stacked(WIDTH, [HEIGHT])
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
    return encoded(figure, SUFFIXES)


def label_axes(panel: Any, title: str, across: Metric, up: Metric) -> None:
    """Name the axes, both logarithmic."""
    panel.set_xscale('log')
    panel.set_yscale('log')
    panel.set_title(without_mathematics(title), fontsize=10)
    panel.set_xlabel(f'{across.name} [{across.unit}], median')
    panel.set_ylabel(f'{up.name} [{up.unit}], median')
    panel.grid(alpha=0.3)


@dataclass(frozen=True)
class Result:
    """What came of a tuning."""

    trials: Sequence[Trial]  # all trials; the first is that of the default gains
    points: Sequence[Trial]  # the front
    chosen: Trial  # the trial whose gains are taken
    why: str  # why it is taken
    verdict: Verdict  # whether the search has converged


def write(tuning: Tuning, store: Store, fields: Mapping[str, Field], result: Result) -> list[Path]:
    """Write the files.

    Args:
        tuning: The tuning.
        store: Its directory.
        fields: Unit and meaning of the gains.
        result: What came of it.

    Returns:
        Their paths.

    Raises:
        RunError: one cannot be written.
    """
    law = tuning.space.law
    head = heading(tuning, result)
    gains = gains_lines(law, result.chosen.gains, fields)
    ros = ['/**:', f'  {MARK}:', *(f'    {line}' for line in [f'law: {text_of(law)}', *gains])]
    title = f'{law_label(law)}, {tuning.nominal["scenario"]}'
    best = tuning.best(result.trials)
    fronts = _draw_front(title, result.trials, result.points, result.chosen, tuning)
    curves = _draw_convergence(title, result.trials, best, result.verdict, tuning)
    contents = {
        'front.csv': table(tuning, result).encode(),
        **{f'front.{suffix}': content for suffix, content in fronts.items()},
        'trials.csv': trials_table(tuning, result.trials, best).encode(),
        **{f'convergence.{suffix}': content for suffix, content in curves.items()},
        'tuned.yaml': '\n'.join([*head, *gains, '']).encode(),
        'tuned_ros.yaml': '\n'.join([*head, *ros, '']).encode(),
    }
    for name, content in contents.items():
        store.write(name, content)
    return [store.directory / name for name in contents]


def table(tuning: Tuning, result: Result) -> str:
    """The front as CSV, by rising error."""
    head = ['trial', 'chosen', *_columns(tuning), *result.chosen.gains]
    rows = []
    for each in result.points:
        taken = int(each is result.chosen)
        rows.append([each.number, taken, each.error, each.effort, *each.gains.values()])
    return comma_separated(head, rows)


def trials_table(tuning: Tuning, trials: Sequence[Trial], best: Sequence[float]) -> str:
    """All trials as CSV, in their order, with the best figure so far."""
    head = ['trial', 'best_so_far', *_columns(tuning), *trials[0].gains, 'infeasible']
    rows = []
    for each, so_far in zip(trials, best, strict=True):
        figures = [value if math.isfinite(value) else '' for value in (each.error, each.effort)]
        first = so_far if math.isfinite(so_far) else ''
        rows.append([each.number, first, *figures, *each.gains.values(), each.reason])
    return comma_separated(head, rows)


def heading(tuning: Tuning, result: Result) -> list[str]:
    """Comment lines: what was tuned, and what the chosen gains are worth."""
    study = tuning.plan.study
    names = ', '.join(each.key for each in study.uncertainties) or 'none'
    runs = f'{study.runs} run{"s" if study.runs > 1 else ""} of {tuning.nominal["duration"]:g} s'
    count = f'{result.chosen.number} of {len(result.trials)}'
    lines = [
        f'Gains of {tuning.space.law} for {tuning.nominal["scenario"]}, by parallel_robot tune.',
        f'Trial {count}: {result.why}. Seed {tuning.seed}.',
        f'{str(result.verdict).capitalize()}.',
        f'Each trial: {runs}, seed {study.seed}; uncertain: {names}.',
        f'tuned:   {figures(result.chosen, tuning)}',
        f'default: {figures(result.trials[0], tuning)}',
        f'Version {tuning.identity()["version of the suite"]}.',
    ]
    return [f'# {printable(line)}' for line in lines]


def figures(trial: Trial, tuning: Tuning) -> str:
    """Error and effort of a trial for people."""
    if not trial.feasible:
        return f'infeasible: {trial.reason}'
    error = tuning.error
    size = f'{error.scale * trial.error:.4g} {error.unit}'
    return f'{error.name} {size}, {tuning.effort.shown(trial.effort)} (medians)'


def gains_lines(law: str, gains: Mapping[str, Any], fields: Mapping[str, Field]) -> list[str]:
    """Gains, and what was searched beside them, as lines of YAML with their units."""
    lines, last = [], ''
    for key, value in gains.items():
        group, _, own = key.rpartition('.')
        group = group or law
        if group != last:
            lines.append(f'{text_of(group)}:')
        last = group
        unit, meaning = fields[key].unit, fields[key].description
        comment = f'{unit}, {meaning}' if unit else meaning
        lines.append(f'  {text_of(own)}: {text_of(value)}  # {printable(comment)}')
    return lines


def _columns(tuning: Tuning) -> tuple[str, str]:
    return tuning.error.key, tuning.effort.quantity.key
