"""Laws judged by a fixed protocol."""

from __future__ import annotations

from pathlib import Path

from parallel_robot.python import arguments
from parallel_robot.studies.benchmark.benchmark import benchmarked
from parallel_robot.studies.benchmark.judged_runs import competitors
from parallel_robot.studies.benchmark.protocol import DEFAULT, read
from parallel_robot.studies.benchmark.result import Scores
from parallel_robot.studies.sweep.sweep import MOST_WORKERS, default_workers
from parallel_robot.studies.sweep.workers import Processes
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_sim.scenario_run import named


def benchmark(
    *laws: str | Path,
    out: str | Path,
    quick: bool = False,
    phrase: str | None = None,
    protocol: str | Path = DEFAULT,
    workers: int | None = None,
) -> Scores:
    """Judge laws against the limit by a fixed protocol, as ``parallel_robot benchmark`` does.

    >>> import parallel_robot as pr
    >>> found = pr.benchmark('pid', 'my_law.py', out='runs/scores', quick=True)  # doctest: +SKIP
    >>> found.as_data()['laws']['pid']['tuned']['all']['all']['score']  # doctest: +SKIP

    Args:
        laws: Names of laws of the suite, or Python files of others.
        out: Directory of the results; new, or that of the same benchmark, which is continued.
        quick: Whether only a first look is wanted.
        phrase: Words from which other samples are drawn than those to develop on.
        protocol: Name of a protocol, or its file.
        workers: Processes; default: one for each core.

    Returns:
        The scores; ``as_data()`` has all of them.

    Raises:
        InputError: something in the arguments is wrong, or the directory is of another benchmark.
        RunError: workers cannot run it, or the disk is full; what is finished is kept.
    """
    count = default_workers() if workers is None else workers
    count = check('workers', int, Field('', '', 1, MOST_WORKERS), count)
    asked = read(named('protocol', protocol), quick, phrase)
    judged = competitors([named('law', law) for law in laws])
    return benchmarked(asked, phrase, judged, arguments.path('out', out), lambda: Processes(count))
