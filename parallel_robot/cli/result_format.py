"""The option ``--format``: results as text, JSON, Markdown or LaTeX."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable
from typing import Any

from parallel_robot_model.common import tables
from parallel_robot_model.common.tables import Part

TEXT, JSON = 'text', 'json'
FORMATS = (TEXT, JSON, *(name for name in tables.FORMATS if name != TEXT))


def add_format_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the option."""
    parser.add_argument(
        '--format',
        choices=FORMATS,
        help='of the results: text (default), json, or tables in markdown or latex',
    )


def show(form: str | None, parts: Iterable[Part], data: Any, files: Iterable[str] = ()) -> None:
    """Print results.

    Args:
        form: One of FORMATS; None: text.
        parts: Their lines and tables.
        data: The same as plain data, for JSON; what is not finite is null.
        files: Lines on files that were written, see :func:`tell`.
    """
    if form == JSON:
        print(json.dumps(_finite(data), indent=2))
    elif form in (None, TEXT):
        print(tables.text(parts))
    else:
        print(tables.FORMATS[form](parts))
    tell(form, *files)


def tell(form: str | None, *lines: str) -> None:
    """Print lines on what is no result, such as files: in text alone."""
    if form in (None, TEXT):
        print(*lines, sep='\n', end='\n' if lines else '')


def _finite(data: Any) -> Any:
    """Plain data as JSON can have it."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
