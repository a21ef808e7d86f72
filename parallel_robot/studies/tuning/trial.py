"""A trial: gains that were tried, and what their runs came to."""

from __future__ import annotations

import math
import statistics
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import Metric, named
from parallel_robot.studies.sweep.results import OTHERS
from parallel_robot.studies.sweep.run_chunk import Outcome
from parallel_robot.studies.tuning.space import Choice, Space, Value
from parallel_robot_model.common.errors import InputError, UnknownNameError, optional
from parallel_robot_model.common.units import HINGES, JointUnits

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial


FORBIDDEN = 2.0  # violation of gains that are not run; more than if all runs failed


@dataclass(frozen=True)
class Trial:
    """Gains that were tried."""

    number: int  # from 0, which is the default
    # the gains that are varied; None for a default outside the search space
    chosen: Mapping[str, Value] | None
    gains: Mapping[str, Any]  # all gains of the law
    # median of the tracking error [m or rad]; infinite if the trial is infeasible
    error: float = math.inf
    # median of the effort [unit of its column]; infinite if the trial is infeasible
    effort: float = math.inf
    # share of the runs that were not ok; FORBIDDEN for gains that were not run
    violation: float = 0.0
    reason: str = ''  # why the trial is infeasible; empty if it is feasible

    @property
    def feasible(self) -> bool:
        """Whether all its runs were ok."""
        return not self.reason

    @property
    def ran(self) -> bool:
        """Whether it was run: the gains are not forbidden."""
        return self.violation < FORBIDDEN


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
        found = outcome.metrics
        pair = [metric.of(found) for metric in named(*columns)] if found else []
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


# Whether a search has converged: what the last trials have brought.

JUDGED_EACH = 20  # trials without improvement for each gain that is varied
FEWEST_TRIALS = 120


def patience_for(gains: int) -> int:
    """How many trials without improvement a search of so many gains takes to converge."""
    return max(FEWEST_TRIALS, JUDGED_EACH * gains)


@dataclass(frozen=True)
class Rule:
    """When a search has converged."""

    patience: int  # number of trials, of those that were run, that brought hardly anything
    improvement: float  # the share of the best figure that counts as hardly anything


@dataclass(frozen=True)
class Verdict:
    """What the last trials of a search have brought."""

    rule: Rule
    trials: int  # number of all trials
    ran: int  # number of those that were run: gains that a law forbids teach nothing
    # share by which the best figure fell within the last trials; infinite if there was none before
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


def judge_convergence(best: Sequence[float], ran: Sequence[bool], rule: Rule) -> Verdict:
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


# Weights: one objective from error and effort, each relative to that of the default gains.


class Weights(NamedTuple):
    """Weights of the two objectives; omitted weights are zero."""

    error: float = 0.0
    effort: float = 0.0

    def cost(self, trial: Trial, default: Trial) -> float:
        """Weighted sum of the figures of a trial, relative to those of the default gains."""
        relative = (trial.error / (default.error or 1.0)) if self.error else 0.0
        spent = (trial.effort / (default.effort or 1.0)) if self.effort else 0.0
        return self.error * relative + self.effort * spent


def weights_of(given: Mapping[str, float] | str, measure: str) -> Weights:
    """Weights from a mapping, or from ``error=2,chattering=1``.

    Args:
        given: The mapping, or the words.
        measure: What the effort is called.

    Raises:
        InputError: a name is unknown or stands twice, or a weight is not positive.
    """
    names = {'error': 'error', measure: 'effort'}
    found: dict[str, float] = {}
    words = given.split(',') if isinstance(given, str) else [f'{k}={v}' for k, v in given.items()]
    for word in words:
        name, equals, number = (part.strip() for part in word.partition('='))
        if not equals:
            raise InputError(f'--weights takes error=NUMBER,{measure}=NUMBER, not {given!r}')
        if name not in names:
            raise UnknownNameError('weight', name, names)
        if names[name] in found:
            raise InputError(f'--weights names {name} twice')
        found[names[name]] = _positive(f'--weights: {name}', number)
    return Weights(**found)


# The effort of a trial: the metric that the error is traded against, and how much is allowed.

MEASURES = {quantity.key.rpartition('_')[0]: quantity for quantity in OTHERS}
DEFAULT_EFFORT = 'chattering'


