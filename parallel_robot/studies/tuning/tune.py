"""A tuning: batches of trials, each run on the same samples of the uncertainty, and kept."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

from parallel_robot.analysis.metrics import Metric
from parallel_robot.studies.result_store import ResultStore
from parallel_robot.studies.sweep.plan import Plan
from parallel_robot.studies.sweep.results import ERRORS
from parallel_robot.studies.sweep.run_chunk import Outcome, Task, version
from parallel_robot.studies.sweep.sweep import progress
from parallel_robot.studies.sweep.workers import Workers, completed
from parallel_robot.studies.tuning.space import Space, Value, objection
from parallel_robot.studies.tuning.trial import (
    BATCH,
    FORBIDDEN,
    FRONT,
    MEASURES,
    Effort,
    Goal,
    Rule,
    Trial,
    Verdict,
    Weights,
    evaluated,
    judge_convergence,
    propose,
    within,
)
from parallel_robot_control.configuration import available
from parallel_robot_control.contract import Law
from parallel_robot_model.common.errors import InputError, RunError
from parallel_robot_model.robots.registry import robot_of

Choice = dict[str, Value] | None
AT_ONCE = 8  # runs of a trial in one task
NUMBER = re.compile(r'-?\b\d[\d.]*(e[-+]?\d+)?')


@dataclass(frozen=True)
class Tuning:
    """What is tuned, and how."""

    plan: Plan  # the law in its scenario, with the samples of the uncertainty
    space: Space  # the search space
    weights: Weights | None  # weights of a single objective; None: a Pareto front
    seed: int  # seed of the proposals
    effort: Effort  # what the error is traded against

    @property
    def nominal(self) -> Mapping[str, Any]:
        """The resolved configuration without uncertainty."""
        return self.plan.cases[0].nominal

    @property
    def law(self) -> Law:
        """The law."""
        return available(self.nominal['custom_laws'])[self.space.law]

    @property
    def error(self) -> Metric:
        """Which metric is the tracking error: that of the end effector, or of the joints."""
        return self._error.in_units(self.plan.units)

    @property
    def _error(self) -> Metric:
        return ERRORS[0] if robot_of(self.nominal).place else ERRORS[1]

    @property
    def measured(self) -> tuple[str, str]:
        """Keys of the metrics of tracking error and effort."""
        return self._error.key, MEASURES[self.effort.measure].key

    @property
    def goal(self) -> str:
        """What the best gains are the best in, in words."""
        measure, quantity = self.effort.measure, self.effort.quantity
        if self.weights is not None:
            return f'weighted sum of error and {measure}'
        limit = self.effort.limit
        if limit is None:
            return f'error with no more {measure} than the default gains'
        return f'error with at most {quantity.scale * limit:g} {quantity.unit} of {measure}'

    def figure(self, trial: Trial, default: Trial) -> float:
        """How good a trial is, the smaller the better; infinite if it does not count."""
        if not trial.feasible or trial.chosen is None:
            return math.inf
        if self.weights is not None:
            return self.weights.cost(trial, default)
        limit = default.effort if self.effort.limit is None else self.effort.limit
        return trial.error if trial.effort <= limit else math.inf

    def goals(self, history: Sequence[Trial]) -> list[Goal]:
        """What the next trials are to make small: the front, and where it meets the limit."""
        if self.weights is not None:
            weights = self.weights
            return [Goal(1, lambda trial: (weights.cost(trial, history[0]),))]
        limit = self.effort.limit
        return [FRONT] if limit is None else [FRONT, within(limit, history)]

    def best(self, trials: Sequence[Trial]) -> list[float]:
        """The best figure after each trial."""
        return [*accumulate((self.figure(each, trials[0]) for each in trials), min)]

    def judge(self, trials: Sequence[Trial], rule: Rule) -> Verdict:
        """Judge whether the search has converged."""
        return judge_convergence(self.best(trials), [each.ran for each in trials], rule)

    def identity(self) -> dict[str, Any]:
        """What the trials depend on, by names for people."""
        of_study = self.plan.description()
        return {
            'law': self.space.law,
            'scenario': self.nominal['scenario'],
            'version of the suite': version(),
            'seed': self.seed,
            'weights': None if self.weights is None else self.weights._asdict(),
            'measure of effort': self.effort.measure,
            'number of runs': self.plan.study.runs,
            'uncertainty': [of_study[key] for key in ('seed', 'method', 'uncertainty')],
            'configuration': of_study['configuration'],
            'search space': self.space.description(),
        }


TRIALS = 'trials.jsonl'


class Store(ResultStore):
    """The directory of a tuning: its trials, a line each, kept as soon as they have ended."""

    KIND = 'tuning'
    MANIFEST = 'tune.json'
    FORMAT = 'parallel_robot tune 1'

    def __init__(self, directory: Path, identity: Mapping[str, Any]) -> None:
        """Prepare the directory for a tuning, or to go on in it.

        Args:
            directory: The directory.
            identity: What the trials depend on, plain data by name; another one is refused.
        """
        super().__init__(directory, identity)
        self.trials: dict[int, Trial] = {}  # finished trials by number

    def add(self, trial: Trial) -> None:
        """Keep a finished trial.

        Raises:
            RunError: it cannot be written.
        """
        self.append(TRIALS, [vars(trial)])
        self.trials[trial.number] = trial

    def _kept(self) -> str:
        return f'{len(self.trials)} trials'

    def _open(self) -> None:
        self._identify()
        self.read(TRIALS, self._take)

    def _take(self, entry: Any) -> None:
        trial = Trial(**entry)
        self.trials[trial.number] = trial


def run(
    tuning: Tuning, store: Store, count: int, workers: Workers, until: Rule | None = None
) -> list[Trial]:
    """Run what is left of a tuning.

    Args:
        tuning: The tuning.
        store: Its directory.
        count: Number of trials in total.
        workers: Who runs them; they are started only if something is left.
        until: A rule, if the search ends with the batch after which it has converged.

    Returns:
        All trials by number, the first of which is that of the default gains.

    Raises:
        InputError: the directory holds more trials, or weights have nothing to be relative to.
        RunError: workers cannot run them, or the disk is full; finished trials are kept.
    """
    held = max(store.trials, default=-1) + 1
    if held > count:
        raise InputError(
            f'{store.directory} holds {held} trials, --trials must be at least that, not {count}'
        )
    if not _finished(tuning, store, count, until):
        with progress(count, lambda: len(store.trials), 'trial') as bar, workers as started:
            for batch in range(-(-count // BATCH)):
                for _ in _run_batch(tuning, store, batch, count, started):
                    bar.update(1)
                _check_default(tuning, store)
                if _finished(tuning, store, count, until):
                    break
    _check_default(tuning, store)
    return [store.trials[number] for number in range(len(store.trials))]


def _finished(tuning: Tuning, store: Store, count: int, until: Rule | None) -> bool:
    """Whether all trials were run, or whole batches of them until the search has converged."""
    held = len(store.trials)
    if held == count:
        return True
    if until is None or held % BATCH or any(number not in store.trials for number in range(held)):
        return False
    trials = [store.trials[number] for number in range(held)]
    return tuning.judge(trials, until).converged


def infeasible(trials: Sequence[Trial]) -> dict[str, int]:
    """Reasons why trials are infeasible, the most frequent first.

    Those that differ in numbers alone count as one, which is reported as it came first.
    """
    reasons = [trial.reason for trial in trials if not trial.feasible]
    first: dict[str, str] = {}
    counts = Counter(first.setdefault(NUMBER.sub('#', reason), reason) for reason in reasons)
    return dict(counts.most_common())


def _run_batch(
    tuning: Tuning, store: Store, batch: int, count: int, workers: Workers
) -> Iterator[Trial]:
    """Run the trials of a batch that are left; yields each when it is kept."""
    first = batch * BATCH
    left = [n for n in range(first, min(first + BATCH, count)) if n not in store.trials]
    if not left:
        return
    history = [store.trials[number] for number in range(first)]
    choices: list[Choice] = [
        *propose(tuning.space, history, tuning.goals(history), tuning.seed, batch)
    ]
    if batch == 0:
        choices[0] = tuning.space.start()
    law = tuning.law
    joints = len(tuning.nominal['joints'])
    trials: dict[int, tuple[Choice, dict[str, Any]]] = {}
    for number in left:
        choice = choices[number - first]
        gains = dict(tuning.space.default) if number == 0 else tuning.space.gains(choice or {})
        reason = objection(tuning.space, law, gains, joints)
        if reason:
            store.add(Trial(number, choice, gains, violation=FORBIDDEN, reason=reason))
            yield store.trials[number]
        else:
            trials[number] = choice, gains
    outcomes: dict[int, dict[int, Outcome]] = {number: {} for number in trials}
    runs = tuning.plan.study.runs
    columns = tuning.measured
    for task, found in completed(workers, _tasks(tuning, trials)):
        number = task.rows[0].row // runs
        outcomes[number] |= zip((row.row for row in task.rows), found, strict=True)
        if len(outcomes[number]) == runs:
            ordered = [outcomes[number][key] for key in sorted(outcomes[number])]
            store.add(evaluated(number, *trials[number], ordered, columns))
            yield store.trials[number]


def _tasks(tuning: Tuning, trials: Mapping[int, tuple[Choice, dict[str, Any]]]) -> Iterator[Task]:
    """The runs of trials, some in a task."""
    runs = tuning.plan.study.runs
    for number, (_, gains) in trials.items():
        own = {tuning.space.key(key): value for key, value in gains.items()}
        for first in range(0, runs, AT_ONCE):
            rows = tuning.plan.rows(0, first, min(AT_ONCE, runs - first))
            yield Task(
                tuple(
                    replace(
                        row, row=number * runs + row.sample, overrides={**row.overrides, **own}
                    )
                    for row in rows
                )
            )


def _check_default(tuning: Tuning, store: Store) -> None:
    """Refuse weights when the default gains have no figures."""
    default = store.trials.get(0)
    if tuning.weights is not None and default is not None and not default.feasible:
        raise RunError(
            '--weights are relative to the default gains, which are infeasible '
            f'({default.reason}); set others by --set, or leave --weights out'
        )
