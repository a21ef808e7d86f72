"""The figures of merit as people read them: names, units, order."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from parallel_robot_analysis.metrics import Metrics


class Merit(NamedTuple):
    """One figure of merit; smaller is better.

    Attributes:
        name: In full.
        short: Heading of a narrow column.
        unit: As it is printed.
        value: In that unit; None for what never came.
    """

    name: str
    short: str
    unit: str
    value: Callable[[Metrics], float | None]


TRANSIENT = (
    Merit('time to 1 mm', 'to 1 mm', 's', lambda m: m.transient.to_1_mm_s),
    Merit('time to 0.1 mm', 'to 0.1 mm', 's', lambda m: m.transient.to_0_1_mm_s),
)
STEADY = (
    Merit('platform error, rms', 'rms', 'um', lambda m: 1e6 * m.steady.xy_rms_m),
    Merit('platform error, max', 'max', 'um', lambda m: 1e6 * m.steady.xy_max_m),
    Merit('joint error, rms', 'joint rms', 'urad', lambda m: 1e6 * m.steady.joint_rms_rad),
    Merit('synchronisation error, rms', 'sync rms', 'urad', lambda m: 1e6 * m.steady.sync_rms_rad),
)
TORQUE = (
    Merit('torque, max (whole run)', 'torque', 'N m', lambda m: m.torque.max_nm),
    Merit(
        'torque, total variation',
        'variation',
        'N m/s',
        lambda m: m.torque.total_variation_nm_per_s,
    ),
    Merit('torque, chattering', 'chatter', 'N m', lambda m: m.torque.chattering_nm),
)
MERITS = (*TRANSIENT, *STEADY, *TORQUE)


def shown(value: float | None) -> str:
    """Four significant digits, or a word for what never came."""
    if value is None or math.isinf(value):
        return 'never'
    return f'{value:.0f}' if 1e4 <= abs(value) < 1e7 else f'{value:.4g}'
