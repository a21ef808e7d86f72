"""Proposals of gains, by optuna's tree-structured Parzen estimator (TPE).

Source:
    Ozaki, Tanigaki, Watanabe, Onishi (2020), Multiobjective tree-structured Parzen estimator.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from parallel_robot_analysis.tuning.space import Choice, Space, Value
from parallel_robot_analysis.tuning.trial import Trial
from parallel_robot_analysis.tuning.weights import Weights
from parallel_robot_base.errors import InputError

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution
    from optuna.trial import FrozenTrial

BATCH = 8  # trials that are proposed at once, whatever the number of workers


def library() -> ModuleType:
    """The module optuna, quiet.

    Raises:
        InputError: it is not installed.
    """
    try:
        import optuna  # optional
    except ImportError:
        raise InputError('optuna is not installed; pip install optuna') from None
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


def propose(
    space: Space, history: Sequence[Trial], weights: Weights | None, seed: int, batch: int
) -> list[dict[str, Value]]:
    """Gains to try next.

    They follow from the arguments alone, so that a tuning that was killed goes on as if it had
    not been.

    Args:
        space: The search space.
        history: All trials of the batches before, by number; the first is the default.
        weights: Weights of a single objective; None: error and effort as a Pareto front.
        seed: Seed of the tuning.
        batch: Number of the batch.

    Returns:
        BATCH choices of the gains that are varied.
    """
    optuna, among = library(), distributions(space)
    mixed = np.random.SeedSequence(seed, spawn_key=(batch,)).generate_state(1)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # what is experimental in optuna
        sampler = optuna.samplers.TPESampler(
            seed=int(mixed[0]), multivariate=True, constant_liar=True
        )
        count = 2 if weights is None else 1
        study = optuna.create_study(directions=['minimize'] * count, sampler=sampler)
        for trial in history:
            if trial.chosen is not None:
                study.add_trial(frozen(trial, among, weights, history[0]))
        return [dict(study.ask(among).params) for _ in range(BATCH)]


def frozen(
    trial: Trial, among: dict[str, BaseDistribution], weights: Weights | None, default: Trial
) -> FrozenTrial:
    """A finished trial for optuna; infeasible ones are pruned, with their violation."""
    optuna = library()
    values = None
    if trial.feasible:
        figures = [trial.error, trial.effort]
        values = figures if weights is None else [weights.cost(trial, default)]
    states = optuna.trial.TrialState
    made: FrozenTrial = optuna.trial.create_trial(
        state=states.COMPLETE if trial.feasible else states.PRUNED,
        values=values,
        params=dict(trial.chosen or {}),
        distributions=among if trial.chosen is not None else {},
        constraints={'runs not ok': trial.violation},
    )
    return made
