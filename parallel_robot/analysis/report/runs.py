"""The runs that a report compares: read, evaluated, and each with a name and a style."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis import evaluated_bag, metrics, pictures
from parallel_robot.analysis.evaluated_bag import EvaluatedBag
from parallel_robot.analysis.readable_metrics import early, unsettled
from parallel_robot.analysis.report.looks import label, law_label
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.analysis.thinned import Series, Track
from parallel_robot.analysis.timing import Timing
from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.output import tracked
from parallel_robot.bags.run import run_log, run_windows
from parallel_robot.bags.run.recorded_robot import NONE, RobotCode
from parallel_robot_control import law_loader
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR
from parallel_robot_sim.motions import Motion


class Run(NamedTuple):
    """One bag of a report."""

    bag: Path  # path of the bag
    label: str  # its name in legends, different from all others of its group
    style: str  # key of pictures.STYLES
    log: run_log.RunLog  # the recorded run; of a long one, states of a part alone
    # its true motion where that is known, else the one that was seen; of a long run, the
    # samples that can be seen in a picture
    motion: Motion
    path: Track  # its path; of a long one, parts of it with gaps
    # its samples at times, or the first ones after them, all in rising order
    at: Callable[[np.ndarray], Motion]
    samples: int  # how many samples it has
    metrics: metrics.Metrics  # metrics of the run
    cross_coupling: Series | None  # cross-coupling errors [rad]; None when the bag has none
    timing: Timing  # how the run kept its time
    cut: str  # why only a part of it was evaluated; empty when all of it was
    doubts: list[str]  # what else to know of its figures, e.g. that they are not the true ones
    faulted: bool  # whether the controller was in a fault: its metrics are not those of the law
    marks: tuple[float, ...] = ()  # times at which law or gains changed [s]


def read_runs(
    bags: Sequence[str | Path],
    code: RobotCode = NONE,
    view: BagView = AS_RECORDED,
) -> dict[str, list[Run]]:
    """Read bags.

    Args:
        bags: Directories of the bags, or one file of each.
        code: What may run to know their robots.
        view: What bags do not say themselves, and which part is wanted.

    Returns:
        Scenario to its runs, in the order of `bags`; runs of one scenario with several robots
        are a group for each, named after both.

    Raises:
        InputError: more bags than there are styles; one is no bag, or its joints are not those of
            its robot.
    """
    if len(bags) > len(pictures.RUNS):
        raise InputError(f'a report takes up to {len(pictures.RUNS)} bags, not {len(bags)}')
    evaluated: dict[tuple[str, str], list[tuple[Path, EvaluatedBag]]] = {}
    for bag in tracked(map(Path, bags), len(bags), 'bags read'):
        found = evaluated_bag.evaluate(
            bag, code, view, topics=(CROSS_COUPLING_ERROR,), motion_only=False
        )
        assert not isinstance(found, MotionAlone)
        law_loader.learn_titles(found.past.sources['custom_laws'])
        # the same robot and number of joints for all runs that are drawn together
        robot = f'{label(str(found.log.config["robot_model"]))}, {len(found.log.joints)} joints'
        group = label(found.log.scenario), robot
        evaluated.setdefault(group, []).append((bag, found))
    scenarios = [scenario for scenario, _ in evaluated]
    groups = {}
    for (scenario, robot), members in evaluated.items():
        title = scenario if scenarios.count(scenario) == 1 else f'{scenario} ({robot})'
        names = _labels([(bag, law_label(found.log.law)) for bag, found in members])
        slots = pictures.slots([printable(found.log.law) for _, found in members])
        groups[title] = [
            _run(bag, name, f'run{slot}', found)
            for (bag, found), name, slot in zip(members, names, slots, strict=True)
        ]
    return groups


def _run(bag: Path, name: str, style: str, found: EvaluatedBag) -> Run:
    log, result, parts = found.log, found.metrics, found.parts
    laws = run_windows.laws_of(parts)
    if len(laws) > 1:  # it is no run of its first law
        name = ', then '.join(map(law_label, laws))
        log = log._replace(law=', then '.join(laws))
    ended = early(result.window.run_s, float(log.config['duration']))
    return Run(
        bag,
        name,
        style,
        log,
        found.motion,
        found.path,
        found.at,
        found.samples,
        result,
        found.cross_coupling,
        found.timing,
        found.cut,
        [
            *filter(None, [ended]),
            *unsettled(result),
            *found.remarks,
            *run_windows.stretches_told(parts),
        ],
        any(status.fault != NO_FAULT for status in found.past.statuses),
        tuple(one.begin for one in parts[1:]),
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
