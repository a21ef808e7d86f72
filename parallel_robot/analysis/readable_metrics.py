"""The metrics of a run as people read them: names, units, order.

A metric that is not defined for a robot, which is NaN, is left out everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from parallel_robot.analysis.metrics import BELOW, SEEN, Metrics, Value, of_seen, of_true
from parallel_robot.bags.run.run_log import TopicCount
from parallel_robot_control.laws import title
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import JointUnits

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


class Metric(NamedTuple):
    """One metric; smaller is better.

    Its names and unit are those of hinges: ``metric.told(found.units)`` has those of a run's.
    """

    name: str  # full name
    short: str  # heading of a narrow column
    unit: str  # unit as it is printed
    # function that gives the value in that unit; None for a state never reached, NaN where
    # the metric is not defined
    value: Callable[[Metrics], float | None]

    def told(self, units: JointUnits) -> Metric:
        """The same of joints of some units; a rotation is an angle with all of them."""
        unit = self.unit if ROTATION in self.name else units.of(self.unit)
        return Metric(units.label(self.name), units.label(self.short), unit, self.value)

    def line(self, found: Metrics, form: Callable[[float], str]) -> str:
        """Its name, value and unit in a run."""
        told, value = self.told(found.units), self.value(found)
        return f'{told.name} {NEVER if value is None else form(value)} {told.unit}'


ROTATION = 'end-effector rotation error'
OF_MOTION: tuple[tuple[str, str, str, str, Value], ...] = (  # both names, the short one as seen
    ('time to 1 mm', 'to 1 mm', 'seen 1 mm', 's', lambda m: m.transient.to_1_mm_s),
    ('time to 0.1 mm', 'to 0.1 mm', 'seen 0.1', 's', lambda m: m.transient.to_0_1_mm_s),
    ('end-effector error, rms', 'rms', 'seen rms', 'µm', lambda m: 1e6 * m.steady.xy_rms_m),
    ('end-effector error, max', 'max', 'seen max', 'µm', lambda m: 1e6 * m.steady.xy_max_m),
    (
        f'{ROTATION}, rms',
        'rot rms',
        'seen rot',
        'µrad',
        lambda m: 1e6 * m.steady.rotation_rms_rad,
    ),
    (
        'joint error, rms',
        'joint rms',
        'seen joint',
        'µrad',
        lambda m: 1e6 * m.steady.joint_rms_rad,
    ),
    (
        'synchronisation error, rms',
        'sync rms',
        'seen sync',
        'µrad',
        lambda m: 1e6 * m.steady.sync_rms_rad,
    ),
    ('energy', 'energy', 'seen J', 'J', lambda m: m.effort.energy_j),
)
_TRUE = tuple(
    Metric(name, short, unit, of_true(value)) for name, short, _, unit, value in OF_MOTION
)
TRANSIENT, STEADY, ENERGY = _TRUE[:2], _TRUE[2:7], _TRUE[7]
AS_SEEN = tuple(
    Metric(f'seen {name}', short, unit, of_seen(value))
    for name, _, short, unit, value in OF_MOTION
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
    ENERGY,
    Metric('excess chattering', 'excess', 'N m', lambda m: m.effort.excess_chattering_nm),
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


def table(rows: Sequence[tuple[str, str, str]]) -> Table:
    """Name, value and unit of some metrics as a table."""
    return Table(['metric', 'value', 'unit'], rows, 'lrl', bare=True)


def whole(found: Metrics) -> Table:
    """The metrics of a run as a table, with three decimals."""
    metrics = defined((*STEADY, *TORQUE, *EFFORT, *AS_SEEN[2:]), found)
    return table(
        [
            (one.name, f'{one.value(found):.3f}', one.unit)
            for one in (metric.told(found.units) for metric in metrics)
        ]
    )


def as_data(found: Metrics) -> dict[str, dict[str, Any]]:
    """The metrics by group and key, for JSON, in SI units; None for a state never reached.

    Those of what is seen stand under ``seen``, where they are others or all that is known.
    """
    data = {} if found.source == SEEN else _groups(found, ('transient', 'steady'))
    data |= _groups(found, ('torque', 'effort'))
    if found.source == SEEN:
        data['effort'].pop('energy_j', None)
    start, stop, run = found.window[:3]
    data['window'] = {'start_s': start, 'stop_s': stop, 'run_s': run}
    if found.seen is not None:
        seen = _groups(found.seen, ('transient', 'steady'))
        energy = {'energy_j': found.seen.effort.energy_j}
        data['seen'] = {**seen, 'effort': energy}
    return data


def _groups(found: Metrics, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    return {
        name: {
            found.units.key(key): value
            for key, value in getattr(found, name)._asdict().items()
            if value is None or not math.isnan(value)
        }
        for name in names
    }


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
    if part.asked:
        return f'{times}, and all other figures, too'
    if part.rests:
        return f'the second half of its motion, {times}; else it is at rest'
    return f'the second half, {times}'


def unsettled(found: Metrics) -> list[str]:
    """A line that says that a robot has not settled, or that nobody can say, if so."""
    if found.window.falls is None:
        if found.window.asked or found.duration_s >= BELOW - 1e-9:
            return []
        what = 'too short to say whether it has settled'
        return [f'{what}: {found.duration_s:g} s, of {BELOW:g} s at least']
    before, after = (shown(1e6 * error) for error in found.window.falls)
    fall = f'from {before} to {after} {found.units.of("µrad")} rms'
    return [f'not settled: in that time the joint error falls {fall}']


def brief(found: Metrics, messages: Mapping[str, TopicCount]) -> list[str]:
    """The metrics and the messages that are missing, in a few lines."""
    rows = (STEADY[:3], STEADY[3:], TORQUE, EFFORT, AS_SEEN[2:5], AS_SEEN[5:7], AS_SEEN[7:])
    groups = (defined(metrics, found) for metrics in rows)
    lines = [
        '  ' + '; '.join(one.line(found, '{:.3f}'.format) for one in metrics)
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
