"""The gains of a law on a robot, by the search of the protocol."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.studies.benchmark.protocol import Protocol, Robot, search_plan
from parallel_robot.studies.sweep.workers import Workers
from parallel_robot.studies.tuning.effort import Effort
from parallel_robot.studies.tuning.front import front
from parallel_robot.studies.tuning.space import space_of
from parallel_robot.studies.tuning.store import Store
from parallel_robot.studies.tuning.trial import Trial
from parallel_robot.studies.tuning.tune import Tuning, run
from parallel_robot_control.configuration import available

MEASURE = 'excess_chattering'


class TunedGains(NamedTuple):
    """What a search took.

    Attributes:
        values: Keys of the configuration and their values; empty where all trials failed.
        within: Whether these gains keep to the effort.
    """

    values: Mapping[str, Any]
    within: bool


def tuned_gains(
    robot: Robot,
    law: str,
    protocol: Protocol,
    code: Mapping[str, Any],
    directory: Path,
    workers: Workers,
) -> TunedGains:
    """Search gains of a law for a robot, or go on in a search.

    The least error within the effort is taken; without one, the calmest trial.

    Args:
        robot: The robot.
        law: Name of the law.
        protocol: The protocol.
        code: Keys of the configuration that name the files of laws.
        directory: Where the trials are kept.
        workers: Who runs them.

    Raises:
        InputError: the law has no gain to vary.
        RunError: workers cannot run it, or the disk is full; finished trials are kept.
    """
    asked = protocol.search
    plan = search_plan(robot, protocol, law, code)
    nominal = plan.cases[0].nominal
    known = available(nominal['custom_laws'])[law]
    search = [key for key in asked.search if key in nominal]
    space = space_of(law, known, nominal, asked.bounds, search)
    limit = asked.chattering * robot.force
    tuning = Tuning(plan, space, None, asked.seed, Effort(MEASURE, limit, plan.units))
    with Store(directory, space, tuning.identity()) as store:
        trials = run(tuning, store, asked.trials, workers)
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
