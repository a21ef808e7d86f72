"""The command ``export``: a bag as a table, one row for each state, or as a bag for viewers."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from parallel_robot.analysis import frames, table
from parallel_robot.analysis.frames import ViewerCopy
from parallel_robot.bags.bag_reader import BagView
from parallel_robot.bags.run import recorded_robot
from parallel_robot.bags.run.recorded_robot import RobotCode
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.commands.simulate import add_set_argument, given
from parallel_robot.cli.shared import add_bag_arguments, bag_view, robot_code, warn
from parallel_robot_model.common.errors import WholeNeededError


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
    add_bag_arguments(parser)
    add_set_argument(parser)
    add_trust_argument(parser, 'the robot')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    bag, out = arguments.bag, arguments.out
    if out:
        table.check_table_file(out)
    values = given(arguments)
    code, view = robot_code(arguments, values), bag_view(arguments, values)
    if arguments.foxglove:
        copy = _copy(bag, code, view, arguments.foxglove)
        warn(copy.warnings)
        seen = ', seen' if copy.seen else ''
        print(f'bag     {copy.path}, with {copy.frames} frames of the robot{seen}')
        return 0
    written = recorded_robot.evaluated(
        lambda recordings: _write(bag, out, recordings),
        bag,
        code=code,
        topics=table.NEEDED,
        view=view,
        motion_only=True,
    )
    warn(written.warnings.lines)
    print(f'table   {out}, {written.rows} rows, {written.columns} columns')
    return 0


def _copy(bag: Path, code: RobotCode, view: BagView, out: Path) -> ViewerCopy:
    """Write the copy of a bag for viewers, window by window where that is possible."""
    try:
        return frames.write_viewer_copy(
            bag, lambda: recorded_robot.chunks(bag, code=code, view=view), out
        )
    except WholeNeededError:
        whole = recorded_robot.read(bag, code=code, view=view)
        return frames.write_viewer_copy(bag, lambda: iter([whole]), out)


@dataclass
class _Written:
    """A table so far: how large it is, and what is wrong with its bag."""

    rows: int = 0
    columns: int = 0
    warnings: AlikeLines = field(default_factory=AlikeLines)

    def seen(self, bag: Path, recordings: Iterator[Recording]) -> Iterator[Recording]:
        """Pass the windows of the bag on."""
        for recording in recordings:
            self.warnings.count(bag, recording.log)
            yield recording

    def passed(self, parts: Iterable[table.Table]) -> Iterator[table.TableColumns]:
        """Pass the parts of the table on."""
        for columns, warnings in parts:
            self.warnings.add(warnings)
            self.rows, self.columns = self.rows + len(columns['time_s']), len(columns)
            yield columns


def _write(bag: Path, out: Path, recordings: Iterator[Recording]) -> _Written:
    """Write the table of a bag window by window."""
    written = _Written()
    table.write_table(out, written.passed(table.parts(written.seen(bag, recordings))))
    return written
