"""Charts as plain data for plotly.js, colours left to the page."""

from __future__ import annotations

import base64
import html
from typing import Any

import numpy as np

from parallel_robot.analysis.report.charts import Chart, Curve, Panel
from parallel_robot.analysis.report.looks import STYLES

ROW = 170  # px, height of a panel over time
GAP = 44  # px, between two rows
TOP, BOTTOM = 56, 48  # px, for legend and time axis
MARK = {'color': '#888', 'dash': 'dot', 'width': 1}  # of a change
COLUMN_GAP = 0.09  # of the width


def plot(chart: Chart, scale: str) -> dict[str, Any]:
    """Traces and layout of a chart.

    Args:
        chart: The chart.
        scale: Of errors, see scale.SCALES.

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
