"""The report as one self-contained HTML page."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis import claims
from parallel_robot.analysis.metrics import METRICS
from parallel_robot.analysis.pictures import STYLES
from parallel_robot.analysis.readable_metrics import defined, shown, window
from parallel_robot.analysis.report.charts import Chart, Curve, Panel, place_of
from parallel_robot.analysis.report.looks import AUTO, law_label
from parallel_robot.analysis.report.runs import Run
from parallel_robot.analysis.thinned import INTERVALS
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.units import all_of
from parallel_robot_model.robots.registry import robot_of

# Charts as plain data for plotly.js, colours left to the page.

ROW = 170  # px, height of a panel over time
GAP = 44  # px, between two rows
TOP, BOTTOM = 56, 48  # px, for legend and time axis
MARK = {'color': '#888', 'dash': 'dot', 'width': 1}  # of a change
COLUMN_GAP = 0.09  # of the width


def plot(chart: Chart, scale: str) -> dict[str, Any]:
    """Traces and layout of a chart.

    Args:
        chart: The chart.
        scale: Of errors, see looks.SCALES.

    Returns:
        ``data`` and ``layout`` of plotly.js with signed values, and whether they are shown as
        magnitudes on a ``log`` axis at first. The points of a trace are packed, see
        :func:`packed`, and its ``meta`` is the key of the style; the page fills in points and
        colours.
    """
    columns = len(chart.widths)
    rows = -(-len(chart.panels) // columns)
    inner = 460 if chart.equal else rows * ROW + (rows - 1) * GAP
    layout: dict[str, Any] = {
        'height': inner + TOP + BOTTOM,
        'margin': {'t': TOP, 'b': BOTTOM, 'l': 64, 'r': 12},
        'hovermode': 'closest' if chart.equal else 'x unified',
        'legend': {'orientation': 'h', 'y': 1, 'yref': 'container', 'yanchor': 'top', 'x': 0},
        'annotations': [],
        'shapes': [],
        'uirevision': 'keep',  # zoom and hidden curves survive a change of colours
    }
    data: list[dict[str, Any]] = []
    named: set[str] = set()
    widths = np.array(chart.widths) * (1.0 - COLUMN_GAP * (columns - 1)) / sum(chart.widths)
    for index, panel in enumerate(chart.panels):
        row, column = divmod(index, columns)
        left = float(widths[:column].sum() + column * COLUMN_GAP)
        top = 1.0 - row * (ROW + GAP) / inner
        bottom = 0.0 if row == rows - 1 else top - ROW / inner
        number = '' if index == 0 else str(index + 1)
        x = {
            'domain': [left, left + float(widths[column])],
            'anchor': f'y{number}',
            'matches': f'x{column + 1 if column and chart.spans else ""}',
            'showticklabels': row == rows - 1,
            'title': {'text': (panel.x_label or chart.x_label) if row == rows - 1 else ''},
        }
        y = {
            'domain': [bottom, top],
            'anchor': f'x{number}',
            'title': {'text': f'{panel.quantity} [{panel.unit}]'},
        }
        if chart.spans and row:
            y['matches'] = f'y{column + 1 if column else ""}'
        if chart.equal:
            y['scaleanchor'] = f'x{number}'
        if chart.equal or x['matches'] == f'x{number}':
            del x['matches']
        layout[f'xaxis{number}'], layout[f'yaxis{number}'] = x, y
        if panel.title:
            layout['annotations'].append(
                {
                    'text': html.escape(panel.title),
                    'x': left,
                    'y': top,
                    'xref': 'paper',
                    'yref': 'paper',
                    'xanchor': 'left',
                    'yanchor': 'bottom',
                    'showarrow': False,
                }
            )
        layout['shapes'] += [
            {
                'type': 'line',
                'xref': f'x{number}',
                'yref': f'y{number} domain',
                'x0': time,
                'x1': time,
                'y0': 0,
                'y1': 1,
                'line': MARK,
            }
            for time in panel.marks
        ]
        for curve in panel.curves:
            data.append(_trace(curve, number, panel, chart.equal))
            data[-1]['showlegend'] = curve.label not in named
            named.add(curve.label)
    return {'data': data, 'layout': layout, 'log': chart.logarithmic(scale)}


def packed(values: np.ndarray) -> str:
    """Numbers as the page unpacks them: little-endian float32 in base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype='<f4').tobytes()).decode()