@dataclass(frozen=True)
class Effort:
    """A measure of effort."""

    measure: str = DEFAULT_EFFORT  # key of MEASURES
    # most effort of the gains that are taken, in the unit of the column; None: no limit
    limit: float | None = None
    units: JointUnits = HINGES  # those of the joints

    @property
    def quantity(self) -> Metric:
        """The column, its name and unit."""
        return MEASURES[self.measure].in_units(self.units)

    def shown(self, value: float) -> str:
        """A value of the column with its name and unit."""
        quantity = self.quantity
        return f'{quantity.name} {quantity.scale * value:.4g} {quantity.unit}'


def parse_effort(text: str) -> Effort:
    """An effort from ``MEASURE`` or ``MEASURE=LIMIT``.

    Raises:
        InputError: there is no such measure, or the limit is not positive.
    """
    measure, equals, number = (part.strip() for part in text.partition('='))
    if measure not in MEASURES:
        raise UnknownNameError('measure of effort', measure, MEASURES)
    if not equals:
        return Effort(measure)
    return Effort(measure, _positive(f'--effort: {measure}', number) / MEASURES[measure].scale)


def _positive(what: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise InputError(f'{what} must be a positive number, not {text!r}')
    return number


# Proposals of gains, by optuna's tree-structured Parzen estimator (TPE).
#
# Source:
#     Ozaki, Tanigaki, Watanabe, Onishi (2020), Multiobjective tree-structured Parzen estimator.
#     Deb (2000), An efficient constraint handling method for genetic algorithms: `within`.

BATCH = 8  # trials that are proposed at once, whatever the number of workers


def library() -> ModuleType:
    """The module optuna, quiet.

    Raises:
        InputError: it is not installed.
    """
    with warnings.catch_warnings():  # of tqdm, in a notebook without widgets
        warnings.simplefilter('ignore')
        optuna = optional('optuna')
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna


def distributions(space: Space) -> dict[str, BaseDistribution]:
    """The search space for optuna."""
    of = library().distributions
    found = {}
    for key, among in space.varied.items():
        if isinstance(among, Choice):
            found[key] = of.CategoricalDistribution(among.values)
        elif among.whole:
            found[key] = of.IntDistribution(int(among.low), int(among.high), log=among.log)
        else:
            found[key] = of.FloatDistribution(among.floor, among.high, log=among.log)
    return found


class Goal(NamedTuple):
    """What a search is to make small."""

    objectives: int  # how many figures
    values: Callable[[Trial], tuple[float, ...]]  # the figures of a feasible trial


FRONT = Goal(2, lambda trial: (trial.error, trial.effort))


def within(limit: float, history: Sequence[Trial]) -> Goal:
    """The least error within a limit of the effort.

    Trials within it are ranked by their error, those beyond it by their effort, behind them.
    """
    worst = max((trial.error for trial in history if trial.feasible), default=1.0)

    def values(trial: Trial) -> tuple[float]:
        spent = trial.effort / limit
        return (trial.error if spent <= 1.0 else worst * spent,)

    return Goal(1, values)


def propose(
    space: Space, history: Sequence[Trial], goals: Sequence[Goal], seed: int, batch: int
) -> list[dict[str, Value]]:
    """Gains to try next.

    They follow from the arguments alone, so that a tuning that was killed goes on as if it had
    not been.

    Args:
        space: The search space.
        history: All trials of the batches before, by number; the first is the default.
        goals: What is searched for; each has an equal share of the batch.
        seed: Seed of the tuning.
        batch: Number of the batch.

    Returns:
        BATCH choices of the gains that are varied.
    """
    optuna, among = library(), distributions(space)
    mixed = np.random.SeedSequence(seed, spawn_key=(batch,)).generate_state(len(goals))
    found: list[dict[str, Value]] = []
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # what is experimental in optuna
        for goal, own in zip(goals, mixed, strict=True):
            sampler = optuna.samplers.TPESampler(
                seed=int(own), multivariate=True, constant_liar=True
            )
            study = optuna.create_study(directions=['minimize'] * goal.objectives, sampler=sampler)
            for trial in history:
                if trial.chosen is not None:
                    study.add_trial(frozen(trial, among, goal))
            found += [dict(study.ask(among).params) for _ in range(BATCH // len(goals))]
    return found


def frozen(trial: Trial, among: dict[str, BaseDistribution], goal: Goal) -> FrozenTrial:
    """A finished trial for optuna; infeasible ones are pruned, with their violation."""
    optuna = library()
    values = list(goal.values(trial)) if trial.feasible else None
    states = optuna.trial.TrialState
    return optuna.trial.create_trial(
        state=states.COMPLETE if trial.feasible else states.PRUNED,
        values=values,
        params=dict(trial.chosen or {}),
        distributions=among if trial.chosen is not None else {},
        constraints={'runs not ok': trial.violation},
    )
