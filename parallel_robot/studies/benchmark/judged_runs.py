"""The searches for gains, all runs of all laws, and their scores."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from itertools import product
from typing import Any

from parallel_robot.studies.benchmark.competitors import Competitors
from parallel_robot.studies.benchmark.protocol import (
    Condition,
    Protocol,
    conditions,
    planned,
    rows,
)
from parallel_robot.studies.benchmark.scores import ScoredRun, score
from parallel_robot.studies.benchmark.store import RunFigures, RunKey, Store
from parallel_robot.studies.benchmark.tuned_gains import TunedGains, tuned_gains
from parallel_robot.studies.limit.calm import Calm
from parallel_robot.studies.sweep.run_chunk import Outcome
from parallel_robot.studies.sweep.study import Variant
from parallel_robot.studies.sweep.sweep import progress
from parallel_robot.studies.sweep.table import METRICS
from parallel_robot.studies.sweep.tasks import Task, version
from parallel_robot.studies.sweep.workers import Workers, completed

DEFAULT, TUNED = KINDS = ('default', 'tuned')
ERRORS = ('xy_rms_m', 'joint_rms_rad')  # the first that a robot has
Gains = Mapping[str, Mapping[str, TunedGains]]  # law, robot


def identity(protocol: Protocol, laws: Competitors) -> dict[str, Any]:
    """What the runs of a benchmark depend on, by names for people."""
    return {
        'protocol': [protocol.name, protocol.version, protocol.digest],
        'length': 'quick' if protocol.quick else 'whole',
        'seed': protocol.seed,
        'version of the suite': version(),
        'laws': laws.sources(),
    }


def search(
    protocol: Protocol, laws: Competitors, store: Store, workers: Callable[[], Workers]
) -> Gains:
    """Search the gains of all laws for all robots, or what is left of it.

    Raises:
        InputError: a law has no gain to vary.
        RunError: workers cannot run it, or the disk is full; finished trials are kept.
    """
    return {
        law: {
            robot.name: tuned_gains(
                robot, law, protocol, laws.code, store.searches / f'{law}_{robot.name}', workers()
            )
            for robot in protocol.robots
        }
        for law in laws.names
    }


def run(
    protocol: Protocol,
    laws: Competitors,
    gains: Gains,
    store: Store,
    workers: Callable[[], Workers],
) -> dict[str, dict[str, list[ScoredRun]]]:
    """Run what is left of a benchmark, and score it.

    Args:
        protocol: The protocol.
        laws: The laws.
        gains: Their tuned gains.
        store: The open directory.
        workers: Makes those who run it; they are started only if something is left.

    Returns:
        Law, and 'default' or 'tuned', to its runs in the order of the samples.

    Raises:
        RunError: workers cannot run it, or the disk is full; finished runs are kept.
    """
    every = list(conditions(protocol))
    count = sum(len(condition.samples) for condition in every) * len(laws.names) * len(KINDS)
    if len(store.runs) < count:
        _run_left(every, count, protocol, laws, gains, store, workers())
    return {
        law: {kind: [*_scored(every, law, kind, store)] for kind in KINDS} for law in laws.names
    }


def _run_left(
    every: list[Condition],
    count: int,
    protocol: Protocol,
    laws: Competitors,
    gains: Gains,
    store: Store,
    workers: Workers,
) -> None:
    entries = list(product(laws.names, KINDS))
    tasks = (
        task
        for condition in every
        for task in _tasks(condition, protocol, laws, gains, store, entries)
    )
    try:
        with workers as started, progress(count, len(store.runs), 'run') as bar:
            for task, outcomes in completed(started, tasks):
                found: dict[RunKey, RunFigures] = {}
                limits: dict[int, Calm | None] = {}
                for number, outcome in zip(task.numbers, outcomes, strict=True):
                    sample, entry = divmod(number, len(entries))
                    found[RunKey(*entries[entry], sample)] = figures_of(outcome)
                    if task.calm:
                        limits[sample] = outcome.calm
                store.add(found, limits)
                bar.update(len(outcomes))
    except KeyboardInterrupt:
        kept = f'{len(store.runs)} of {count} runs are kept'
        print(f'interrupted: {kept}, the same command continues', file=sys.stderr)
        raise


def _tasks(
    condition: Condition,
    protocol: Protocol,
    laws: Competitors,
    gains: Gains,
    store: Store,
    entries: list[tuple[str, str]],
) -> Iterator[Task]:
    """The tasks that are left of a condition, one for each law and kind of gains.

    The runs of the first entry tell the limits of the samples, which are kept before them.
    """
    samples = range(condition.first, condition.first + len(condition.samples))
    left = {
        entry: [sample for sample in samples if RunKey(*entry, sample) not in store.runs]
        for entry in entries
    }
    left = {entry: lacking for entry, lacking in left.items() if lacking}
    if not left:
        return
    variants = []
    for law, kind in left:
        values = gains[law][condition.robot.name].values if kind == TUNED else {}
        variants.append(Variant(f'{law}_{kind}', law, values))
    plan = planned(condition, protocol, variants, laws.code)
    for case, (entry, lacking) in enumerate(left.items()):
        place = entries.index(entry)
        found = dict(zip(samples, rows(condition, plan, case), strict=True))
        yield Task(
            condition.robot.scenario,
            tuple(sample * len(entries) + place for sample in lacking),
            tuple(found[sample].overrides for sample in lacking),
            version(),
            calm=place == 0,
        )


def figures_of(outcome: Outcome) -> RunFigures:
    """The figures of an outcome."""
    known = outcome.metrics
    if known is None:
        return RunFigures(outcome.status, outcome.reason)
    errors = [METRICS[column](known) for column in ERRORS]
    error = next((each for each in errors if math.isfinite(each)), math.nan)
    columns = ('chattering_nm', 'torque_rms_nm', 'energy_j')
    return RunFigures(
        outcome.status, outcome.reason, error, *(METRICS[column](known) for column in columns)
    )


def _scored(every: list[Condition], law: str, kind: str, store: Store) -> Iterator[ScoredRun]:
    for condition in every:
        for k, scramble in enumerate(condition.samples):
            sample = condition.first + k
            figures = store.runs[RunKey(law, kind, sample)]
            yield ScoredRun(
                condition.labels, scramble, score(figures, store.limits[sample]), figures
            )


def digest(runs: Mapping[str, Mapping[str, list[ScoredRun]]]) -> str:
    """SHA-256 of all figures and scores, to the last digit."""
    text = json.dumps(
        {
            law: {
                kind: [[run.score, *run.figures] for run in of_kind]
                for kind, of_kind in kinds.items()
            }
            for law, kinds in runs.items()
        }
    )
    return hashlib.sha256(text.encode()).hexdigest()
