"""A trial: gains that were tried, and what their runs came to."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from parallel_robot.studies.sweep.run_chunk import Outcome
from parallel_robot.studies.sweep.store import METRICS
from parallel_robot.studies.tuning.space import Value

FORBIDDEN = 2.0  # violation of gains that are not run; more than if all runs failed


@dataclass(frozen=True)
class Trial:
    """Gains that were tried.

    Attributes:
        number: From 0, which is the default.
        chosen: The gains that are varied; None for a default outside the search space.
        gains: All gains of the law.
        error: Median of the tracking error [m or rad]; infinite if the trial is infeasible.
        effort: Median of the effort [unit of its column]; infinite if the trial is infeasible.
        violation: Share of the runs that were not ok; FORBIDDEN for gains that were not run.
        reason: Why the trial is infeasible; empty if it is feasible.
    """

    number: int
    chosen: Mapping[str, Value] | None
    gains: Mapping[str, Any]
    error: float = math.inf
    effort: float = math.inf
    violation: float = 0.0
    reason: str = ''

    @property
    def feasible(self) -> bool:
        """Whether all its runs were ok."""
        return not self.reason

    @property
    def ran(self) -> bool:
        """Whether it was run: the gains are not forbidden."""
        return self.violation < FORBIDDEN


def forbidden(
    number: int, chosen: Mapping[str, Value] | None, gains: Mapping[str, Any], reason: str
) -> Trial:
    """A trial of gains that the theory of the law forbids."""
    return Trial(number, chosen, gains, violation=FORBIDDEN, reason=reason)


def evaluated(
    number: int,
    chosen: Mapping[str, Value] | None,
    gains: Mapping[str, Any],
    outcomes: Sequence[Outcome],
    columns: Sequence[str],
) -> Trial:
    """A trial from its runs: medians, or the most frequent reason why some of them were not ok.

    Args:
        number: Number of the trial.
        chosen: The gains that are varied.
        gains: All gains.
        outcomes: One for each run.
        columns: Those of tracking error and effort.
    """
    figures, reasons = [], []
    for outcome in outcomes:
        pair = [METRICS[column](outcome.metrics) for column in columns] if outcome.metrics else []
        if outcome.status != 'ok':
            reasons.append(outcome.reason)
        elif not all(map(math.isfinite, pair)):
            pairs = zip(columns, pair, strict=True)
            unknown = [column for column, value in pairs if not math.isfinite(value)]
            reasons.append(f'the metrics are not finite: {", ".join(unknown)}')
        else:
            figures.append(pair)
    if reasons:
        (reason, _), *_ = Counter(reasons).most_common(1)
        violation = len(reasons) / len(outcomes)
        return Trial(number, chosen, gains, violation=violation, reason=reason or 'not ok')
    medians = [statistics.median(column) for column in zip(*figures, strict=True)]
    return Trial(number, chosen, gains, *medians)
