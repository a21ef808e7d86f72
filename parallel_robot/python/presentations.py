"""Reports, videos and tables of bags; bags computed again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from parallel_robot.analysis import pictures, table, video_file
from parallel_robot.analysis.frames import write_viewer_copy
from parallel_robot.analysis.replay import bag_replay, bag_rerun
from parallel_robot.analysis.replay.bag_replay import BagReplay
from parallel_robot.analysis.replay.bag_rerun import Rerun
from parallel_robot.analysis.report import report_files
from parallel_robot.analysis.report.looks import AUTO, check
from parallel_robot.analysis.report.report_files import Report
from parallel_robot.analysis.video_file import RATE, Video
from parallel_robot.bags import output
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recorded_robot
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.python import arguments
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import Frame, InputError, pandas
from parallel_robot_model.configuration.plain_data import merged
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.scenario_run import changes, named
from parallel_robot_sim.simulation import RunSummary, parts

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


# Bags computed again: their torques, or their experiments.


def replay(
    bag: str | Path,
    *,
    law: str | Path | None = None,
    figure: str | Path | None = None,
    trust: bool = False,
    memory: int = MEMORY,
    param_file: str | Path | Iterable[str | Path] | None = None,
    **values: Any,
) -> BagReplay:
    """Compute the torques of a bag again, as ``parallel_robot replay`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/replayed')
    >>> pr.replay('runs/replayed')
    paper_circle, smc: 501 states answered again by smc
    identical: 501 commands
    >>> pr.replay('runs/replayed', **{'smc.z': 20}).torque.shape
    (501, 3)

    Args:
        bag: Directory of the bag, or its MCAP file.
        law: The law that computes them; default: that of the bag.
        figure: Picture of both torques, .png, .pdf or .svg, which must not exist; default: none.
        trust: Whether the code of laws, robot and trajectory that the bag holds may run: with all
            your rights.
        memory: What may be held of the bag [bytes].
        param_file: YAML file with keys of the configuration, or several; later ones win.
        values: Keys of the configuration of the controller that change, and their values; and
            what the bag does not say itself, see ``load``.

    Returns:
        Its ``torque`` beside the ``recorded`` one, and how many are ``differing``.

    Raises:
        BagError: not a bag of a run, or it needs code that it does not hold or that may not run.
        InputError: a key or a value is wrong, or the figure cannot be written.
    """
    path = arguments.optional('figure', figure)
    if path is not None:
        pictures.check_new(path)
    options = {name: values.pop(name) for name in arguments.OF_BAG if name in values}
    changed = changes(param_file, values)
    if law is not None:
        changed = merged([changed, law_loader.chosen(named('law', law), changed)])
    place = arguments.path('a bag', bag)
    view = arguments.view(options)
    with bag_replay.prepared(place, changed, trust, memory, False, view) as prepared:
        found = prepared.compute()
    if path is not None:
        found.save_figure(path)
    return found


def rerun(
    bag: str | Path,
    out: str | Path | None = None,
    *,
    duration: float | None = None,
    trust: bool = False,
    memory: int = MEMORY,
) -> Rerun:
    """Run the experiment of a simulated bag once more, as ``parallel_robot rerun`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/first')
    >>> pr.rerun('runs/first', 'runs/second')
    identical: 382 messages

    Args:
        bag: Directory of the bag, or its MCAP file.
        out: Directory of the new bag, which must not exist; default: beside the bag, its name
            ends with ``_rerun``.
        duration: Length of the motion [s]; default: as recorded.
        trust: Whether the code of laws, robot and trajectory that the bag holds may run: with all
            your rights.
        memory: What may be held of each bag [bytes].

    Returns:
        Whether both bags are ``identical``, and the first ``difference``.

    Raises:
        BagError: not a bag of a run, it needs code that it does not hold or that may not run, or
            the new one cannot be written.
        InputError: the bag is of nodes, or a value is wrong.
        RunError: the disk is full.
    """
    place = arguments.path('a bag', bag)
    path = arguments.optional('out', out) or bag_rerun.default_place(place)
    with bag_rerun.prepared(place, duration, trust, memory, told=False) as experiment:
        if not experiment.simulated:
            raise InputError(f'{bag} is of nodes, which `parallel_robot rerun` starts again')
        output.check_directory(path)
        values = resolve(experiment.scenario, experiment.changes | {'time_mode': 'lockstep'})
        summary = RunSummary()
        simulation_bag.save(path, values, summary.taken(parts(configure(values))))
    found = experiment.compare(path, memory)
    failure = (summary.failure,) if summary.failure else ()
    return replace(found, warnings=(*found.warnings, *failure))
