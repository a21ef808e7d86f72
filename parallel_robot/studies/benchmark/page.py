"""The page of a benchmark, as HTML and PDF: scores with their intervals, and by condition."""

from __future__ import annotations

import base64
import html
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from parallel_robot.studies.benchmark.judged_runs import TUNED
from parallel_robot.studies.benchmark.result import Scores
from parallel_robot.studies.benchmark.scores import WHOLE, Summary
from parallel_robot.studies.sweep.picture import encoded
from parallel_robot.studies.sweep.summary import STYLE, cells
from parallel_robot_control.laws import title as title_of
from parallel_robot_model.common.tables import Table

TITLE = 'Benchmark'
WIDTH, LINE, MARGIN = 11.0, 0.26, 2.2  # in; LINE of a law with one kind of gains
LABELS = ('robot', 'mix', 'age', 'speed')
COLOURS = {TUNED: '#1f5a8f'}
PLAIN = '#8a8a8a'


def files(scores: Scores) -> dict[str, bytes]:
    """The page by name of its file."""
    pictures = encoded(_figure(scores))
    return {
        'page.html': _html(scores, pictures['png']).encode(),
        'page.pdf': pictures['pdf'],
    }


def _html(scores: Scores, picture: bytes) -> str:
    parts = [f'<p>{html.escape(line)}</p>' for line in scores.head()]
    text = base64.b64encode(picture).decode()
    parts.append(f'<img alt="Scores of the laws" src="data:image/png;base64,{text}">')
    for part in [*scores.parts()[len(scores.head()) :], *_by_robot(scores)]:
        if isinstance(part, Table):
            rows = [('th', part.head), *(('td', row) for row in part.rows)]
            lines = (cells(row, tag) for tag, row in rows)
            parts.append('<table>' + '\n'.join(lines) + '</table>')
        else:
            parts.append(f'<h2>{html.escape(part.strip())}</h2>')
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<title>{TITLE}</title><style>{STYLE}</style></head><body><h1>{TITLE}</h1>\n'
        + '\n'.join(parts)
        + '</body></html>\n'
    )


def _by_robot(scores: Scores) -> list[Any]:
    """What laws spend on each robot."""
    heads = ['law', 'gains', 'score', '5 % tail', 'chattering', 'torque', 'energy [J]']
    tables: dict[str, list[list[str]]] = {}
    for law, kind, found in scores.summaries:
        for robot, each in found['robot'].items():
            spent = [f'{value:.4g}' for value in (each.chattering, each.torque, each.energy)]
            figures = [f'{each.median.value:.3f}', f'{each.tail.value:.3f}', *spent]
            tables.setdefault(robot, []).append([law, kind, *figures])
    units = {robot.name: robot.unit for robot in scores.protocol.robots}
    parts: list[Any] = []
    for robot, rows in tables.items():
        unit = units[robot]
        named = [
            f'{head} [{unit}]' if head in ('chattering', 'torque') else head for head in heads
        ]
        parts += [robot, Table(named, rows, 'llrrrrr')]
    return parts


def _figure(scores: Scores) -> Any:
    """Scores with their intervals at the left, medians by condition at the right."""
    every = sorted(scores.summaries, key=lambda each: each[2][WHOLE][WHOLE].median.value)
    height = MARGIN + LINE * len(every)
    figure = Figure(figsize=(WIDTH, height), layout='constrained')
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    names = [f'{title_of(law)}, {kind}' for law, kind, _ in every]
    for place, (_, kind, found) in enumerate(every):
        whole = found[WHOLE][WHOLE]
        colour = COLOURS.get(kind, PLAIN)
        left.plot(
            [whole.median.low, whole.median.high], [place, place], color=colour, lw=3, alpha=0.4
        )
        left.plot(whole.median.value, place, 'o', color=colour, ms=6)
        left.plot(whole.tail.value, place, '|', color=colour, ms=9)
    left.set_yticks(range(len(every)), names, fontsize=8)
    left.set_ylim(-0.6, len(every) - 0.4)
    left.set_xlim(0.0, 1.0)
    left.axvline(1.0, color='black', lw=1.6, ls=(0, (1, 1)))
    left.set_xlabel('score; bar: 95 % interval, |: 5 % tail')
    left.grid(axis='x', alpha=0.3)
    _draw_medians(right, [found for *_, found in every])
    figure.suptitle(scores.head()[0], fontsize=9)
    return figure


def _draw_medians(panel: Any, every: list[dict[str, dict[str, Summary]]]) -> None:
    heads = [(label, value) for label in LABELS for value in every[0][label]]
    medians = np.array(
        [[found[label][value].median.value for label, value in heads] for found in every]
    )
    panel.imshow(medians, aspect='auto', origin='lower', cmap='Blues', vmin=0.0, vmax=1.0)
    for (row, column), value in np.ndenumerate(medians):
        colour = 'white' if value > 0.6 else 'black'
        panel.text(column, row, f'{value:.2f}', ha='center', va='center', fontsize=7, color=colour)
    names = [f'{label} {value}' if label == 'speed' else value for label, value in heads]
    panel.set_xticks(range(len(heads)), names, rotation=45, ha='right', fontsize=8)
    panel.set_yticks([])
    panel.set_title('median scores', fontsize=9)
