"""The command ``export``: a bag as a table, one row for each state, or as a bag for viewers."""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from parallel_robot.analysis import recorded_motions, table
from parallel_robot.analysis.frames import Frames
from parallel_robot.bags import new_files, recorded_robot
from parallel_robot.bags.limits import add_memory_argument
from parallel_robot.bags.progress import tracked
from parallel_robot.bags.recorded_robot import RobotCode
from parallel_robot.bags.recovery import recover
from parallel_robot.cli.robot_code import add_robot_arguments, robot_code
from parallel_robot_model.common.errors import BagError, InputError, UnknownNameError
from parallel_robot_sim.motions import differs

FORMULA = ('=', '+', '-', '@', '\t', '\r')
Columns = Mapping[str, np.ndarray]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag, or one file of it')
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument(
        '--out',
        type=Path,
        metavar='FILE',
        help='table; must not exist; its suffix chooses: .csv or .parquet',
    )
    kind.add_argument(
        '--foxglove',
        type=Path,
        metavar='DIR',
        help='copy of the bag, with description, frames (tf) and paths of the robot for Foxglove, '
        'Lichtblick and RViz; must not exist',
    )
    add_robot_arguments(parser)
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    bag, memory, code = arguments.bag, arguments.max_memory, robot_code(arguments)
    if arguments.foxglove:
        return _copy(bag, arguments.foxglove, memory, code)
    out: Path = arguments.out
    if out.suffix not in FORMATS:
        raise UnknownNameError('table format', out.suffix, FORMATS)
    new_files.check(out, '--out')
    found, warnings = table.read(bag, memory, code)
    for warning in warnings:
        print(f'warning: {warning}', file=sys.stderr)
    content = io.BytesIO()
    FORMATS[out.suffix](found, content)
    new_files.save(out, content.getbuffer())
    print(f'table   {out}, {len(found["time_s"])} rows, {len(found)} columns')
    return 0


def _copy(bag: Path, out: Path, memory: int, code: RobotCode) -> int:
    """Write a bag with all that viewers need to draw the robot."""
    log, past, _ = recorded_robot.read(bag, memory, code)
    for warning in log.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    unknown = recorded_robot.unknown(log.config)
    if unknown:
        raise BagError(f'{bag}: {unknown}')
    seen = not recorded_motions.of_plant(past) or differs(log.config)
    frames = Frames(log, seen)
    recover(bag, out, memory, frames.write)
    print(f'bag     {out}, with {frames.count} frames of the robot{", seen" if seen else ""}')
    return 0


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
