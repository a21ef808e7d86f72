"""The results of a sweep as text, CSV, LaTeX and HTML."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from parallel_robot.analysis.metrics import Metric
from parallel_robot.analysis.readable_metrics import shown
from parallel_robot.studies.sweep.plan import Plan, sampling
from parallel_robot.studies.sweep.results import ScenarioResult
from parallel_robot.studies.sweep.statistics import Estimate, fewest
from parallel_robot_control.laws import title as title_of
from parallel_robot_model.common import tables
from parallel_robot_model.common.tables import Part, Table

Results = Mapping[str, ScenarioResult]
STRONGEST = 5  # parameters that are shown as drivers of the error, if they are any; CSV has all
NOTE = 'Medians, probabilities and rank correlations with 95 % intervals; those of medians {0}.'
FAILED = 'A run that failed or ended in a fault counts as worse than every number.'
PAIRS = (
    "{0} pairs, p of the sign test with Holm's correction over all of them, open from {1:g} on."
)
LEVEL = 0.05  # of p
COLUMNS = ('scenario', 'law', 'quantity', 'unit', 'value', 'low', 'high', 'runs')
STYLE = (
    'body{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}'
    'table{border-collapse:collapse;margin:1em 0}td,th{padding:.2em .8em;text-align:right}'
    'td:first-child,th:first-child{text-align:left}tr{border-bottom:1px solid #ccc}img{width:100%}'
)


def parts(plan: Plan, results: Results) -> list[Part]:
    """The summary as lines and tables."""
    parts: list[Part] = [_head(plan), *_notes(plan, results)]
    for scenario, result in results.items():
        for title, found in _tables(result):
            parts += [f'\n{scenario}: {title}', found]
        parts += [f'  {result.together}'] * bool(result.together)
        for law, of_law in result.laws.items():
            parts += [f'  {law}, {count} runs: {why}' for why, count in of_law.reasons.items()]
    return parts


def text(plan: Plan, results: Results) -> str:
    """The summary for a terminal."""
    return tables.text(parts(plan, results)) + '\n'


def page(plan: Plan, results: Results, picture: bytes) -> str:
    """The summary as one HTML file.

    Args:
        plan: The plan of the sweep.
        results: Its results.
        picture: Picture of the distributions, PNG.
    """
    notes = ' '.join(_notes(plan, results))
    parts = [f'<p>{html.escape(_head(plan))}. {html.escape(notes)}</p>']
    for scenario, result in results.items():
        parts.append(f'<h2>{html.escape(scenario)}</h2>')
        for title, found in _tables(result, title_of):
            parts.append(f'<h3>{html.escape(title)}</h3><table>{cells(found.head, "th")}')
            parts += [cells(row, 'td') for row in found.rows]
            parts.append('</table>')
        parts.append(f'<p>{html.escape(result.together)}</p>')
        for law, of_law in result.laws.items():
            for why, count in of_law.reasons.items():
                parts.append(f'<p>{html.escape(f"{title_of(law)}, {count} runs: {why}")}</p>')
    encoded = base64.b64encode(picture).decode()
    parts.append(f'<img alt="Distributions of the error" src="data:image/png;base64,{encoded}">')
    return html_page('Study', parts)


def html_page(title: str, parts: Sequence[str]) -> str:
    """A page of parts in HTML below its title."""
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f'<style>{STYLE}</style></head><body><h1>{title}</h1>\n'
        + '\n'.join(parts)
        + '</body></html>\n'
    )


def latex(results: Results) -> str:
    """The tables of the laws, error and effort, two tabulars for each scenario."""
    parts: list[Part] = []
    for scenario, result in results.items():
        for title, found in _tables(result, title_of)[:2]:
            parts += [f'{scenario}: {title}', found]
    return tables.latex(parts) + '\n'


def table(results: Results) -> str:
    """All numbers as comma-separated values, one number with its interval a row."""
    return tables.comma_separated(COLUMNS, _numbers(results))


def as_data(results: Results) -> list[dict[str, Any]]:
    """The same as plain data, for JSON."""
    return [dict(zip(COLUMNS, row, strict=True)) for row in _numbers(results)]


def _numbers(results: Results) -> Iterator[list[Any]]:
    """One number with its interval a row."""
    for scenario, result in results.items():
        for name, level in result.levels.items():
            row = [scenario, '', f'median of {name}', result.quantities[0].unit]
            yield [*row, *level.median, len(level.values)]
        for law, found in result.laws.items():
            total = sum(found.runs.values())
            for quantity, median in zip(result.quantities, found.medians, strict=True):
                name = f'median of {quantity.name}'
                yield [scenario, law, name, quantity.unit, *median, total]
            for status, count in sorted(found.runs.items()):
                yield [scenario, law, f'runs {status}', '', count, '', '', total]
            for driver in found.drivers:
                name = f'partial rank correlation of the error with {driver.parameter}'
                yield [scenario, law, name, '', *driver.correlation, total]
        for duel in result.duels:
            total = sum(result.laws[duel.winner].runs.values())
            name = f'probability of a smaller error than {duel.loser}'
            yield [scenario, duel.winner, name, '', *duel.probability, total]
            name = f'p of a smaller error than {duel.loser}, corrected by Holm'
            yield [scenario, duel.winner, name, '', duel.p, '', '', total]


def _head(plan: Plan) -> str:
    study = plan.study
    lengths = ' or '.join(f'{each:g}' for each in plan.durations)
    return (
        f'{study.runs} runs of each law and scenario, {lengths} s each, '
        f'{len(study.uncertainties)} uncertain parameters ({sampling(study)}, seed {study.seed})'
    )


def _notes(plan: Plan, results: Results) -> list[str]:
    """What the numbers mean."""
    scrambles = plan.study.scrambles
    how = 'are bootstrapped over the runs'
    if scrambles > 1:
        how = f'are t-intervals between {scrambles} independently scrambled Sobol sequences'
    pairs = sum(len(result.duels) for result in results.values())
    notes = [NOTE.format(how), FAILED, *([PAIRS.format(pairs, LEVEL)] if pairs else [])]
    needed = fewest(len(plan.columns()))
    few = bool(plan.columns()) and plan.study.runs < needed
    return notes + [f'What the error goes with is told from {needed} runs on.'] * few


def _tables(
    result: ScenarioResult, written: Callable[[str], str] = str
) -> list[tuple[str, Table]]:
    """Title and table of each table of a scenario."""
    accuracy = len(result.quantities) - result.efforts
    first = [['law', 'ok', *map(_heading, result.quantities[:accuracy])]]
    efforts = [['law', *map(_heading, result.quantities[accuracy:])]]
    drivers = [['law', 'parameter', 'correlation']]
    for law, found in result.laws.items():
        runs = f'{found.runs.get("ok", 0)}/{sum(found.runs.values())}'
        medians = [*map(_with_interval, found.medians)]
        first.append([written(law), runs, *medians[:accuracy]])
        efforts.append([written(law), *medians[accuracy:]])
        drivers += [
            [written(law), driver.parameter, _with_interval(driver.correlation, 2)]
            for driver in found.drivers[:STRONGEST]
            if driver.correlation.low > 0.0 or driver.correlation.high < 0.0
        ]
    blank = [''] * (accuracy - 1)
    first += [
        [name, '', _with_interval(level.median), *blank] for name, level in result.levels.items()
    ]
    duels = [['winner', 'against', 'probability', 'p']]
    duels += [
        [
            written(duel.winner),
            written(duel.loser),
            _with_interval(duel.probability, 3),
            f'{duel.p:.1g}' if duel.p < LEVEL else f'{duel.p:.2f}, open',
        ]
        for duel in result.duels
    ]
    titled = [
        ('medians', first, 'lr'),
        ('medians of the effort', efforts, 'lr'),
        ('who has the smaller error in the same sample', duels, 'llr'),
        ('what the error goes with (partial rank correlation)', drivers, 'llr'),
    ]
    return [(title, Table(head, rows, align)) for title, (head, *rows), align in titled if rows]


def _heading(quantity: Metric) -> str:
    return f'{quantity.name} [{quantity.unit}]' if quantity.unit else quantity.name


def _with_interval(estimate: Estimate, digits: int | None = None) -> str:
    def text(value: float) -> str:
        if math.isinf(value):
            return 'failed'
        return shown(value) if digits is None else f'{value:.{digits}f}'

    return f'{text(estimate.value)} [{text(estimate.low)}, {text(estimate.high)}]'


def cells(row: Sequence[str], tag: str) -> str:
    """A row of a table in HTML; `tag` of its cells, th or td."""
    return '<tr>' + ''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in row) + '</tr>'
