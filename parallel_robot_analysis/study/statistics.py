"""What follows from the runs of one scenario: pure functions of arrays.

A run that failed, or in which the controller took its safe action, has no error that could be
compared: it counts as larger than every number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

FEWEST = 10  # runs of which a rank correlation is computed
LEVEL = 0.95  # of all intervals
RESAMPLES = 999
BATCH = 20_000_000  # numbers that are resampled at once
HUGE = 1e150  # in place of infinity, with which intervals cannot be interpolated

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A number with its interval.

    Attributes:
        value: The estimate.
        low: Lower end of its interval.
        high: Upper end.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Duel:
    """Two laws compared sample by sample.

    Attributes:
        winner: The law with the smaller value in most samples.
        loser: The other law.
        probability: Probability that the winner is better in a sample.
    """

    winner: str
    loser: str
    probability: Estimate


@dataclass(frozen=True)
class Driver:
    """An uncertain parameter and how the error goes with it.

    Attributes:
        parameter: Column of the parameter.
        correlation: Spearman's rank correlation.
    """

    parameter: str
    correlation: Estimate


def median(values: Array) -> Estimate:
    """Median with a bootstrap interval.

    Args:
        values: One value a run, infinite for one that failed.
    """
    from scipy.stats import bootstrap  # slow to import

    finite = np.minimum(values, HUGE)
    middle = float(np.median(finite))
    if len(finite) < 2 or np.ptp(finite) == 0.0:
        return Estimate(_open(middle), _open(middle), _open(middle))
    interval = bootstrap(
        (finite,),
        np.median,
        vectorized=True,
        n_resamples=RESAMPLES,
        batch=max(1, BATCH // len(finite)),
        confidence_level=LEVEL,
        method='percentile',
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Estimate(_open(middle), _open(interval.low), _open(interval.high))


def duels(values: Mapping[str, Array]) -> list[Duel]:
    """Every law against every other one, in the same samples.

    The probability has Wilson's score interval; a tie counts for half.

    Args:
        values: Law to one value a sample, the smaller the better; the same samples for all.
    """
    from scipy.stats import binomtest  # slow to import

    found = []
    for (a, ours), (b, theirs) in combinations(values.items(), 2):
        better = float(np.sum(ours < theirs) + 0.5 * np.sum(ours == theirs))
        winner, loser, wins = (a, b, better)
        if better < 0.5 * len(ours):
            winner, loser, wins = b, a, len(ours) - better
        low, high = (
            binomtest(count, len(ours)).proportion_ci(LEVEL, method='wilson')
            for count in (math.floor(wins), math.ceil(wins))
        )
        found.append(Duel(winner, loser, Estimate(wins / len(ours), low.low, high.high)))
    return found


def drivers(parameters: Mapping[str, Array], values: Array) -> list[Driver]:
    """Rank correlations of the error with the uncertain parameters, the strongest first.

    The interval is Fisher's, with the variance for ranks of Bonett and Wright (2000),
    Psychometrika 65(1).

    Args:
        parameters: Column to its values, one a run.
        values: One value a run, infinite for one that failed.
    """
    from scipy.stats import spearmanr  # slow to import

    found = []
    for name, numbers in parameters.items():
        if len(values) < FEWEST or np.ptp(numbers) == 0.0 or (values == values[0]).all():
            continue
        rank = float(spearmanr(numbers, np.minimum(values, HUGE)).statistic)
        count = len(values)
        most = 1.0 - 12.0 / (count**3 - count)  # the next one below 1, two neighbours exchanged
        inside = math.atanh(min(max(rank, -most), most))
        width = 1.959963984540054 * math.sqrt((1.0 + 0.5 * rank**2) / (count - 3))
        low, high = math.tanh(inside - width), math.tanh(inside + width)
        found.append(Driver(name, Estimate(rank, min(low, rank), max(high, rank))))
    return sorted(found, key=lambda driver: -abs(driver.correlation.value))


def distribution(values: Array) -> tuple[Array, Array]:
    """Empirical distribution function of those values that are finite.

    Returns:
        Values in order, and the share of all runs that are not above each.
    """
    ordered = np.sort(values[np.isfinite(values)])
    return ordered, np.arange(1, len(ordered) + 1) / max(1, len(values))


def _open(value: float) -> float:
    return math.inf if value > 0.5 * HUGE else float(value)
