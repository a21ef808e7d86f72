"""The true error of a simulated run, which its sensors may hide: from the pose of the plant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot_bags import bag_reader, run_log
from parallel_robot_bags.limits import MEMORY
from parallel_robot_bags.message_arrays import Samples, decoder
from parallel_robot_bags.run_log import RunLog
from parallel_robot_base import topics
from parallel_robot_base.errors import BagError
from parallel_robot_sim.imperfections import told_age

POSES = (topics.POSE, topics.POSE_REFERENCE)


class TrueError(NamedTuple):
    """Distance of the true end effector from its reference over the second half of a run [m].

    The plant publishes its pose with every tenth sample; these samples count.
    """

    rms_m: float
    max_m: float


def of_poses(pose: np.ndarray, reference: np.ndarray) -> TrueError:
    """Compare poses.

    Args:
        pose: True poses, shape (N, 2 or more).
        reference: Desired poses, same shape.
    """
    missed = (pose - reference)[len(pose) // 2 :, :2]
    distance = np.linalg.norm(missed, axis=1)
    return TrueError(math.sqrt(np.mean(distance**2)), float(distance.max()))


def of_bag(bag: Path, log: RunLog, memory: int = MEMORY) -> TrueError | None:
    """Read it from a bag of the plant.

    Args:
        bag: The bag that `log` was read from.
        log: The run.
        memory: What may be held of the bag [bytes].

    Returns:
        The true error; None where the bag has no poses of this run, as that of a real robot.
    """
    try:
        found = bag_reader.read(bag, POSES, decoder(bag, POSES), memory)
        streams = run_log.streams_of(bag, found.streams, topics.POSE)
        pose, reference = (_xy(streams[topic]) for topic in POSES)
    except (BagError, KeyError):
        return None
    common = sorted(pose.keys() & reference.keys())
    last = log.stamps[-1] + told_age(log.config)
    common = [stamp for stamp in common if log.stamps[0] <= stamp <= last]
    if not common:
        return None
    return of_poses(*(np.array([each[k] for k in common]) for each in (pose, reference)))


def _xy(parts: Sequence[Samples]) -> dict[int, tuple[float, float]]:
    """Positions by stamp [ns]."""
    return {
        stamp: (x, y)
        for part in parts
        for stamp, x, y in zip(
            part.stamps.tolist(),
            part.numbers['x'].tolist(),
            part.numbers['y'].tolist(),
            strict=True,
        )
    }
