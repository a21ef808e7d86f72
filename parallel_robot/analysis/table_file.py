"""A table as a file: comma-separated values, or Apache Parquet."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from parallel_robot.bags import output
from parallel_robot.bags.output import tracked
from parallel_robot_model.common.errors import InputError, UnknownNameError

FORMULA = ('=', '+', '-', '@', '\t', '\r')
Columns = Mapping[str, np.ndarray]


def check(path: Path) -> None:
    """Refuse a file of a table that exists, or whose suffix is of no format.

    Raises:
        InputError: with the reason.
    """
    if path.suffix not in FORMATS:
        raise UnknownNameError('table format', path.suffix, FORMATS)
    output.check_new(path, '--out')


def write(path: Path, parts: Iterable[Columns]) -> None:
    """Write a table into a file, which must not exist.

    Args:
        path: The file; it is there when all of the table is.
        parts: Tables whose rows follow each other, at least one, all with the same columns.

    Raises:
        InputError: it cannot be written there, or pyarrow is needed and not installed.
        RunError: the disk is full.
    """
    with output.growing(path) as stream:
        FORMATS[path.suffix](parts, stream)


def write_csv(parts: Iterable[Columns], stream: IO[bytes]) -> None:
    """Write comma-separated values; numbers in their shortest form that reads back the same."""
    text = io.TextIOWrapper(stream, newline='', write_through=True)
    writer = csv.writer(text, lineterminator='\n')
    first, parts = _first(parts)
    writer.writerow(map(harmless, first))
    rows = (row for part in parts for row in zip(*map(_numbers, part.values()), strict=True))
    writer.writerows(tracked(rows, None, 'rows'))
    text.detach()


def _first(parts: Iterable[Columns]) -> tuple[Columns, Iterable[Columns]]:
    """The first part, and all of them."""
    parts = iter(parts)
    first = next(parts)
    return first, itertools.chain([first], parts)


def _numbers(column: np.ndarray) -> list[Any]:
    """The numbers of a column as Python's."""
    found: list[Any] = column.tolist()
    return found


def harmless(text: str) -> str:
    """Text for a cell, quoted if a spreadsheet would take it for a formula."""
    return f"'{text}" if text.startswith(FORMULA) else text


def write_parquet(parts: Iterable[Columns], stream: IO[bytes]) -> None:
    """Write Apache Parquet, each part as a group of rows.

    Raises:
        InputError: pyarrow is not installed.
    """
    try:
        import pyarrow  # optional
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            'pyarrow is not installed; pip install pyarrow, or export to .csv'
        ) from None
    tables = (
        pyarrow.table({name: np.ascontiguousarray(column) for name, column in part.items()})
        for part in tracked(parts, None, 'parts')
    )
    first = next(tables)
    with pyarrow.parquet.ParquetWriter(stream, first.schema) as writer:
        for table in itertools.chain([first], tables):
            writer.write_table(table)


FORMATS: dict[str, Callable[[Iterable[Columns], IO[bytes]], None]] = {
    '.csv': write_csv,
    '.parquet': write_parquet,
}
