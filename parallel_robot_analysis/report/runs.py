"""The runs that a report compares: read, measured, and each with a name and a style."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot_analysis import metrics, timing
from parallel_robot_analysis.report import palette
from parallel_robot_analysis.timing import Timing
from parallel_robot_bags import history, run_log, telemetry
from parallel_robot_bags.limits import MEMORY
from parallel_robot_bags.progress import tracked
from parallel_robot_bags.samples import physical
from parallel_robot_base.errors import BagError, InputError, KinematicsError
from parallel_robot_base.printable import printable
from parallel_robot_base.topics import CROSS_COUPLING_ERROR
from parallel_robot_base.units import NANOSECONDS

NAMES = {'smc': 'SMC', 's_smc': 'S-SMC', 'nftsmc': 'NFTSMC', 's_fotsmc': 'S-FOTSMC'}  # in print
LONGEST = 40  # characters of a name, so that a legend stays one


class Series(NamedTuple):
    """Values over time.

    Attributes:
        time: Since t = 0 [s], shape (N,).
        values: One column a joint, shape (N, n).
    """

    time: np.ndarray
    values: np.ndarray


class Run(NamedTuple):
    """One bag of a report.

    Attributes:
        bag: Where it is.
        label: Its name in legends, different from all others of its scenario.
        style: Key of palette.STYLES.
        log: What was recorded.
        poses: Poses of the platform.
        metrics: Figures of merit.
        cross_coupling: Cross-coupling errors [rad]; None when the bag has none.
        timing: How the run kept its time.
        cut: Why only a part of it was evaluated; empty when all of it was.
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


def read_runs(bags: Sequence[str | Path], memory: int = MEMORY) -> dict[str, list[Run]]:
    """Read bags.

    Args:
        bags: Their directories, or one file of each.
        memory: What may be held of each [bytes].

    Returns:
        Name of a scenario to its runs, in the order of `bags`.

    Raises:
        InputError: more bags than there are styles; one is no bag, or its angles are not those of
            its robot.
    """
    if len(bags) > len(palette.RUNS):
        raise InputError(f'a report takes up to {len(palette.RUNS)} bags, not {len(bags)}')
    logs: dict[str, list[tuple[Path, run_log.RunLog]]] = {}
    for bag in tracked(map(Path, bags), len(bags), 'bags read'):
        log = run_log.read(bag, memory)
        logs.setdefault(printable(log.scenario, LONGEST), []).append((bag, log))
    found = {}
    for scenario, members in logs.items():
        labels = _labels([(bag, printable(log.law, LONGEST)) for bag, log in members])
        slots = palette.slots([printable(log.law) for _, log in members])
        found[scenario] = [
            _measure(bag, label, f'run{slot}', log, memory)
            for (bag, log), label, slot in zip(members, labels, slots, strict=True)
        ]
    return found


def _measure(bag: Path, label: str, style: str, log: run_log.RunLog, memory: int) -> Run:
    timed = timing.evaluate(log, history.read(bag, memory))
    try:
        log, poses, cut = metrics.with_poses(log)
    except KinematicsError as error:
        raise BagError(f'{bag}: {error}') from None
    result = metrics.evaluate(log, poses)
    coupling = cross_coupling(bag, log, memory)
    return Run(bag, label, style, log, poses, result, coupling, timed, cut)


def _labels(members: list[tuple[Path, str]]) -> list[str]:
    """Law, then the bag where two have the same law, then a number where that is not enough."""
    names = [NAMES.get(law, law) for _, law in members]
    labels = [
        name if names.count(name) == 1 else f'{name} ({printable(bag.name, LONGEST)})'
        for name, (bag, _) in zip(names, members, strict=True)
    ]
    seen: Counter[str] = Counter()
    numbered = []
    for label in labels:
        seen[label] += 1
        numbered.append(label if labels.count(label) == 1 else f'{label} #{seen[label]}')
    return numbered


def cross_coupling(bag: Path, log: run_log.RunLog, memory: int = MEMORY) -> Series | None:
    """Cross-coupling errors of a bag that `log` was read from; None when it has none for it."""
    errors = telemetry.read(bag, log, CROSS_COUPLING_ERROR, memory)
    if errors is None:
        return None
    used = physical(errors) & (errors.stamps >= log.start_stamp)
    if not used.any():
        return None
    time = (errors.stamps[used] - log.start_stamp) / NANOSECONDS
    return Series(time, errors.numbers['position'][used])
