"""Scores: how near a law comes to the limit at its own calm, run by run and altogether."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.studies.benchmark.store import RunFigures
from parallel_robot.studies.limit.calm import Calm
from parallel_robot.studies.sweep.statistics import Estimate, sectioned
from parallel_robot_model.common.units import Array, rounded

DIGITS = 5  # of a score; those of the limit beyond the tenth are the processor's (LAPACK)
TAIL = 0.05  # share of the runs that are worse than the tail
WHOLE = 'all'


class ScoredRun(NamedTuple):
    """A run with its score.

    Attributes:
        labels: Its robot, motion, speed, mix and age.
        scramble: Of which scramble its sample is.
        score: The limit over the true error, at the chattering of the run; 0 for a failure.
        figures: What came of it.
    """

    labels: Mapping[str, str]
    scramble: int
    score: float
    figures: RunFigures


class Summary(NamedTuple):
    """The scores of some runs.

    Attributes:
        median: Median score, with its interval between scrambles.
        tail: Score than which 5 % are worse, likewise.
        runs: Number of runs.
        failed: How many failed or ended in a fault.
        below: How many are below the limit: none should be.
        chattering: Median over the runs that are ok [N m].
        torque: Likewise, the root mean square.
        energy: Likewise [J].
    """

    median: Estimate
    tail: Estimate
    runs: int
    failed: int
    below: int
    chattering: float
    torque: float
    energy: float


def score(figures: RunFigures, calm: Calm | None) -> float:
    """The limit over the true error, at the chattering of the run, from 0 to 1; 0 for a failure.

    A run that is calmer than all controllers of the limit is held against the calmest of them.
    It is rounded, so that it is the same on every processor.
    """
    if figures.status != 'ok' or calm is None or not figures.error > 0.0:
        return 0.0
    found: float = rounded(calm.own(figures.chattering) / figures.error, DIGITS)
    return found


def summarised(runs: Sequence[ScoredRun]) -> Summary:
    """Summarise some runs."""
    scores = np.array([run.score for run in runs])
    scramble = np.array([run.scramble for run in runs])
    good = [run.figures for run in runs if run.figures.status == 'ok']

    def middle(values: Iterator[float]) -> float:
        found = np.array([*values])
        return float(np.median(found)) if len(found) else float('nan')

    return Summary(
        _estimate(scores, scramble, 0.5),
        _estimate(scores, scramble, TAIL),
        len(runs),
        len(runs) - len(good),
        int(np.sum(scores > 1.0)),
        middle(each.chattering for each in good),
        middle(each.torque for each in good),
        middle(each.energy for each in good),
    )


def by_label(runs: Sequence[ScoredRun]) -> dict[str, dict[str, Summary]]:
    """Summaries of all runs, and of those of each robot, motion, speed, mix and age."""
    found = {WHOLE: {WHOLE: summarised(runs)}}
    for label in runs[0].labels:
        values = dict.fromkeys(run.labels[label] for run in runs)
        found[label] = {
            value: summarised([run for run in runs if run.labels[label] == value])
            for value in values
        }
    return found


def as_data(summary: Summary) -> dict[str, Any]:
    """A summary as plain data."""
    return {
        'score': [*_ends(summary.median)],
        'tail': [*_ends(summary.tail)],
        'runs': summary.runs,
        'failed': summary.failed,
        'below_limit': summary.below,
        **{
            name: None if value != value else value
            for name, value in zip(
                ('chattering_nm', 'torque_rms_nm', 'energy_j'), summary[-3:], strict=True
            )
        },
    }


def _ends(estimate: Estimate) -> tuple[float, float, float]:
    return estimate.value, estimate.low, estimate.high


def _estimate(scores: Array, scramble: NDArray[np.int64], share: float) -> Estimate:
    """A quantile with an interval from independent scrambles, within 0 and 1."""
    if len(np.unique(scramble)) < 2:
        value = float(np.quantile(scores, share))
        return Estimate(value, 0.0, 1.0)
    found = sectioned(scores, scramble, lambda values: np.quantile(values, share))
    return Estimate(found.value, max(0.0, found.low), min(1.0, found.high))
