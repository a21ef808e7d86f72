"""Scores: how near a law comes to the limit at its own calm, run by run and altogether."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot.studies.calm import Calm
from parallel_robot.studies.result_store import ResultStore
from parallel_robot.studies.sweep.statistics import Estimate, sectioned
from parallel_robot_model.common.units import Array, rounded

# The directory of a benchmark: runs and limits, a line each, kept as soon as they are known.

RUNS, LIMITS, SEARCHES = 'runs.jsonl', 'limits.jsonl', 'searches'


class RunKey(NamedTuple):
    """Which run it is."""

    law: str  # name of the law
    gains: str  # 'default' or 'tuned'
    sample: int  # number of the sample


EFFORTS = ('chattering_nm', 'torque_rms_nm', 'energy_j')  # metrics that are told beside a score


class RunFigures(NamedTuple):
    """What came of a run, in SI units."""

    status: str  # ok, fault or failed
    reason: str = ''  # why it is not ok; empty if it is
    # root mean square of the true error [m], or [rad] of joints; NaN without metrics
    error: float = math.nan
    chattering: float = math.nan  # of the torques [N m]
    torque: float = math.nan  # root mean square of the torques [N m]
    energy: float = math.nan  # energy of the motors [J]


class Store(ResultStore):
    """The directory of a benchmark."""

    KIND = 'benchmark'
    MANIFEST = 'benchmark.json'
    FIRST = (SEARCHES,)
    FORMAT = 'parallel_robot benchmark 1'

    def __init__(self, directory: Path, identity: Mapping[str, Any]) -> None:
        """Prepare the directory for a benchmark, or to go on in it.

        Args:
            directory: The directory.
            identity: What the runs depend on, plain data by name; another one is refused.
        """
        super().__init__(directory, identity)
        self.runs: dict[RunKey, RunFigures] = {}  # what came of each run
        # sample to its limit by chattering; None where it has none
        self.limits: dict[int, Calm | None] = {}

    @property
    def searches(self) -> Path:
        """Where the searches for gains are kept."""
        return self.directory / SEARCHES

    def add(self, runs: Mapping[RunKey, RunFigures], limits: Mapping[int, Calm | None]) -> None:
        """Keep runs, and limits of their samples."""
        lines = [
            [sample, None if calm is None else [each.tolist() for each in calm]]
            for sample, calm in limits.items()
        ]
        self.append(LIMITS, lines)
        self.append(RUNS, ([*key, *_finite(figures)] for key, figures in runs.items()))
        self.limits |= limits
        self.runs |= runs

    def _kept(self) -> str:
        return f'{len(self.runs)} runs'

    def _open(self) -> None:
        self.searches.mkdir(exist_ok=True)
        self._identify()
        self.read(LIMITS, self._take_limit)
        self.read(RUNS, self._take_run)

    def _take_limit(self, line: Any) -> None:
        sample, calm = line
        self.limits[sample] = None if calm is None else Calm(*map(np.asarray, calm))

    def _take_run(self, line: Any) -> None:
        law, gains, sample, status, reason, *figures = line
        numbers = [math.nan if each is None else each for each in figures]
        self.runs[RunKey(law, gains, sample)] = RunFigures(status, reason, *numbers)


def _finite(figures: RunFigures) -> list[Any]:
    """Figures for JSON, which has no NaN."""
    return [
        None if isinstance(each, float) and not math.isfinite(each) else each for each in figures
    ]


DIGITS = 5  # of a score; those of the limit beyond the tenth are the processor's (LAPACK)
TAIL = 0.05  # share of the runs that are worse than the tail
WHOLE = 'all'


class ScoredRun(NamedTuple):
    """A run with its score."""

    labels: Mapping[str, str]  # its robot, motion, speed, mix and age
    scramble: int  # of which scramble its sample is
    score: float  # the limit over the true error, at the chattering of the run; 0 for a failure
    figures: RunFigures  # what came of it


class Summary(NamedTuple):
    """The scores of some runs."""

    median: Estimate  # median score, with its interval between scrambles
    tail: Estimate  # score than which 5 % are worse, likewise
    runs: int  # number of runs
    failed: int  # how many failed or ended in a fault
    below: int  # how many are below the limit: none should be
    chattering: float  # median over the runs that are ok [N m]
    torque: float  # likewise, the root mean square
    energy: float  # likewise [J]


def score(figures: RunFigures, calm: Calm | None) -> float:
    """The limit over the true error, at the chattering of the run, from 0 to 1; 0 for a failure.

    A run that is calmer than all controllers of the limit is held against the calmest of them.
    It is rounded, so that it is the same on every processor.
    """
    if figures.status != 'ok' or calm is None or not figures.error > 0.0:
        return 0.0
    return rounded(calm.own(figures.chattering) / figures.error, DIGITS)


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
        'score': [*summary.median],
        'tail': [*summary.tail],
        'runs': summary.runs,
        'failed': summary.failed,
        'below_limit': summary.below,
        **{
            name: None if value != value else value
            for name, value in zip(EFFORTS, summary[-3:], strict=True)
        },
    }


def _estimate(scores: Array, scramble: NDArray[np.int64], share: float) -> Estimate:
    """A quantile with an interval from independent scrambles, within 0 and 1."""
    if len(np.unique(scramble)) < 2:
        value = float(np.quantile(scores, share))
        return Estimate(value, 0.0, 1.0)
    found = sectioned(scores, scramble, lambda values: np.quantile(values, share))
    return Estimate(found.value, max(0.0, found.low), min(1.0, found.high))
