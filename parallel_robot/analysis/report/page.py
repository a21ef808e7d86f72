"""The report as one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from parallel_robot.analysis import claims
from parallel_robot.analysis.readable_metrics import METRICS, defined, shown, window
from parallel_robot.analysis.report.animation import animation
from parallel_robot.analysis.report.charts import Chart, place_of
from parallel_robot.analysis.report.looks import AUTO, STYLES, law_label
from parallel_robot.analysis.report.plots import plot
from parallel_robot.analysis.report.runs import Run
from parallel_robot.analysis.thinned import INTERVALS
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.units import all_of


def render(
    groups: Mapping[str, Sequence[Run]],
    charts: Mapping[str, Sequence[Chart]],
    scale: str = AUTO,
) -> str:
    """Write the page.

    Args:
        groups: Name of a group to its runs, see :func:`runs.read_runs`.
        charts: Name of a group to its charts.
        scale: Of errors at first, see scale.SCALES.

    Returns:
        HTML with scripts, styles and data inside; it loads nothing from the network.
    """
    from jinja2 import Environment, PackageLoader  # slow to import: only for a page
    from plotly.offline import get_plotlyjs

    environment = Environment(
        loader=PackageLoader('parallel_robot.analysis.report'),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters['shown'] = _cell
    environment.filters['printable'] = printable
    environment.filters['window'] = window
    environment.filters['law_label'] = law_label
    runs = [run for members in groups.values() for run in members]
    return environment.get_template('report.html').render(
        plotly=get_plotlyjs(),
        styles=STYLES,
        intervals=INTERVALS,
        groups=[_section(name, members, charts[name], scale) for name, members in groups.items()],
        runs=runs,
        gains=[_gains(run) for run in runs],
        differences=differences(runs),
        parameters=_parameters(runs),
        timing=_rows([_timing(run) for run in runs]),
        topics=sorted({topic for run in runs for topic in run.log.messages}),
        several=len(groups) > 1,
    )


def differences(runs: Sequence[Run]) -> dict[str, list[str]]:
    """Keys of the configuration whose values are not the same in all runs, with the values."""
    values: dict[str, list[Any]] = {}
    for run in runs:
        for key, value in run.log.config.items():
            values.setdefault(printable(key), []).append(_meant(value))
    rows = _parameters(runs)
    return {
        key: row
        for key, row in rows.items()
        if len(values[key]) < len(runs) or any(one != values[key][0] for one in values[key])
    }


def _meant(value: Any) -> Any:
    """A value of the configuration whatever its spelling: one number counts for all joints."""
    if isinstance(value, (list, tuple)):
        members = [_meant(one) for one in value]
        alike = all(isinstance(one, float) and one == members[0] for one in members)
        return members[0] if members and alike else members
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if number else value


def _section(
    name: str, runs: Sequence[Run], charts: Sequence[Chart], scale: str
) -> dict[str, Any]:
    good = [run for run in runs if not run.faulted]
    first = {run.log.law: run.metrics for run in reversed(good)}
    parts = {tuple(round(time, 2) for time in run.metrics.window[:2]) for run in good}
    units = all_of(run.metrics.units for run in runs)
    alike = len(parts) == 1  # else no figure is better than another
    data: dict[str, Any] = {'plots': [plot(chart, scale) for chart in charts]}
    if place_of(runs):
        data['animation'] = animation(runs)
    return {
        'name': name,
        'robot': printable(runs[0].log.config['robot_model']),
        'runs': runs,
        'metrics': [
            (
                metric.told(units),
                _best([metric.value(run.metrics) for run in good]) if alike else '',
            )
            for metric in METRICS
            if any(defined([metric], run.metrics) for run in runs)
        ],
        'alike': alike,
        'verdicts': claims.verify(name, first) if alike else [],
        'repeated': len(first) < len(good),
        'charts': charts,
        'data': data,
    }


def _timing(run: Run) -> dict[str, str]:
    """How a run kept its time, row by row; empty where the bag does not say."""
    timing = run.timing
    lags = timing.lag_percentiles() if timing.lag.size else ()
    return {
        'real time': {True: 'held', False: 'not held', None: ''}[timing.realtime],
        'states answered': '' if timing.answered is None else str(timing.answered),
        'states skipped': '' if timing.skipped is None else str(timing.skipped),
        **{
            f'lag of the torque, {name} [ms]': shown(1e3 * lag * timing.period)
            for name, lag in zip(('p50', 'p99', 'max'), lags, strict=False)
        },
        'steps whose torque answers no state': str(timing.uncommanded),
        **{f'priority of {printable(k)}': printable(v) for k, v in timing.priority.items()},
    }


def _best(values: Sequence[float | None]) -> str:
    """The smallest of several values as it is shown; empty if all are alike, or only one."""
    known = [value for value in values if value is not None and not math.isnan(value)]
    texts = {shown(value) for value in values if value is None or not math.isnan(value)}
    return shown(min(known)) if known and len(texts) > 1 else ''


def _cell(value: float | None) -> str:
    """A metric as it is shown; empty where it is not known."""
    return '' if value is not None and math.isnan(value) else shown(value)


def _gains(run: Run) -> dict[str, str]:
    start = f'{printable(run.log.law)}.'
    return {
        printable(key).removeprefix(start): printable(value)
        for key, value in run.log.config.items()
        if printable(key).startswith(start)
    }


def _parameters(runs: Sequence[Run]) -> dict[str, list[str]]:
    """Every key of the configuration with its value in each run."""
    tables = [
        {printable(key): printable(value) for key, value in run.log.config.items()} for run in runs
    ]
    return dict(sorted(_rows(tables).items()))


def _rows(tables: Sequence[Mapping[str, str]]) -> dict[str, list[str]]:
    """Every key of several tables with its value in each; empty where a table has none."""
    keys = dict.fromkeys(key for table in tables for key in table)
    return {key: [table.get(key, '') for table in tables] for key in keys}
