"""The fronts of several tunings in one picture."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from parallel_robot.studies.tuning.front import Compared, compare
from parallel_robot_model.common.options import path


def fronts(
    directories: Iterable[str | Path],
    out: str | Path,
) -> Compared:
    """Draw the fronts of several tunings in one picture, as ``parallel_robot fronts`` does.

    >>> import parallel_robot as pr
    >>> chosen = {'trials': 16, 'duration': 1, 'bounds': {'z': (10, 50)}}
    >>> tuned = pr.tune('smc', 'paper_circle', 'runs/fronts', **chosen)
    >>> pr.fronts(['runs/fronts'], 'runs/fronts.png').out.name
    'fronts.png'

    Args:
        directories: Those of the results of :func:`tune`.
        out: Picture, .png or .svg; must not exist.

    Returns:
        What the command prints; ``as_data()`` has the figures.

    Raises:
        InputError: one is no directory of a tuning that has ended, they cannot be compared, or the
            file cannot be written.
    """
    return compare(
        [path('a directory', each) for each in directories],
        path('out', out),
    )
