"""A bag as a table, one row for each state, or as a copy for viewers."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from parallel_robot.analysis import frames, table
from parallel_robot.bags import output
from parallel_robot.bags.bag_reader import view
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recorded_robot
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot_model.common.errors import Frame, InputError, WholeNeededError, pandas
from parallel_robot_model.common.options import optional_path, path
from parallel_robot_model.configuration.config import Place


def export(
    bag: Place,
    out: Place | None = None,
    *,
    foxglove: Place | None = None,
    trust: bool = False,
    memory: int = MEMORY,
    **options: Any,
) -> Frame:
    """A bag as a table, and in files for other programs, as ``parallel_robot export`` writes them.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/exported')
    >>> frame = pr.export('runs/exported', 'runs/smc.csv')
    >>> list(frame[['time_s', 'joint1_position_rad']].iloc[500].round(3))
    [0.5, 1.454]

    Args:
        bag: Directory of a bag, or one file of it.
        out: File of the table, .csv or .parquet, which must not exist.
        foxglove: Directory of a copy of the bag, with description, frames (tf) and paths of the
            robot for Foxglove, Lichtblick and RViz, which must not exist.
        trust: Whether the code of the robot that the bag holds runs, with all your rights; on a
            terminal, it is shown first.
        memory: What may be held of the bag [bytes].
        options: What the bag does not say itself, see ``load``, and keys of its configuration,
            such as `custom_robots`, files that take the place of that in the bag.

    Returns:
        A pandas.DataFrame, one row a state; ``attrs['warnings']`` says what is wrong with the bag.

    Raises:
        BagError: not a bag of a run.
        InputError: a file cannot be written, or pandas is not installed.
        RunError: the disk is full.
    """
    data = pandas()
    place = path('a bag', bag)
    file, copy = optional_path('out', out), optional_path('foxglove', foxglove)
    if file is not None:
        table.check_table_file(file)
    if copy is not None:
        output.check_directory(copy)
    asked, only = view(**options), copy is None
    code = recorded_robot.code_of(trust, asked)
    recording = recorded_robot.read(place, memory, code, table.NEEDED, asked, motion_only=only)
    columns, warnings = table.of(recording)
    if copy is not None:
        frames.write_viewer_copy(place, lambda: iter([recording]), copy, memory)
    if file is not None:
        table.write_table(file, [columns])
    frame: Frame = data.DataFrame(columns)
    frame.attrs['warnings'] = warnings
    return frame


# The same of a bag of any length, window by window, for the command.


@dataclass
class Exported:
    """A file that was written, and what is wrong with its bag."""

    place: Path
    rows: int = 0
    columns: int = 0
    warnings: AlikeLines = field(default_factory=AlikeLines)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is wrong with the bag, one line each."""
        return self.warnings.lines

    def __str__(self) -> str:
        """What the command prints."""
        return f'table   {self.place}, {self.rows} rows, {self.columns} columns\n'

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


@functools.wraps(export, assigned=())
def exported(
    bag: Place,
    *,
    out: Place | None = None,
    foxglove: Place | None = None,
    trust: bool = False,
    **options: Any,
) -> Exported | frames.ViewerCopy:
    """Write one of both."""
    place, file = path('a bag', bag), optional_path('out', out)
    copy = optional_path('foxglove', foxglove)
    if file and copy:
        raise InputError('--foxglove: not allowed with argument --out')
    if not (file or copy):
        what = 'one of the arguments --out --foxglove is required'
        raise InputError(f'{what}; parallel_robot export --help lists what it takes')
    if file:
        table.check_table_file(file)
    asked = view(**options)
    code = recorded_robot.code_of(trust, asked)
    if copy:
        try:
            windows = functools.partial(recorded_robot.chunks, place, code=code, view=asked)
            return frames.write_viewer_copy(place, windows, copy)
        except WholeNeededError:
            whole = recorded_robot.read(place, code=code, view=asked)
            return frames.write_viewer_copy(place, lambda: iter([whole]), copy)
    assert file is not None

    def written(recordings: Iterator[Recording]) -> Exported:
        found = Exported(file)
        table.write_table(file, found.passed(table.parts(found.seen(place, recordings))))
        return found

    return recorded_robot.evaluated(
        written, place, code=code, topics=table.NEEDED, view=asked, motion_only=True
    )
