"""The figures of merit as people read them: names, units, order."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from parallel_robot_analysis.metrics import Metrics
from parallel_robot_bags.counts import TopicCount


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


def head(scenario: str, law: str, duration: float, planned: float) -> str:
    """What the figures are of, in a line.

    Args:
        scenario: Its name.
        law: Its name.
        duration: Of the motion [s].
        planned: How long it was to be [s]; 0: not known.
    """
    short = f' of {planned:g} s' if duration < planned - 1e-9 else ''
    return f'{scenario}, {law}, {duration:g} s{short}; errors over the second half'


def brief(found: Metrics, messages: Mapping[str, TopicCount]) -> list[str]:
    """The figures and what is missing of the messages, in three lines or four."""
    lines = [
        '  ' + '; '.join(f'{merit.name} {merit.value(found):.3f} {merit.unit}' for merit in merits)
        for merits in (STEADY[:2], STEADY[2:], TORQUE)
    ]
    missing = [f'{name} {count.missing}' for name, count in messages.items() if count.missing]
    return [*lines, f'  messages missing: {", ".join(missing)}'] if missing else lines


def shown(value: float | None) -> str:
    """Four significant digits, zeros too, or a word for what never came."""
    if value is None or math.isinf(value):
        return 'never'
    text = f'{value:#.4g}'.removesuffix('.')
    return f'{float(text):.0f}' if 1e4 <= abs(float(text)) < 1e7 else text
