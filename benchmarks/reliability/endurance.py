"""Whether a long run was as it should be: pure functions of memory and bag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot.analysis.metrics import distances
from parallel_robot.analysis.recorded_motions import poses_of_log
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.messages import topics

START = 60.0  # s, after which memory must not grow
WINDOW = 30.0  # s, whose median counts at the start and at the end
CLOCKED = tuple(
    topic.name
    for topic in (topics.JOINT_STATES, topics.REFERENCE, topics.POSE, topics.POSE_REFERENCE)
)  # published by the clock, whatever the controller does
GROWTH = 2**20  # bytes, allowed
RATE = 1e-3  # share by which the rate may differ: the last message may be late


class Memory(NamedTuple):
    """Resident memory of a node [B]: after the first minute, at the end, and how much it grew."""

    first: float
    last: float

    @property
    def growth(self) -> float:
        """Difference [B]."""
        return self.last - self.first


class Soak(NamedTuple):
    """A long run."""

    duration: float  # of the motion [s]
    memory: dict[str, Memory]  # by node
    states: int  # states in the bag
    expected: int  # states that the motion has
    rate: float  # states per second of the clock by which they were recorded [1/s]
    nominal: float  # what it should be [1/s]
    answered: int  # commands in the bag; a state that was overtaken by the next has none
    missing: int  # messages missing in the bag, of the topics in CLOCKED
    lost: int  # messages of these that the recorder knows to be lost
    rms: float  # platform error over the second half, root mean square [m]
    failures: tuple[str, ...]  # what must not happen, and did


def growth(samples: Sequence[tuple[float, float]]) -> Memory:
    """Memory of a node from (time [s], memory [B]): medians, not momentary peaks."""
    time, size = np.array(samples).T
    start = min(START, 0.5 * time[-1])
    first = size[(time >= start) & (time <= start + WINDOW)]
    last = size[time >= time[-1] - WINDOW]
    return Memory(float(np.median(first)), float(np.median(last)))


def judge(
    duration: float,
    memory: Mapping[str, Sequence[tuple[float, float]]],
    log: RunLog,
    lost: Mapping[str, int],
    recorded: float,
    code: int,
) -> Soak:
    """Judge a run.

    Args:
        duration: Of the motion [s].
        memory: (time since the start [s], resident memory [B]), by node.
        log: Its bag.
        lost: Messages known to be lost, by topic.
        recorded: Time from the first to the last reception of a message [s].
        code: Exit code of the run.
    """
    grown = {name: growth(samples) for name, samples in memory.items()}
    nominal = 1.0 / float(log.config['period'])
    expected = round(duration * nominal) + 1
    rate = (len(log.time) - 1) / recorded
    missing = sum(log.messages[name].missing for name in CLOCKED)
    gone = sum(lost.get(name, 0) for name in CLOCKED)
    failures = [] if code == 0 else [f'the run ended with exit code {code}']
    failures += [
        f'{name} grew by {found.growth / 2**20:.2f} MB'
        for name, found in grown.items()
        if found.growth >= GROWTH
    ]
    if len(log.time) != expected:
        failures.append(f'{len(log.time)} states instead of {expected}')
    if abs(rate / nominal - 1.0) > RATE:
        failures.append(f'{rate:.2f} states per second instead of {nominal:g}')
    if missing or gone:
        failures.append(f'{missing} messages missing, {gone} known to be lost')
    error = distances(poses_of_log(log))[len(log.time) // 2 :]
    rms = float(np.sqrt(np.mean(error**2)))
    return Soak(
        duration,
        grown,
        len(log.time),
        expected,
        rate,
        nominal,
        len(log.command),
        missing,
        gone,
        rms,
        tuple(failures),
    )
