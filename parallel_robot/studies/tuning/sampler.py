"""Proposals of gains, by optuna's tree-structured Parzen estimator (TPE).

Source:
    Ozaki, Tanigaki, Watanabe, Onishi (2020), Multiobjective tree-structured Parzen estimator.
    Deb (2000), An efficient constraint handling method for genetic algorithms: `within`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from parallel_robot.studies.tuning.space import Choice, Space, Value
from parallel_robot.studies.tuning.trial import Trial
from parallel_robot_model.common.errors import optional

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial

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
    """What a search is to make small.

    Attributes:
        objectives: How many figures.
        values: The figures of a feasible trial.
    """

    objectives: int
    values: Callable[[Trial], tuple[float, ...]]


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
    made: FrozenTrial = optuna.trial.create_trial(
        state=states.COMPLETE if trial.feasible else states.PRUNED,
        values=values,
        params=dict(trial.chosen or {}),
        distributions=among if trial.chosen is not None else {},
        constraints={'runs not ok': trial.violation},
    )
    return made
