"""The metrics of a run as people read them: names, units, order.

A metric that is not defined for a robot, which is NaN, is left out everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_analysis.metrics import Metrics
from parallel_robot_analysis.true_motion import TrueError
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
    Metric('time to 1 mm', 'to 1 mm', 's', lambda m: m.transient.to_1_mm_s),
    Metric('time to 0.1 mm', 'to 0.1 mm', 's', lambda m: m.transient.to_0_1_mm_s),
)
STEADY = (
    Metric('end-effector error, rms', 'rms', 'µm', lambda m: 1e6 * m.steady.xy_rms_m),
    Metric('end-effector error, max', 'max', 'µm', lambda m: 1e6 * m.steady.xy_max_m),
    Metric('joint error, rms', 'joint rms', 'µrad', lambda m: 1e6 * m.steady.joint_rms_rad),
    Metric(
        'synchronisation error, rms', 'sync rms', 'µrad', lambda m: 1e6 * m.steady.sync_rms_rad
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
    Metric('energy', 'energy', 'J', lambda m: m.effort.energy_j),
    Metric('excess chattering', 'excess', 'N m', lambda m: m.effort.excess_chattering_nm),
)
NEVER = 'never'  # in place of the time to a state that was not reached
METRICS = (*TRANSIENT, *STEADY, *TORQUE, *EFFORT)

# Parameters by which the joints of a bag are not the true ones, see docs/noise.md.
UNTRUE = ('sensor.position_noise', 'sensor.resolution', 'sensor.delay', 'sensor.jitter')
AS_SENSED = 'the sensors are not ideal ({0}): errors are those that they show; {1}'
TRUE = 'the true end-effector error is {0} µm rms, {1} µm at most'
ELSEWHERE = 'parallel_robot compare and sweep measure the true motion'


def sensor_remarks(values: Mapping[str, Any], truth: Callable[[], TrueError | None]) -> list[str]:
    """A line that says that errors of a run are not the true ones, if they are not.

    Args:
        values: The resolved configuration.
        truth: Returns the true error, if it is known; called where it is printed.
    """
    acting = [key for key in UNTRUE if np.any(np.asarray(values.get(key, 0.0)) != 0.0)]
    if not acting:
        return []
    true = truth()
    known = true and TRUE.format(shown(1e6 * true.rms_m), shown(1e6 * true.max_m))
    return [AS_SENSED.format(', '.join(acting), known or ELSEWHERE)]


def defined(metrics: Sequence[Metric], found: Metrics) -> list[Metric]:
    """Those of some metrics that are defined for the robot of a run."""
    values = [metric.value(found) for metric in metrics]
    return [
        metric
        for metric, value in zip(metrics, values, strict=True)
        if value is None or not math.isnan(value)
    ]


def as_data(found: Metrics) -> dict[str, dict[str, Any]]:
    """The metrics by group and key, for JSON, in SI units; None for a state never reached."""
    groups: dict[str, Any] = found._asdict()
    del groups['duration_s']
    return {
        group: {
            key: value
            for key, value in metrics._asdict().items()
            if value is None or not math.isnan(value)
        }
        for group, metrics in groups.items()
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
    groups = (defined(metrics, found) for metrics in (STEADY[:2], STEADY[2:], TORQUE, EFFORT))
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
