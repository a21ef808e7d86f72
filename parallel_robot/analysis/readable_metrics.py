"""The metrics of a run as people read them: names, units, order.

A metric that is not defined for a robot, which is NaN, is left out everywhere.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from parallel_robot.analysis.metrics import BELOW, METRICS, SEEN, TABLE, Metric, Metrics, named
from parallel_robot.bags.run.run_log import TopicCount
from parallel_robot_control.laws import title
from parallel_robot_model.common.tables import Part, Table

OF_LAWS = ('law', 'winner', 'against')  # columns with names of laws


def titled(parts: Iterable[Part]) -> list[Part]:
    """Results for a document: laws have their titles, S-FOTSMC for s_fotsmc."""
    return [
        part
        if isinstance(part, str)
        else part._replace(
            rows=[
                [
                    title(cell) if head in OF_LAWS else cell
                    for head, cell in zip(part.head, row, strict=False)
                ]
                for row in part.rows
            ]
        )
        for part in parts
    ]


NEVER = 'never'  # in place of the time to a state that was not reached
IN_LINE = 3  # metrics at most
TRUE_AND_SEEN_ERRORS = named('xy_rms_m', 'joint_rms_rad', 'seen_xy_rms_m', 'seen_joint_rms_rad')


def defined(metrics: Sequence[Metric], found: Metrics) -> list[Metric]:
    """Those of some metrics that are defined for the robot of a run."""
    return [metric for metric in metrics if not math.isnan(metric.of(found))]


def told(metric: Metric, found: Metrics, form: Callable[[float], str]) -> str:
    """Name, value and unit of a metric in a run."""
    here, value = metric.in_units(found.units), metric.printed(found)
    return f'{here.name} {NEVER if math.isinf(value) else form(value)} {here.unit}'


def table(rows: Sequence[tuple[str, str, str]]) -> Table:
    """Name, value and unit of some metrics as a table."""
    return Table(['metric', 'value', 'unit'], rows, 'lrl', bare=True)


def whole(found: Metrics) -> Table:
    """The metrics of a run as a table, with three decimals."""
    metrics = defined([metric for metric in METRICS if metric.group != 'transient'], found)
    return table(
        [
            (here.name, f'{here.printed(found):.3f}', here.unit)
            for here in (metric.in_units(found.units) for metric in metrics)
        ]
    )


def as_data(found: Metrics) -> dict[str, dict[str, Any]]:
    """The metrics by group and key, for JSON, in SI units; None for a state never reached.

    Those of what is seen stand under ``seen``, where they are others or all that is known.
    """
    of_motion = [metric for metric in TABLE if metric.of_motion]
    of_seen_alone = of_motion if found.source == SEEN else ()
    data = _groups(found, [metric for metric in TABLE if metric not in of_seen_alone])
    start, stop, run = found.window[:3]
    data['window'] = {'start_s': start, 'stop_s': stop, 'run_s': run}
    if found.seen is not None:
        data['seen'] = _groups(found.seen, of_motion)
    return data


def _groups(found: Metrics, metrics: Sequence[Metric]) -> dict[str, dict[str, Any]]:
    groups: dict[str, dict[str, Any]] = {metric.group: {} for metric in metrics}
    for metric in metrics:
        value = found.values[metric.key]
        if value is None or not math.isnan(value):
            key = metric.key.removeprefix(f'{metric.group}_')
            groups[metric.group][found.units.key(key)] = value
    return groups


def head(scenario: str, law: str, found: Metrics, planned: float) -> str:
    """What the metrics were computed from, in lines.

    Args:
        scenario: Name of the scenario.
        law: Name of the law.
        found: The metrics.
        planned: How long the run was to be [s]; 0 if not known.
    """
    length = early(found.window.run_s, planned) or f'{found.window.run_s:g} s'
    lines = [f'{scenario}, {law}, {length}; errors over {window(found)}', *unsettled(found)]
    return '\n'.join(lines)


def early(run: float, planned: float) -> str:
    """That a run ended before its time [s], if it did; 0 as `planned` if that is not known."""
    return f'ended early, after {run:g} s of {planned:g} s' if run < planned - 1e-9 else ''


def window(found: Metrics) -> str:
    """Over which part of a run its errors, chattering and effort are taken, in words."""
    part = found.window
    times = f'{part.start_s:.6g} to {part.stop_s:.6g} s'
    if part.requested:
        return f'{times}, and all other figures, too'
    if part.rests:
        return f'the second half of its motion, {times}; else it is at rest'
    return f'the second half, {times}'


def unsettled(found: Metrics) -> list[str]:
    """A line that says that a robot has not settled, or that nobody can say, if so."""
    if found.window.unsettled is None:
        if found.window.requested or found.duration_s >= BELOW - 1e-9:
            return []
        what = 'too short to say whether it has settled'
        return [f'{what}: {found.duration_s:g} s, of {BELOW:g} s at least']
    before, after = (shown(1e6 * error) for error in found.window.unsettled)
    fall = f'from {before} to {after} {found.units.of("µrad")} rms'
    return [f'not settled: in that time the joint error falls {fall}']


def brief(found: Metrics, messages: Mapping[str, TopicCount]) -> list[str]:
    """The metrics and the messages that are missing, in a few lines."""
    lines = []
    for (group, _), metrics in itertools.groupby(METRICS, lambda one: (one.group, one.seen)):
        of_group = [*metrics] if group != 'transient' else []
        for k in range(0, len(of_group), IN_LINE):
            texts = [
                told(one, found, '{:.3f}'.format)
                for one in defined(of_group[k : k + IN_LINE], found)
            ]
            lines += ['  ' + '; '.join(texts)] if texts else []
    missing = [f'{name} {count.missing}' for name, count in messages.items() if count.missing]
    return [*lines, f'  messages missing: {", ".join(missing)}'] if missing else lines


def shown(value: float) -> str:
    """Four significant digits, also of zero; 'never' for a state that was not reached."""
    if math.isinf(value):
        return NEVER
    text = f'{value:#.4g}'.removesuffix('.')
    return f'{float(text):.0f}' if 1e4 <= abs(float(text)) < 1e7 else text
