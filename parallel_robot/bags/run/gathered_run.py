"""The end of a run, and how many states it has, read in windows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recording, run_log
from parallel_robot.bags.run.alike_lines import AlikeLines
from parallel_robot.bags.run.recorded_robot import SECONDS
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import EMPTY, RunLog
from parallel_robot_model.common.errors import WholeNeededError


def ends(bag: Path, memory: int = MEMORY) -> tuple[RunLog, History, int]:
    """The last state of a run, what happened beside it, and how many states it has.

    Args:
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of a window [bytes].

    Returns:
        The log has the last state of each window.

    Raises:
        BagError: not a bag, or one that is not of a run or takes too much.
    """
    count = 0

    def last(windows: Iterator[Recording]) -> Iterator[Recording]:
        nonlocal count
        for window in windows:
            states = len(window.log.stamps)
            count += states
            yield window._replace(log=run_log.rows(window.log, np.arange(states - 1, states)))

    try:
        found = _of(bag, last(recording.chunks(bag, SECONDS, (), memory)))
    except WholeNeededError:
        count = 0
        found = _of(bag, last(iter([recording.read(bag, (), memory)])))
    return found.log, found.history, count


def _of(bag: Path, windows: Iterator[Recording]) -> Recording:
    """The run of some windows that follow each other: stamps and times of their states.

    Raises:
        WholeNeededError: they do not hold the same, or there is none.
    """
    parts: dict[str, list[np.ndarray]] = {name: [] for name in ('stamps', 'time')}
    told = AlikeLines()
    first: Recording | None = None
    kind = None
    for window in windows:
        first = first or window._replace(log=run_log.head(window.log, 0))
        kind = kind or window.log.kind
        if window.log.kind != kind:
            raise WholeNeededError('the parts of the bag do not hold the same')
        told.take(bag, window.log)
        for name, found in parts.items():
            found.append(getattr(window.log, name))
    if first is None:
        raise WholeNeededError('no window has a state')
    whole: dict[str, Any] = {
        name: EMPTY for name, value in first.log._asdict().items() if isinstance(value, np.ndarray)
    }
    whole |= {name: np.concatenate(parts.pop(name)) for name in [*parts]}
    log = first.log._replace(**whole, warnings=told.lines, answers=None, used=None)
    return Recording(log, first.history, {})
