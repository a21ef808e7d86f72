"""The runs that a report compares: read, evaluated, and each with a name and a style."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis import metrics, recorded_motions, timing
from parallel_robot.analysis.readable_metrics import early, unsettled
from parallel_robot.analysis.report import palette
from parallel_robot.analysis.report.labels import label, law_label
from parallel_robot.analysis.timing import Timing
from parallel_robot.bags import recorded_robot, run_log, stretches
from parallel_robot.bags.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.message_arrays import Samples, physical
from parallel_robot.bags.progress import tracked
from parallel_robot.bags.recorded_robot import NONE, RobotCode
from parallel_robot.bags.recording import Recording
from parallel_robot_control import law_titles
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.errors import BagError, InputError, KinematicsError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR
from parallel_robot_sim.motions import Motion


class Series(NamedTuple):
    """Values over time.

    Attributes:
        time: Since t = 0 [s], shape (N,).
        values: One column for each joint, shape (N, n).
    """

    time: np.ndarray
    values: np.ndarray


class Run(NamedTuple):
    """One bag of a report.

    Attributes:
        bag: Path of the bag.
        label: Its name in legends, different from all others of its group.
        style: Key of palette.STYLES.
        log: The recorded run.
        motion: Its true motion where that is known, else the one that was seen.
        metrics: Metrics of the run.
        cross_coupling: Cross-coupling errors [rad]; None when the bag has none.
        timing: How the run kept its time.
        cut: Why only a part of it was evaluated; empty when all of it was.
        doubts: What else to know of its figures, e.g. that they are not the true ones.
        faulted: Whether the controller was in a fault: its metrics are not those of the law.
        marks: Times at which law or gains changed [s].
    """

    bag: Path
    label: str
    style: str
    log: run_log.RunLog
    motion: Motion
    metrics: metrics.Metrics
    cross_coupling: Series | None
    timing: Timing
    cut: str
    doubts: list[str]
    faulted: bool
    marks: tuple[float, ...] = ()


def read_runs(
    bags: Sequence[str | Path],
    memory: int = MEMORY,
    code: RobotCode = NONE,
    view: BagView = AS_RECORDED,
) -> dict[str, list[Run]]:
    """Read bags.

    Args:
        bags: Directories of the bags, or one file of each.
        memory: Memory that reading each may take [bytes].
        code: What may run to know their robots.
        view: What bags do not say themselves, and which part is wanted.

    Returns:
        Scenario to its runs, in the order of `bags`; runs of one scenario with several robots
        are a group for each, named after both.

    Raises:
        InputError: more bags than there are styles; one is no bag, or its joints are not those of
            its robot.
    """
    if len(bags) > len(palette.RUNS):
        raise InputError(f'a report takes up to {len(palette.RUNS)} bags, not {len(bags)}')
    recordings: dict[tuple[str, str], list[tuple[Path, Recording]]] = {}
    for bag in tracked(map(Path, bags), len(bags), 'bags read'):
        found = recorded_robot.read(bag, memory, code, (CROSS_COUPLING_ERROR,), view)
        law_titles.learn(found.history.sources['custom_laws'])
        group = label(found.log.scenario), _robot(found.log)
        recordings.setdefault(group, []).append((bag, found))
    scenarios = [scenario for scenario, _ in recordings]
    groups = {}
    for (scenario, robot), members in recordings.items():
        title = scenario if scenarios.count(scenario) == 1 else f'{scenario} ({robot})'
        names = _labels([(bag, law_label(found.log.law)) for bag, found in members])
        slots = palette.slots([printable(found.log.law) for _, found in members])
        groups[title] = [
            _evaluate(bag, name, f'run{slot}', found)
            for (bag, found), name, slot in zip(members, names, slots, strict=True)
        ]
    return groups


def _robot(log: run_log.RunLog) -> str:
    """Robot and number of joints, the same for all runs that are drawn together."""
    return f'{label(str(log.config["robot_model"]))}, {len(log.joints)} joints'


def _evaluate(bag: Path, name: str, style: str, found: Recording) -> Run:
    log, past, extra = found
    timed = timing.evaluate(log, past)
    faulted = any(status.fault != NO_FAULT for status in past.statuses)
    try:
        part = recorded_motions.of_bag(log, past)
    except KinematicsError as error:
        raise BagError(f'{bag}: {error}') from None
    log, motion, result = part.log, part.motions.best, metrics.figures(part.motions)
    coupling = cross_coupling(log, extra.get(CROSS_COUPLING_ERROR))
    parts = stretches.of_run(past, log)
    laws = stretches.laws(parts)
    if len(laws) > 1:  # it is no run of its first law
        name = ', then '.join(map(law_label, laws))
        log = log._replace(law=', then '.join(laws))
    ended = early(result.window.run_s, float(log.config['duration']))
    told = [*filter(None, [ended]), *unsettled(result), *part.remarks, *stretches.told(parts)]
    marks = tuple(one.begin for one in parts[1:])
    return Run(
        bag, name, style, log, motion, result, coupling, timed, part.cut, told, faulted, marks
    )


def _labels(members: list[tuple[Path, str]]) -> list[str]:
    """Name of the law, with that of the bag if two have the same law, and a number if needed."""
    names = [name for _, name in members]
    labels = [
        name if names.count(name) == 1 else f'{name} ({label(bag.name)})' for bag, name in members
    ]
    seen: Counter[str] = Counter()
    numbered = []
    for text in labels:
        seen[text] += 1
        numbered.append(text if labels.count(text) == 1 else f'{text} #{seen[text]}')
    return numbered


def cross_coupling(log: run_log.RunLog, errors: Samples | None) -> Series | None:
    """Cross-coupling errors of a run from t = 0 on; None when its bag has none."""
    if errors is None:
        return None
    used = physical(errors) & (errors.stamps >= log.start_stamp)
    if not used.any():
        return None
    time = (errors.stamps[used] - log.start_stamp) / NANOSECONDS
    return Series(time, errors.numbers['position'][used])
