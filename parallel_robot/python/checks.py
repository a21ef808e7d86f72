"""Robots checked, broken bags recovered, tunings drawn."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.writing import recovery
from parallel_robot.bags.writing.recovery import Recovery
from parallel_robot.python import arguments
from parallel_robot.studies.tuning.held_out import Compared, compare
from parallel_robot.studies.verification import (
    SCENARIOS,
    Difference,
    check_numbers,
    name_of,
    verify_machine,
    verify_robot,
)
from parallel_robot.studies.verification import verify as against_mujoco
from parallel_robot_model.common.errors import Frame, pandas
from parallel_robot_model.configuration.plain_data import Placed
from parallel_robot_model.robots.robot_checks import FINE
from parallel_robot_sim.scenario_run import named

ROBOTS = 10


def verify(
    robots: int | None = None, *, seed: int = 0, duration: float = 1.0, **values: Any
) -> Frame:
    """Compare plants with MuJoCo, or check one robot, as ``parallel_robot verify`` does.

    >>> import parallel_robot as pr
    >>> bool(pr.verify(robot_model='serial_2r').agrees.all())
    True

    Args:
        robots: Number of random robots of each kind against MuJoCo; None: 10.
        seed: Of all that is random.
        duration: Of each motion against MuJoCo [s].
        values: Keys of the configuration, such as ``robot_model``, ``custom_robots``; with any of
            them, the functions of that robot are checked against each other, without MuJoCo; or,
            with ``robots``, a described machine is compared with MuJoCo.

    Returns:
        A pandas.DataFrame. Against MuJoCo, a row a robot: kind, number, and the largest difference
        of its poses [m] or [rad]. Of one robot, a row a check, and whether it agrees.

    Raises:
        InputError: something is wrong in the arguments; MuJoCo or pandas is not installed.
        RunError: no motion was found that stays in the workspace.
    """
    frames = pandas()
    frame: Frame
    check_numbers(number := ROBOTS if robots is None else robots, seed, duration)
    if values and robots is None:
        _, checks = verify_robot(Placed(values), seed)
        rows = [(*check, check.passes(FINE)) for check in checks]
        columns = ['function', 'what', 'difference', 'size', 'agrees']
        frame = frames.DataFrame(rows, columns=columns)
        return frame
    found: dict[str, list[Difference]]
    if values:
        given = Placed(values)
        found = {name_of(given): verify_machine(given, range(number), seed, duration)}
    else:
        found = {kind: against_mujoco(kind, range(number), seed, duration) for kind in SCENARIOS}
    differences = [(kind, *each) for kind, differences in found.items() for each in differences]
    frame = frames.DataFrame(differences, columns=['kind', 'robot', 'largest_difference', 'path'])
    return frame


def recover(bag: str | Path, out: str | Path, *, memory: int = MEMORY) -> Recovery:
    """Write a whole bag of what is intact in a broken one, as ``parallel_robot recover`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/broken')
    >>> pr.recover('runs/broken', 'runs/whole').kept['/joint_states']
    101

    Args:
        bag: Directory of the bag, or one file of it.
        out: Directory of the new bag, which must not exist.
        memory: What may be held of the bag [bytes].

    Raises:
        BagError: nothing in it is intact, or the directory exists.
        RunError: the disk is full.
    """
    return recovery.recover(arguments.path('a bag', bag), arguments.path('out', out), memory)


def fronts(
    directories: Iterable[str | Path],
    out: str | Path,
    *,
    effort: str | None = None,
    study: str | Path | None = None,
    sweep: str | Path | None = None,
) -> Compared:
    """Draw the fronts of several tunings in one picture, as ``parallel_robot fronts`` does.

    >>> import parallel_robot as pr
    >>> chosen = {'trials': 16, 'duration': 1, 'bounds': {'z': (10, 50)}}
    >>> tuned = pr.tune('smc', 'paper_circle', 'runs/fronts', **chosen)
    >>> pr.fronts(['runs/fronts'], 'runs/fronts.png').out.name
    'fronts.png'

    Args:
        directories: Those of the results of :func:`tune`.
        out: Picture, .png or .svg, or with `study` a .yaml; must not exist.
        effort: ``'MEASURE=VALUE'``: compare laws at exactly this effort.
        study: Name or file of a study, which is written with the trials around the effort as its
            laws, for :func:`sweep`.
        sweep: Directory of a sweep of it, whose medians take the place of those of the searches.

    Returns:
        What the command prints; ``as_data()`` has the figures.

    Raises:
        InputError: one is no directory of a tuning that has ended, they cannot be compared, or the
            file cannot be written.
    """
    return compare(
        [arguments.path('a directory', each) for each in directories],
        arguments.path('out', out),
        None if effort is None else named('effort', effort),
        None if study is None else named('study', study),
        arguments.optional('sweep', sweep),
    )
