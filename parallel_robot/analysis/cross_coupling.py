"""The cross-coupling errors of a bag."""

from __future__ import annotations

from parallel_robot.analysis.thinned import Series
from parallel_robot.bags.messages.message_arrays import Samples, physical
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.units import NANOSECONDS


def of(log: RunLog, errors: Samples | None) -> Series | None:
    """Cross-coupling errors of a run from t = 0 on; None when its bag has none."""
    if errors is None:
        return None
    used = physical(errors) & (errors.stamps >= log.start_stamp)
    if not used.any():
        return None
    time = (errors.stamps[used] - log.start_stamp) / NANOSECONDS
    return Series(time, errors.numbers['position'][used])
