"""Whether a search has converged: what the last trials have brought."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

EACH = 20  # trials without improvement for each gain that is varied
FEWEST = 120


@dataclass(frozen=True)
class Rule:
    """When a search has converged.

    Attributes:
        patience: Number of trials, of those that were run, that brought hardly anything.
        improvement: The share of the best figure that counts as hardly anything.
    """

    patience: int
    improvement: float


@dataclass(frozen=True)
class Verdict:
    """What the last trials of a search have brought.

    Attributes:
        rule: The rule.
        trials: Number of all trials.
        ran: Number of those that were run: gains that a law forbids teach nothing.
        improvement: Share by which the best figure fell within the last trials; infinite if there
            was none before.
    """

    rule: Rule
    trials: int
    ran: int
    improvement: float

    @property
    def converged(self) -> bool:
        """Whether the rule is met."""
        return self.improvement <= self.rule.improvement

    def __str__(self) -> str:
        patience, share = self.rule.patience, 100.0 * self.improvement
        if self.converged:
            limit = f'{100.0 * self.rule.improvement:g} %'
            what = f'improved by at most {limit} within the last {patience}'
            return f'converged after {self.trials} trials: the best {what}'
        if self.ran <= patience:
            what = f'{self.ran} trials are fewer than the {patience} that would show it'
        elif math.isinf(share):
            what = f'the first gains that count came within the last {patience} trials, or none'
        else:
            what = f'the best improved by {share:.2g} % within the last {patience} trials'
        return f'not converged: {what}; go on with --trials {self.trials + patience}'


def patience_for(gains: int) -> int:
    """How many trials without improvement a search of so many gains takes to converge."""
    return max(FEWEST, EACH * gains)


def judge(best: Sequence[float], ran: Sequence[bool], rule: Rule) -> Verdict:
    """Judge a search.

    Args:
        best: Best figure after each trial, the smaller the better; infinite before the first.
        ran: Whether each trial was run.
        rule: The rule.
    """
    counted = [figure for figure, one in zip(best, ran, strict=True) if one]
    improvement = math.inf
    if len(counted) > rule.patience:
        before, now = counted[-1 - rule.patience], counted[-1]
        if math.isfinite(before):
            improvement = (before - now) / before if before else 0.0
    return Verdict(rule, len(best), len(counted), improvement)
