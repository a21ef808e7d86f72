"""A copy of a bag, with all that viewers such as Foxglove need to draw the robot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from parallel_robot.analysis import recorded_motions
from parallel_robot.analysis.frames import Frames
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recorded_robot
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot.bags.writing.recovery import copy
from parallel_robot_model.common.errors import BagError
from parallel_robot_sim.motions import differs


class ViewerCopy(NamedTuple):
    """A copy that was written.

    Attributes:
        path: Its directory.
        frames: Number of frames of the robot.
        seen: Whether they are of the joints as they are seen, not of the true ones.
        warnings: Defects of the bag, one line each.
    """

    path: Path
    frames: int
    seen: bool
    warnings: tuple[str, ...]


def write(
    bag: Path, windows: Callable[[], Iterator[Recording]], out: Path, memory: int = MEMORY
) -> ViewerCopy:
    """Write the copy of a bag.

    Args:
        bag: Directory of the bag, or its MCAP file.
        windows: Returns what it holds, in parts.
        out: Directory of the copy, which must not exist.
        memory: What may be held of the bag [bytes].

    Raises:
        BagError: its robot is not known, or the copy cannot be written.
        WholeNeededError: the bag cannot be read in windows.
    """
    told, count = AlikeLines(), 0
    for log, past, _ in windows():
        told.take(bag, log)
        count += len(log.stamps)
        config, history = log.config, past
    unknown = recorded_robot.unknown(config)
    if unknown:
        raise BagError(f'{bag}: {unknown}')
    seen = not recorded_motions.of_plant(history) or differs(config)
    frames = Frames(lambda: (found.log for found in windows()), count, seen)
    copy(bag, out, memory, frames.write)
    return ViewerCopy(out, frames.count, seen, told.lines)
