"""What a tuning leaves: the front as a table and a picture, the chosen gains as YAML."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from parallel_robot_analysis.report.labels import law_label
from parallel_robot_analysis.study.results import Quantity
from parallel_robot_analysis.tuning import picture
from parallel_robot_analysis.tuning.store import Store
from parallel_robot_analysis.tuning.trial import Trial
from parallel_robot_analysis.tuning.tune import Tuning
from parallel_robot_base.fields import Field
from parallel_robot_base.parameter_file import MARK
from parallel_robot_base.printable import printable
from parallel_robot_base.yaml_file import text_of


def write(
    tuning: Tuning,
    store: Store,
    fields: Mapping[str, Field],
    trials: Sequence[Trial],
    points: Sequence[Trial],
    chosen: Trial,
    why: str,
) -> list[Path]:
    """Write the files.

    Args:
        tuning: The tuning.
        store: Its directory.
        fields: Unit and meaning of the gains.
        trials: All trials; the first is that of the default gains.
        points: The front.
        chosen: The trial whose gains are taken.
        why: Why it is taken.

    Returns:
        Their paths.

    Raises:
        RunError: one cannot be written.
    """
    law = tuning.space.law
    head = heading(tuning, trials, chosen, why)
    gains = gains_lines(law, chosen.gains, fields)
    ros = ['/**:', f'  {MARK}:', *(f'    {line}' for line in [f'law: {text_of(law)}', *gains])]
    title = f'{law_label(law)}, {tuning.nominal["scenario"]}'
    pictures = picture.draw(title, trials, points, chosen, tuning.error)
    contents = {
        'front.csv': table(points, chosen, tuning.error).encode(),
        **{f'front.{suffix}': content for suffix, content in pictures.items()},
        'tuned.yaml': '\n'.join([*head, *gains, '']).encode(),
        'tuned_ros.yaml': '\n'.join([*head, *ros, '']).encode(),
    }
    for name, content in contents.items():
        store.write(name, content)
    return [store.directory / name for name in contents]


def table(points: Sequence[Trial], chosen: Trial, error: Quantity) -> str:
    """The front as CSV, by rising error."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(['trial', 'chosen', error.column, 'chattering_nm', *chosen.gains])
    for point in points:
        taken = int(point.number == chosen.number)
        figures = [point.number, taken, point.error, point.chattering]
        writer.writerow([*figures, *point.gains.values()])
    return stream.getvalue()


def heading(tuning: Tuning, trials: Sequence[Trial], chosen: Trial, why: str) -> list[str]:
    """Comment lines: what was tuned, and what the chosen gains are worth."""
    study = tuning.plan.study
    names = ', '.join(each.key for each in study.uncertainties) or 'none'
    runs = f'{study.runs} run{"s" if study.runs > 1 else ""} of {study.duration:g} s'
    lines = [
        f'Gains of {tuning.space.law} for {tuning.nominal["scenario"]}, by parallel_robot tune.',
        f'Trial {chosen.number} of {len(trials)}: {why}. Seed {tuning.seed}.',
        f'Each trial: {runs}, seed {study.seed}; uncertain: {names}.',
        f'tuned:   {figures(chosen, tuning.error)}',
        f'default: {figures(trials[0], tuning.error)}',
        f'Version {tuning.identity()["version of the suite"]}.',
    ]
    return [f'# {printable(line)}' for line in lines]


def figures(trial: Trial, error: Quantity) -> str:
    """Error and chattering of a trial for people."""
    if not trial.feasible:
        return f'infeasible: {trial.reason}'
    size = f'{error.scale * trial.error:.4g} {error.unit}'
    return f'{error.name} {size}, torque, chattering {trial.chattering:.4g} N m (medians)'


def gains_lines(law: str, gains: Mapping[str, Any], fields: Mapping[str, Field]) -> list[str]:
    """Gains as lines of YAML, with their units."""
    lines = [f'{text_of(law)}:']
    for key, value in gains.items():
        unit, meaning = fields[key].unit, fields[key].description
        comment = f'{unit}, {meaning}' if unit else meaning
        lines.append(f'  {text_of(key)}: {text_of(value)}  # {printable(comment)}')
    return lines
