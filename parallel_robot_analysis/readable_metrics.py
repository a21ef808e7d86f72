"""The metrics of a run as people read them: names, units, order.

A metric that is not defined for a robot, which is NaN, is left out everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from parallel_robot_analysis.metrics import SEEN, Metrics, of_seen, of_true
from parallel_robot_bags.counts import TopicCount


class Metric(NamedTuple):
    """One metric; smaller is better.

    Attributes:
        name: Full name.
        short: Heading of a narrow column.
        unit: Unit as it is printed.
        value: Function that gives the value in that unit; None for a state never reached, NaN
            where the metric is not defined.
    """

    name: str
    short: str
    unit: str
    value: Callable[[Metrics], float | None]


TRANSIENT = (
    Metric('time to 1 mm', 'to 1 mm', 's', of_true(lambda m: m.transient.to_1_mm_s)),
    Metric('time to 0.1 mm', 'to 0.1 mm', 's', of_true(lambda m: m.transient.to_0_1_mm_s)),
)
STEADY = (
    Metric('end-effector error, rms', 'rms', 'µm', of_true(lambda m: 1e6 * m.steady.xy_rms_m)),
    Metric('end-effector error, max', 'max', 'µm', of_true(lambda m: 1e6 * m.steady.xy_max_m)),
    Metric(
        'joint error, rms', 'joint rms', 'µrad', of_true(lambda m: 1e6 * m.steady.joint_rms_rad)
    ),
    Metric(
        'synchronisation error, rms',
        'sync rms',
        'µrad',
        of_true(lambda m: 1e6 * m.steady.sync_rms_rad),
    ),
)
TORQUE = (
    Metric('torque, max (whole run)', 'torque', 'N m', lambda m: m.torque.max_nm),
    Metric(
        'torque, total variation',
        'variation',
        'N m/s',
        lambda m: m.torque.total_variation_nm_per_s,
    ),
    Metric('torque, chattering', 'chatter', 'N m', lambda m: m.torque.chattering_nm),
)
EFFORT = (
    Metric('torque, rms', 'torque rms', 'N m', lambda m: m.effort.torque_rms_nm),
    Metric('energy', 'energy', 'J', of_true(lambda m: m.effort.energy_j)),
    Metric('excess chattering', 'excess', 'N m', lambda m: m.effort.excess_chattering_nm),
)
AS_SEEN = (
    Metric('seen time to 1 mm', 'seen 1 mm', 's', of_seen(lambda m: m.transient.to_1_mm_s)),
    Metric('seen time to 0.1 mm', 'seen 0.1', 's', of_seen(lambda m: m.transient.to_0_1_mm_s)),
    Metric(
        'seen end-effector error, rms',
        'seen rms',
        'µm',
        of_seen(lambda m: 1e6 * m.steady.xy_rms_m),
    ),
    Metric(
        'seen end-effector error, max',
        'seen max',
        'µm',
        of_seen(lambda m: 1e6 * m.steady.xy_max_m),
    ),
    Metric(
        'seen joint error, rms',
        'seen joint',
        'µrad',
        of_seen(lambda m: 1e6 * m.steady.joint_rms_rad),
    ),
    Metric(
        'seen synchronisation error, rms',
        'seen sync',
        'µrad',
        of_seen(lambda m: 1e6 * m.steady.sync_rms_rad),
    ),
    Metric('seen energy', 'seen J', 'J', of_seen(lambda m: m.effort.energy_j)),
)
NEVER = 'never'  # in place of the time to a state that was not reached
METRICS = (*TRANSIENT, *STEADY, *TORQUE, *EFFORT, *AS_SEEN)


def defined(metrics: Sequence[Metric], found: Metrics) -> list[Metric]:
    """Those of some metrics that are defined for the robot of a run."""
    values = [metric.value(found) for metric in metrics]
    return [
        metric
        for metric, value in zip(metrics, values, strict=True)
        if value is None or not math.isnan(value)
    ]


def as_data(found: Metrics) -> dict[str, dict[str, Any]]:
    """The metrics by group and key, for JSON, in SI units; None for a state never reached.

    Those of what is seen stand under ``seen``, where they are others or all that is known.
    """
    data = {} if found.source == SEEN else _groups(found, ('transient', 'steady'))
    data |= _groups(found, ('torque', 'effort'))
    if found.source == SEEN:
        data['effort'].pop('energy_j', None)
    if found.seen is not None:
        seen = _groups(found.seen, ('transient', 'steady'))
        energy = {'energy_j': found.seen.effort.energy_j}
        data['seen'] = {**seen, 'effort': energy}
    return data


def _groups(found: Metrics, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    return {
        name: {
            key: value
            for key, value in getattr(found, name)._asdict().items()
            if value is None or not math.isnan(value)
        }
        for name in names
    }


def head(scenario: str, law: str, duration: float, planned: float) -> str:
    """What the metrics were computed from, in a line.

    Args:
        scenario: Name of the scenario.
        law: Name of the law.
        duration: Duration of the motion [s].
        planned: How long it was to be [s]; 0 if not known.
    """
    short = f' of {planned:g} s' if duration < planned - 1e-9 else ''
    return f'{scenario}, {law}, {duration:g} s{short}; errors over the second half'


def brief(found: Metrics, messages: Mapping[str, TopicCount]) -> list[str]:
    """The metrics and the messages that are missing, in a few lines."""
    rows = (STEADY[:2], STEADY[2:], TORQUE, EFFORT, AS_SEEN[2:4], AS_SEEN[4:6], AS_SEEN[6:])
    groups = (defined(metrics, found) for metrics in rows)
    lines = [
        '  ' + '; '.join(f'{one.name} {one.value(found):.3f} {one.unit}' for one in metrics)
        for metrics in groups
        if metrics
    ]
    missing = [f'{name} {count.missing}' for name, count in messages.items() if count.missing]
    return [*lines, f'  messages missing: {", ".join(missing)}'] if missing else lines


def shown(value: float | None) -> str:
    """Four significant digits, also of zero; 'never' for a state that was not reached."""
    if value is None or math.isinf(value):
        return NEVER
    text = f'{value:#.4g}'.removesuffix('.')
    return f'{float(text):.0f}' if 1e4 <= abs(float(text)) < 1e7 else text
