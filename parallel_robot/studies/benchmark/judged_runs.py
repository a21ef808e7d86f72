"""The searches for gains, all runs of all laws, and their scores."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.analysis.metrics import named
from parallel_robot.studies.benchmark.protocol import (
    Condition,
    Protocol,
    Robot,
    conditions,
    planned,
    rows,
    search_plan,
)
from parallel_robot.studies.benchmark.scores import (
    EFFORTS,
    RunFigures,
    RunKey,
    ScoredRun,
    Store,
    score,
)
from parallel_robot.studies.calm import Calm
from parallel_robot.studies.sweep.results import ERRORS
from parallel_robot.studies.sweep.run_chunk import Outcome, Task, version
from parallel_robot.studies.sweep.study import Variant
from parallel_robot.studies.sweep.sweep import progress
from parallel_robot.studies.sweep.workers import Workers, completed
from parallel_robot.studies.tuning.front import front
from parallel_robot.studies.tuning.space import space_of
from parallel_robot.studies.tuning.trial import Effort, Trial
from parallel_robot.studies.tuning.tune import Store as TuningStore
from parallel_robot.studies.tuning.tune import Tuning
from parallel_robot.studies.tuning.tune import run as run_tuning
from parallel_robot_control.configuration import available
from parallel_robot_control.foreign.fmu_law import file_beside
from parallel_robot_control.law_loader import has_law_suffix
from parallel_robot_model.common.errors import InputError, UnknownNameError

# The laws of a benchmark: those of the suite by name, others by their file.

SHIPPED = 'of the suite'


@dataclass(frozen=True)
class Competitors:
    """The laws that are judged."""

    names: tuple[str, ...]  # their names, in order
    files: tuple[Path, ...]  # files of those that are not of the suite

    @property
    def code(self) -> dict[str, Any]:
        """Keys of the configuration that name the files."""
        return {'custom_laws': [str(path) for path in self.files]} if self.files else {}

    def sources(self) -> dict[str, str]:
        """Law to the SHA-256 of its file and of what stands beside it, or that it is shipped."""
        found = dict.fromkeys(self.names, SHIPPED)
        for path in self.files:
            beside = file_beside(path)
            called = beside.read_bytes() if beside else b''
            found[path.stem] = hashlib.sha256(path.read_bytes() + called).hexdigest()
        return found


def competitors(given: Sequence[str]) -> Competitors:
    """The laws by names and files.

    Args:
        given: Names of laws of the suite, and files of others.

    Raises:
        InputError: there is no such law or file, or a law is named twice.
    """
    files = [Path(each).resolve() for each in given if has_law_suffix(each)]
    for path in files:
        if not path.is_file():
            raise InputError(f'there is no file {path}')
    names = [Path(each).stem if has_law_suffix(each) else each for each in given]
    known = available([str(path) for path in files])
    for name in names:
        if name not in known:
            raise UnknownNameError('law', name, known)
        if names.count(name) > 1:
            raise InputError(f'{name} is named twice')
    return Competitors(tuple(names), tuple(files))


# The gains of a law on a robot, by the search of the protocol.

MEASURE = 'excess_chattering'


class TunedGains(NamedTuple):
    """What a search took."""

    # keys of the configuration and their values; empty where all trials failed
    values: Mapping[str, Any]
    within: bool  # whether these gains keep to the effort


def _tuned_gains(
    robot: Robot,
    law: str,
    protocol: Protocol,
    code: Mapping[str, Any],
    directory: Path,
    workers: Workers,
) -> TunedGains:
    """Search gains of a law for a robot, or go on in a search.

    The least error within the effort is taken; without one, the calmest trial.
    """
    asked = protocol.search
    plan = search_plan(robot, protocol, law, code)
    nominal = plan.cases[0].nominal
    known = available(nominal['custom_laws'])[law]
    search = [key for key in asked.search if key in nominal]
    space = space_of(law, known, nominal, asked.bounds, search)
    limit = asked.chattering * robot.force
    tuning = Tuning(plan, space, None, asked.seed, Effort(MEASURE, limit, plan.units))
    with TuningStore(directory, tuning.identity()) as store:
        trials = run_tuning(tuning, store, asked.trials, workers)
    taken = best(trials, limit)
    if taken is None:
        return TunedGains({}, False)
    values = {space.key(name): value for name, value in taken.gains.items()}
    return TunedGains(values, taken.effort <= limit)


def best(trials: list[Trial], limit: float) -> Trial | None:
    """The trial of the least error within an effort; without one, the calmest."""
    points = front(trials)
    calm = [point for point in points if point.effort <= limit]
    return calm[0] if calm else points[-1] if points else None


DEFAULT, TUNED = KINDS = ('default', 'tuned')
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
            robot.name: _tuned_gains(
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
    with progress(count, lambda: len(store.runs), 'run') as bar, workers as started:
        for task, outcomes in completed(started, tasks):
            found: dict[RunKey, RunFigures] = {}
            limits: dict[int, Calm | None] = {}
            for row, outcome in zip(task.rows, outcomes, strict=True):
                sample, entry = divmod(row.row, len(entries))
                found[RunKey(*entries[entry], sample)] = figures_of(outcome)
                if task.calm:
                    limits[sample] = outcome.calm
            store.add(found, limits)
            bar.update(len(outcomes))


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
        chosen = (replace(found[k], row=k * len(entries) + place) for k in lacking)
        yield Task(tuple(chosen), calm=place == 0)


def figures_of(outcome: Outcome) -> RunFigures:
    """The figures of an outcome."""
    known = outcome.metrics
    if known is None:
        return RunFigures(outcome.status, outcome.reason)
    errors = [metric.of(known) for metric in ERRORS]
    error = next((each for each in errors if math.isfinite(each)), math.nan)
    efforts = (metric.of(known) for metric in named(*EFFORTS))
    return RunFigures(outcome.status, outcome.reason, error, *efforts)


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
