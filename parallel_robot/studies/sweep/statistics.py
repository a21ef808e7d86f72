"""What follows from the runs of one scenario: pure functions of arrays.

A run that failed, or in which the controller took its safe action, has no error that could be
compared: it counts as larger than every number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array

FEWEST = 64  # runs of which a rank correlation is computed
ALIKE = 1e-4  # of the largest error, a spread of errors that is none
SOME = 10  # runs, from which on it is told that parameters go together
TOGETHER = 0.6  # rank correlation of two parameters whose effects cannot be told apart
LEVEL = 0.95  # of all intervals
RESAMPLES = 999
BATCH = 20_000_000  # numbers that are resampled at once
HUGE = 1e150  # in place of infinity, with which intervals cannot be interpolated
LARGEST = 1e75  # above all numbers, below whatever is interpolated between one and HUGE


class Estimate(NamedTuple):
    """A number with its interval."""

    value: float  # the estimate
    low: float  # lower end of its interval
    high: float  # upper end


@dataclass(frozen=True)
class Duel:
    """Two laws compared sample by sample."""

    winner: str  # the law with the smaller value in most samples
    loser: str  # the other law
    probability: Estimate  # probability that the winner is better in a sample
    p: float  # of the two-sided sign test; corrected where :func:`corrected` was applied


@dataclass(frozen=True)
class Driver:
    """An uncertain parameter and how the error goes with it."""

    parameter: str  # column of the parameter
    correlation: Estimate  # partial rank correlation


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


def sectioned(
    values: Array,
    section: NDArray[np.int64],
    statistic: Callable[[Array], Any] = np.median,
) -> Estimate:
    """Median of all values, with a t-interval from the medians of independent sections.

    Sections are independently scrambled sequences: the points of one are not independent, so
    neither the bootstrap nor the ranks of single values would tell how sure the median is.

    Args:
        values: One value a run, infinite for one that failed.
        section: Number of the section of each.
        statistic: Another one than the median.

    Source:
        Asmussen, Glynn (2007), Stochastic Simulation, III.5, for sectioning; Owen (2023),
        Practical Quasi-Monte Carlo Integration, ch. 17, for the t-interval between scrambles.
    """
    from scipy.stats import t  # slow to import

    finite = np.minimum(values, HUGE)
    middle = float(statistic(finite))
    each = np.array([statistic(finite[section == one]) for one in np.unique(section)])
    if max(each.max(), middle) > LARGEST:
        return Estimate(_open(middle), _open(float(each.min())), math.inf)
    count = len(each)
    deviation = math.sqrt(float(np.sum((each - middle) ** 2)) / (count - 1))
    half = float(t.ppf(0.5 + 0.5 * LEVEL, count - 1)) * deviation / math.sqrt(count)
    return Estimate(middle, middle - half, middle + half)


def duels(values: Mapping[str, Array]) -> list[Duel]:
    """Every law against every other one, in the same samples.

    The probability has Wilson's score interval; a tie counts for half. The sign test leaves ties
    out.

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
        less = int(np.sum(ours < theirs))
        decided = less + int(np.sum(ours > theirs))
        p = float(binomtest(less, decided).pvalue) if decided else 1.0
        found.append(Duel(winner, loser, Estimate(wins / len(ours), low.low, high.high), p))
    return found


def corrected(p: Sequence[float]) -> list[float]:
    """Adjusted p of several tests, so that the chance of any false one stays at the level.

    Source:
        Holm (1979), A simple sequentially rejective multiple test procedure, Scandinavian Journal
        of Statistics 6(2).
    """
    values = np.asarray(p, dtype=float)
    order = np.argsort(values, kind='stable')
    stepwise = values[order] * np.arange(len(values), 0, -1)
    adjusted = np.empty_like(values)
    adjusted[order] = np.minimum(np.maximum.accumulate(stepwise), 1.0)
    return [float(value) for value in adjusted]


def fewest(parameters: int) -> int:
    """Runs from which on it is told what the error goes with, by the number of parameters."""
    return max(FEWEST, 2 * parameters)


def drivers(parameters: Mapping[str, Array], values: Array) -> list[Driver]:
    """Partial rank correlations of the error with the uncertain parameters, the strongest first.

    What the other parameters explain is taken off both. The interval is Fisher's, with the
    variance for ranks of Bonett and Wright (2000), Psychometrika 65(1).

    Args:
        parameters: Column to its values, one a run.
        values: One value a run, infinite for one that failed.

    Returns:
        Nothing of too few runs, or of errors that are all but equal.
    """
    from scipy.stats import rankdata  # slow to import

    varied = [name for name, numbers in parameters.items() if np.ptp(numbers)]
    finite = np.minimum(values, HUGE)
    if len(values) < fewest(len(varied)) or np.ptp(finite) <= ALIKE * np.abs(finite).max():
        return []
    ranks = rankdata([*(parameters[name] for name in varied), finite], axis=1).T
    ranks -= ranks.mean(axis=0)
    found = []
    for k, name in enumerate(varied):
        others, pair = np.delete(ranks, (k, -1), axis=1), ranks[:, (k, -1)]
        own = pair - others @ (np.linalg.pinv(others) @ pair)
        sizes = np.linalg.norm(own, axis=0) / np.linalg.norm(pair, axis=0)
        if sizes[0] < ALIKE:  # others say the same
            continue
        rank = float(np.corrcoef(own.T)[0, 1]) if sizes[1] > ALIKE else 0.0
        count = len(values) - len(varied) + 1
        most = 1.0 - 12.0 / (count**3 - count)  # the next one below 1, two neighbours exchanged
        inside = math.atanh(min(max(rank, -most), most))
        width = 1.959963984540054 * math.sqrt((1.0 + 0.5 * rank**2) / (count - 3))
        low, high = math.tanh(inside - width), math.tanh(inside + width)
        found.append(Driver(name, Estimate(rank, min(low, rank), max(high, rank))))
    return sorted(found, key=lambda driver: -abs(driver.correlation.value))


def together(parameters: Mapping[str, Array]) -> str:
    """Which two parameters go together most in their samples, in words; empty if none do."""
    from scipy.stats import rankdata  # slow to import

    varied = [name for name, numbers in parameters.items() if np.ptp(numbers)]
    if len(varied) < 2 or len(parameters[varied[0]]) < SOME:
        return ''
    ranks = np.corrcoef(rankdata([parameters[name] for name in varied], axis=1))
    np.fill_diagonal(ranks, 0.0)
    one, other = map(int, np.unravel_index(np.abs(ranks).argmax(), ranks.shape))
    if abs(ranks[one, other]) < TOGETHER:
        return ''
    return (
        f'{varied[one]} and {varied[other]} go together in these samples (rank correlation '
        f'{ranks[one, other]:.2f}): their effects are not told apart'
    )


def distribution(values: Array) -> tuple[Array, Array]:
    """Empirical distribution function of those values that are finite.

    Returns:
        Values in order, and the share of all runs that are not above each.
    """
    ordered = np.sort(values[np.isfinite(values)])
    return ordered, np.arange(1, len(ordered) + 1) / max(1, len(values))


def _open(value: float) -> float:
    return math.inf if value > LARGEST else float(value)
