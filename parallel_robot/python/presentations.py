"""Reports, videos and tables of bags."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from parallel_robot.analysis import table, video_file
from parallel_robot.analysis.frames import write_viewer_copy
from parallel_robot.analysis.report import report_files
from parallel_robot.analysis.report.looks import AUTO, check
from parallel_robot.analysis.report.report_files import Report
from parallel_robot.analysis.video_file import RATE, Video
from parallel_robot.bags import output
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recorded_robot
from parallel_robot.python import arguments
from parallel_robot_model.common.errors import Frame, pandas

Bags = str | Path | Iterable[str | Path]


def report(
    bags: Bags,
    out: str | Path,
    *,
    scale: str = AUTO,
    trust: bool = False,
    custom_robots: Sequence[str | Path] = (),
    **options: Any,
) -> Report:
    """Write the paper's figures and one interactive page, as ``parallel_robot report`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/smc')
    >>> pr.report('runs/smc', 'runs/report').page
    PosixPath('runs/report/report.html')

    Args:
        bags: A bag, or several of which the runs are compared.
        out: Directory of the report, which must not exist.
        scale: Of errors, see ``plot``.
        trust: Whether the code of robots that bags hold may run: with all your rights.
        custom_robots: Files of robots of yours, which take the place of those in bags.
        options: What bags do not say themselves, and keys of their configuration, see ``load``.

    Returns:
        Its page, the number of figures beside it, and warnings.

    Raises:
        InputError: bags are too many or no bags, or the directory cannot be written.
    """
    check(scale)
    found, path = arguments.bags(bags), arguments.path('out', out)
    code = recorded_robot.chosen(trust, custom_robots)
    view = arguments.view(options)
    return report_files.make(found, path, scale, code, view)


def video(
    bags: Bags,
    out: str | Path,
    *,
    rate: float = RATE,
    speed: float = 1.0,
    magnify: float | None = None,
    trust: bool = False,
    custom_robots: Sequence[str | Path] = (),
    **options: Any,
) -> Video:
    """Write a video of the moving robot, as ``parallel_robot video`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/video_of')
    >>> pr.video('runs/video_of', 'runs/smc.gif', rate=4).frames
    3

    Args:
        bags: A bag, or up to four, side by side.
        out: Its file, .mp4 or .gif, which must not exist.
        rate: Frames of a second of the video [Hz].
        speed: Seconds of the motion in a second of the video.
        magnify: By how much errors of the path are magnified; default: as much as they fill the
            view.
        trust: Whether the code of robots that bags hold may run: with all your rights.
        custom_robots: Files of robots of yours, which take the place of those in bags.
        options: What bags do not say themselves, and keys of their configuration, see ``load``.

    Returns:
        Its path, the number of its frames, and by how much errors are magnified.

    Raises:
        InputError: a value is wrong, bags are too many or no bags, or the file cannot be written.
        RunError: the disk is full.
    """
    found, path = arguments.bags(bags), arguments.path('out', out)
    code = recorded_robot.chosen(trust, custom_robots)
    view = arguments.view(options)
    return video_file.make(found, path, rate, speed, magnify, code, view)


def export(
    bag: str | Path,
    out: str | Path | None = None,
    *,
    foxglove: str | Path | None = None,
    trust: bool = False,
    custom_robots: Sequence[str | Path] = (),
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
        bag: Directory of the bag, or its MCAP file.
        out: File of the table, .csv or .parquet, which must not exist; default: none.
        foxglove: Directory of a copy of the bag that has description, frames and paths of the
            robot for Foxglove, Lichtblick and RViz; must not exist; default: none.
        trust: Whether the code of robots that bags hold may run: with all your rights.
        custom_robots: Files of robots of yours, which take the place of those in bags.
        memory: What may be held of the bag [bytes].
        options: What the bag does not say itself, and keys of its configuration, see ``load``.

    Returns:
        A pandas.DataFrame, one row a state; ``attrs['warnings']`` says what is wrong with the bag.

    Raises:
        BagError: not a bag of a run.
        InputError: a file cannot be written, or pandas is not installed.
        RunError: the disk is full.
    """
    frames = pandas()
    bag = arguments.path('a bag', bag)
    file, copy = arguments.optional('out', out), arguments.optional('foxglove', foxglove)
    if file is not None:
        table.check_table_file(file)
    if copy is not None:
        output.check_directory(copy)
    code = recorded_robot.chosen(trust, custom_robots)
    view, only = arguments.view(options), copy is None
    recording = recorded_robot.read(bag, memory, code, table.NEEDED, view, motion_only=only)
    columns, warnings = table.of(recording)
    if copy is not None:
        write_viewer_copy(bag, lambda: iter([recording]), copy, memory)
    if file is not None:
        table.write_table(file, [columns])
    frame: Frame = frames.DataFrame(columns)
    frame.attrs['warnings'] = warnings
    return frame
