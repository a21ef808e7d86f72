"""A benchmark from its protocol and laws to its score and page."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from parallel_robot.studies.benchmark import protocol as protocols
from parallel_robot.studies.benchmark.judged_runs import (
    SHIPPED,
    Competitors,
    competitors,
    identity,
    run,
    search,
)
from parallel_robot.studies.benchmark.protocol import Protocol
from parallel_robot.studies.benchmark.result import (
    MOST_DIFFERENCES,
    Scores,
    differences,
    facts_of,
    files,
    read,
)
from parallel_robot.studies.benchmark.scores import Store
from parallel_robot.studies.sweep.workers import Workers
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.tables import Part, ShownResult

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


# A benchmark run again from its score alone, and whether it is the same.

NOT_RUN = 'is of another protocol or of other samples, so nothing was run'


@dataclass(frozen=True, repr=False)
class Checked(ShownResult):
    """What a second run says of a score."""

    path: Path  # the file
    differences: tuple[str, ...]  # what differs, a line each; empty if the score is the same
    runs: int  # number of runs of each law and kind of gains; 0 if it is of another protocol

    def parts(self) -> list[Part]:
        """What differs, or that nothing does."""
        if not self.differences:
            return [f'{self.path}: the same to the last digit, {self.runs} runs of each law']
        count = len(self.differences)
        what = f'is not what comes out here, {count} differences' if self.runs else NOT_RUN
        parts: list[Part] = [f'{self.path} {what}:']
        parts += [f'  {line}' for line in self.differences[:MOST_DIFFERENCES]]
        return [*parts, '  ...'] if count > MOST_DIFFERENCES else parts

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        return {'same': not self.differences, 'differences': list(self.differences)}


def checked(
    path: Path,
    protocol: str,
    files: Sequence[str],
    directory: Path,
    workers: Callable[[], Workers],
) -> Checked:
    """Run the benchmark of a score again.

    Args:
        path: The score.
        protocol: Name or file of the protocol.
        files: Files of those of its laws that are not of the suite.
        directory: Where it is run.
        workers: Makes those who run it.

    Raises:
        InputError: it is no score, or the file of a law is missing.
        RunError: workers cannot run it, or the disk is full.
    """
    score = read(path)
    facts, entries = score.get('protocol'), score.get('laws')
    if not isinstance(facts, Mapping) or not isinstance(entries, Mapping) or not entries:
        raise InputError(f'{path} does not name its protocol and its laws')
    known = {Path(file).stem: file for file in files}
    laws = []
    for law, entry in entries.items():
        shipped = isinstance(entry, Mapping) and entry.get('source') == SHIPPED
        if not shipped and law not in known:
            name = printable(law)
            raise InputError(f'{name} is not of the suite: name its file, {name}.py')
        laws.append(law if shipped else known[law])
    phrase = facts.get('phrase')
    if phrase is not None and not isinstance(phrase, str):
        raise InputError(f'{path}: phrase must be a text, not {printable(phrase)}')
    asked = protocols.read(protocol, facts.get('quick') is True, phrase)
    other = differences({'protocol': facts}, {'protocol': facts_of(asked, phrase)})
    if other:
        return Checked(path, tuple(other), 0)
    ours = benchmarked(asked, phrase, competitors(laws), directory, workers)
    return Checked(path, tuple(differences(score, ours.as_data())), ours.count)
