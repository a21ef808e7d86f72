"""A benchmark from its protocol and laws to its score and page."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from parallel_robot.studies.benchmark.judged_runs import Competitors, identity, run, search
from parallel_robot.studies.benchmark.protocol import Protocol
from parallel_robot.studies.benchmark.result import Scores, files
from parallel_robot.studies.benchmark.scores import Store
from parallel_robot.studies.sweep.workers import Workers

SCORE = 'score.json'


def benchmarked(
    protocol: Protocol,
    phrase: str | None,
    laws: Competitors,
    directory: Path,
    workers: Callable[[], Workers],
) -> Scores:
    """Run a benchmark, or what is left of it, and write its score and page.

    Args:
        protocol: The protocol.
        phrase: The phrase from which its samples were drawn; None for the public ones.
        laws: The laws.
        directory: Where it is kept; new, or that of the same benchmark, which is continued.
        workers: Makes those who run it.

    Raises:
        InputError: the directory holds something else, or a law has no gain to vary.
        RunError: workers cannot run it, or the disk is full; what is finished is kept.
    """
    begin = time.monotonic()
    with workers():  # can they be reached? Before anything is written
        pass
    with Store(directory, identity(protocol, laws)) as store:
        gains = search(protocol, laws, store, workers)
        runs = run(protocol, laws, gains, store, workers)
        scores = Scores(protocol, phrase, laws, gains, runs, time.monotonic() - begin)
        store.write(SCORE, scores.json().encode())
        for name, content in files(scores).items():
            store.write(name, content)
    return scores
