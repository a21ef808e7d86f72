"""A table as a file: comma-separated values, or Apache Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from parallel_robot.bags import new_files
from parallel_robot.bags.progress import tracked
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
    new_files.check(path, '--out')


def write(path: Path, columns: Columns) -> None:
    """Write a table into a file, which must not exist.

    Raises:
        InputError: it cannot be written there, or pyarrow is needed and not installed.
        RunError: the disk is full.
    """
    content = io.BytesIO()
    FORMATS[path.suffix](columns, content)
    new_files.save(path, content.getbuffer())


def write_csv(columns: Columns, stream: IO[bytes]) -> None:
    """Write comma-separated values; numbers in their shortest form that reads back the same."""
    text = io.TextIOWrapper(stream, newline='', write_through=True)
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(map(harmless, columns))
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    count = len(next(iter(columns.values())))
    writer.writerows(tracked(rows, count, 'rows'))
    text.detach()


def harmless(text: str) -> str:
    """Text for a cell, quoted if a spreadsheet would take it for a formula."""
    return f"'{text}" if text.startswith(FORMULA) else text


def write_parquet(columns: Columns, stream: IO[bytes]) -> None:
    """Write Apache Parquet.

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
    arrays = {name: np.ascontiguousarray(column) for name, column in columns.items()}
    pyarrow.parquet.write_table(pyarrow.table(arrays), stream)


FORMATS: dict[str, Callable[[Columns, IO[bytes]], None]] = {
    '.csv': write_csv,
    '.parquet': write_parquet,
}
