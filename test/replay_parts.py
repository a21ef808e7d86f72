"""A run that is replayed in parts, beside the same at once."""

import numpy as np

from parallel_robot.analysis.replay import replayed
from parallel_robot.bags.run import run_log


def in_parts(log, past, configuration, width, obeyed=True):
    """The torques of a run that is read in parts of so many states."""
    parts, found = replayed.InParts(past, configuration, obeyed), []
    for first in range(0, len(log.time), width):
        rows = np.arange(first, min(first + width, len(log.time)))
        found.append(parts.answered(run_log.rows(log, rows), rows[-1] == len(log.time) - 1))
    stamps = np.concatenate([part.stamps for part, _ in found])
    assert np.array_equal(stamps, log.stamps)
    torque, recorded = (
        np.concatenate([getattr(each, name) for _, each in found])
        for name in ('torque', 'recorded')
    )
    late = sum(each.late for _, each in found)
    return replayed.Replay(torque, recorded, late, found[-1][1].remembered)


def assert_same_in_parts(whole, log, past, configuration, obeyed=True):
    """The torques of parts, whatever they are, are those of the run to the last bit."""
    for width in (23, 61):
        found = in_parts(log, past, configuration, width, obeyed)
        assert found.torque.tobytes() == whole.torque.tobytes()
        assert found.recorded.tobytes() == whole.recorded.tobytes()
        assert (found.late, found.remembered) == (whole.late, whole.remembered)