def _trace(curve: Curve, axes: str, panel: Panel, plane: bool) -> dict[str, Any]:
    style = STYLES[curve.style]
    dash = ','.join(f'{1.6 * length:g}px' for length in style.dash) if panel.dashed else ''
    return {
        'type': 'scatter',
        'mode': 'markers' if style.marker else 'lines',
        'name': html.escape(curve.label),
        'legendgroup': curve.label,
        'meta': curve.style,
        'x': packed(curve.x),
        'y': packed(curve.y),
        'xaxis': f'x{axes}',
        'yaxis': f'y{axes}',
        'line': {'width': 1.4 * style.width, 'dash': dash or 'solid'},
        'marker': {'size': 7},
        'hovertemplate': f'%{{x:.3f}}, %{{y:.3f}} {panel.unit}'
        if plane
        else f'%{{y:.4g}} {panel.unit}',
    }


# The moving robot as numbers, and as plain data for the page.

RATE = 50.0  # Hz, of the frames
MOST = 1500  # frames of a long run


class Postures(NamedTuple):
    """A robot whose pose is a place, in all runs at common times."""

    place: int  # number of the coordinates of a place: 2 in a plane, 3 in space
    time: np.ndarray  # times of the frames [s], shape (F,)
    parts: list[tuple[str, int]]  # parts of the robot, each name and number of lines
    # for each run the numbers of its frames [m], shape (F, K): the places of the reference,
    # of the end effector, and of both ends of each line, part by part. A run that is shorter
    # stays at its end
    frames: list[np.ndarray]


def postures(runs: Sequence[Run], rate: float = RATE) -> Postures:
    """Postures of all runs of a robot whose pose is a place, at most MOST.

    Args:
        runs: The runs.
        rate: Of the frames [Hz].
    """
    duration = max(float(run.motion.time[-1]) for run in runs)
    count = min(MOST, int(duration * rate) + 1)
    times = np.linspace(0.0, duration, count)
    place = runs[0].motion.poses.place
    parts: list[tuple[str, int]] = []
    all_frames = []
    for run in runs:
        robot = robot_of(run.log.config)
        motion = run.at(times)
        pose = motion.poses.actual
        segments = robot.module.segments(robot.parameters, pose, motion.position)
        parts = [(part, ends.shape[1]) for part, ends in segments.items()]
        points = (motion.poses.reference[:, :place], pose[:, :place], *segments.values())
        all_frames.append(np.hstack([part.reshape(count, -1) for part in points]))
    return Postures(place, times, parts, all_frames)


def animation(runs: Sequence[Run]) -> dict[str, Any]:
    """Postures of all runs of a robot whose pose is a place, for the page.

    Returns:
        ``place``, ``step`` between frames [s] and ``count`` of them, ``parts`` of the robot, the
        ``view`` of the whole robot and the ``detail`` of the path as x, y, width, height [m], in
        space as x, y, z, radius of a ball [m], and the ``runs``, whose frames are packed; see
        :class:`Postures`.
    """
    place, times, parts, all_frames = postures(runs)
    together = np.concatenate(all_frames)
    around = box if place == len('xy') else ball
    return {
        'place': place,
        'step': float(times[-1]) / max(len(times) - 1, 1),
        'count': len(times),
        'parts': parts,
        'view': around(together.reshape(-1, place), 0.05),
        'detail': around(together[:, : 2 * place].reshape(-1, place), 0.12),
        'runs': [
            {'style': run.style, 'frames': packed(frames)}
            for run, frames in zip(runs, all_frames, strict=True)
        ],
    }


def box(points: np.ndarray, margin: float) -> list[float]:
    """Square around points [m, m, m, m]: x, y of a corner, width, height."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = max(float((high - low).max()) * (1.0 + 2.0 * margin), 1e-3)
    x, y = (low + high) / 2.0 - size / 2.0
    return [float(x), float(y), size, size]


def ball(points: np.ndarray, margin: float) -> list[float]:
    """Ball around points in space [m, m, m, m]: x, y, z of its centre, radius."""
    centre = (np.nanmin(points, axis=0) + np.nanmax(points, axis=0)) / 2.0
    radius = float(np.nanmax(np.linalg.norm(points - centre, axis=1)))
    return [*map(float, centre), max(radius * (1.0 + margin), 5e-4)]


def render(
    groups: Mapping[str, Sequence[Run]],
    charts: Mapping[str, Sequence[Chart]],
    scale: str = AUTO,
) -> str:
    """Write the page.

    Args:
        groups: Name of a group to its runs, see :func:`runs.read_runs`.
        charts: Name of a group to its charts.
        scale: Of errors at first, see looks.SCALES.

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
                metric.in_units(units),
                _best([metric.printed(run.metrics) for run in good]) if alike else '',
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


def _best(values: Sequence[float]) -> str:
    """The smallest of several values as it is shown; empty if all are alike, or only one."""
    known = [value for value in values if not math.isnan(value)]
    return shown(min(known)) if len({*map(shown, known)}) > 1 else ''


def _cell(value: float) -> str:
    """A metric as it is shown; empty where it is not known."""
    return '' if math.isnan(value) else shown(value)


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
