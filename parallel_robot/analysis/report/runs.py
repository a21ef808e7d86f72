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
from parallel_robot.bags import recorded_robot, run_log, stretches, telemetry
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.message_arrays import physical
from parallel_robot.bags.progress import tracked
from parallel_robot.bags.recorded_robot import NONE, RobotCode
from parallel_robot_control import law_titles
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.errors import BagError, InputError, KinematicsError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR


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
        log: The recorded run, with the joints of its true motion where that is known.
        poses: Poses of the robot.
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
    poses: metrics.Poses
    metrics: metrics.Metrics
    cross_coupling: Series | None
    timing: Timing
    cut: str
    doubts: list[str]
    faulted: bool
    marks: tuple[float, ...] = ()


def read_runs(
    bags: Sequence[str | Path], memory: int = MEMORY, code: RobotCode = NONE
) -> dict[str, list[Run]]:
    """Read bags.

    Args:
        bags: Directories of the bags, or one file of each.
        memory: Memory that reading each may take [bytes].
        code: What may run to know their robots.

    Returns:
        Scenario to its runs, in the order of `bags`; runs of one scenario with several robots
        are a group for each, named after both.

    Raises:
        InputError: more bags than there are styles; one is no bag, or its joints are not those of
            its robot.
    """
    if len(bags) > len(palette.RUNS):
        raise InputError(f'a report takes up to {len(palette.RUNS)} bags, not {len(bags)}')
    logs: dict[tuple[str, str], list[tuple[Path, run_log.RunLog, History]]] = {}
    for bag in tracked(map(Path, bags), len(bags), 'bags read'):
        log, past = recorded_robot.read(bag, memory, code)
        law_titles.learn(past.sources['custom_laws'])
        logs.setdefault((label(log.scenario), _robot(log)), []).append((bag, log, past))
    scenarios = [scenario for scenario, _ in logs]
    found = {}
    for (scenario, robot), members in logs.items():
        group = scenario if scenarios.count(scenario) == 1 else f'{scenario} ({robot})'
        names = _labels([(bag, law_label(log.law)) for bag, log, _ in members])
        slots = palette.slots([printable(log.law) for _, log, _ in members])
        found[group] = [
            _evaluate(bag, name, f'run{slot}', log, past, memory)
            for (bag, log, past), name, slot in zip(members, names, slots, strict=True)
        ]
    return found


def _robot(log: run_log.RunLog) -> str:
    """Robot and number of joints, the same for all runs that are drawn together."""
    return f'{label(str(log.config["robot_model"]))}, {len(log.joints)} joints'


def _evaluate(
    bag: Path, name: str, style: str, log: run_log.RunLog, past: History, memory: int
) -> Run:
    timed = timing.evaluate(log, past)
    faulted = any(status.fault != NO_FAULT for status in past.statuses)
    try:
        part = recorded_motions.of_bag(log, past)
    except KinematicsError as error:
        raise BagError(f'{bag}: {error}') from None
    log, poses, result = part.shown, part.motions.best.poses, metrics.figures(part.motions)
    coupling = cross_coupling(bag, part.log, memory)
    parts = stretches.of_run(past, part.log)
    laws = stretches.laws(parts)
    if len(laws) > 1:  # it is no run of its first law
        name = ', then '.join(map(law_label, laws))
        log = log._replace(law=', then '.join(laws))
    ended = early(result.window.run_s, float(part.log.config['duration']))
    told = [*filter(None, [ended]), *unsettled(result), *part.remarks, *stretches.told(parts)]
    marks = tuple(one.begin for one in parts[1:])
    return Run(
        bag, name, style, log, poses, result, coupling, timed, part.cut, told, faulted, marks
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


def cross_coupling(bag: Path, log: run_log.RunLog, memory: int = MEMORY) -> Series | None:
    """Cross-coupling errors of the bag that `log` was read from; None when it has none."""
    errors = telemetry.read(bag, log, CROSS_COUPLING_ERROR, memory)
    if errors is None:
        return None
    used = physical(errors) & (errors.stamps >= log.start_stamp)
    if not used.any():
        return None
    time = (errors.stamps[used] - log.start_stamp) / NANOSECONDS
    return Series(time, errors.numbers['position'][used])
