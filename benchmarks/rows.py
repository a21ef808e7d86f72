"""Figures of a benchmark: printed as a table, and as JSON in the last line of its output."""

from __future__ import annotations

import json
import statistics
from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]


def row(name: str, unit: str, values: Sequence[float], target: str = '') -> Row:
    """A figure with its spread.

    Args:
        name: What was measured.
        unit: Its unit; x for a ratio.
        values: One value a round.
        target: What the median should be, as ``>= 6`` or ``<= 1.3``; empty for none.
    """
    median = statistics.median(values)
    found = {'name': name, 'unit': unit, 'median': median, 'min': min(values), 'max': max(values)}
    found |= {'count': len(values)}
    return found | ({'target': target, 'met': met(median, target)} if target else {})


def ratios(of: Sequence[float], by: Sequence[float]) -> list[float]:
    """Ratios within each round, so that a busy machine harms both alike."""
    return [a / b for a, b in zip(of, by, strict=True)]


def met(value: float, target: str) -> bool:
    """Whether a value is what it should be."""
    sign, bound = target.split()
    return value >= float(bound) if sign == '>=' else value <= float(bound)


def cells(found: Row) -> tuple[str, str, str]:
    """Median with unit, span, and target with its verdict, as people read them."""
    median, low, high = (f'{found[key]:.4g}' for key in ('median', 'min', 'max'))
    verdict = f'{found["target"]}: {"met" if found["met"] else "missed"}' if 'met' in found else ''
    return f'{median} {found["unit"]}'.strip(), f'{low}\N{EN DASH}{high}', verdict


def show(found: Sequence[Row]) -> None:
    """Print figures as a table, then as JSON in one line."""
    for one in found:
        median, span, verdict = cells(one)
        print(f'  {one["name"]:<58}{median:>16}  ({span}, {one["count"]})  {verdict}'.rstrip())
    print(json.dumps(found), flush=True)
