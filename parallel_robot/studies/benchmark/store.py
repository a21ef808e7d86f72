"""The directory of a benchmark: runs and limits, a line each, kept as soon as they are known."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from parallel_robot.studies.limit.calm import Calm
from parallel_robot.studies.locked_directory import LockedDirectory
from parallel_robot_model.common.errors import InputError

RUNS, LIMITS, SEARCHES = 'runs.jsonl', 'limits.jsonl', 'searches'


class RunKey(NamedTuple):
    """Which run it is.

    Attributes:
        law: Name of the law.
        gains: 'default' or 'tuned'.
        sample: Number of the sample.
    """

    law: str
    gains: str
    sample: int


class RunFigures(NamedTuple):
    """What came of a run, in SI units.

    Attributes:
        status: ok, fault or failed.
        reason: Why it is not ok; empty if it is.
        error: Root mean square of the true error [m], or [rad] of joints; NaN without metrics.
        chattering: Of the torques [N m].
        torque: Root mean square of the torques [N m].
        energy: Energy of the motors [J].
    """

    status: str
    reason: str = ''
    error: float = math.nan
    chattering: float = math.nan
    torque: float = math.nan
    energy: float = math.nan


class Store(LockedDirectory):
    """The directory of a benchmark.

    Attributes:
        runs: What came of each run.
        limits: Sample to its limit by chattering; None where it has none.
    """

    KIND = 'benchmark'
    MANIFEST = 'benchmark.json'
    FIRST = (SEARCHES,)
    FORMAT = 'parallel_robot benchmark 1'

    def __init__(self, directory: Path, identity: Mapping[str, Any]) -> None:
        """Prepare the directory for a benchmark, or to go on in it.

        Args:
            directory: The directory.
            identity: What the runs depend on, plain data by name; another one is refused.
        """
        super().__init__(directory)
        self.runs: dict[RunKey, RunFigures] = {}
        self.limits: dict[int, Calm | None] = {}
        self._identity = json.loads(json.dumps(dict(identity)))

    @property
    def searches(self) -> Path:
        """Where the searches for gains are kept."""
        return self.directory / SEARCHES

    def add(self, runs: Mapping[RunKey, RunFigures], limits: Mapping[int, Calm | None]) -> None:
        """Keep runs, and limits of their samples.

        Raises:
            RunError: they cannot be written.
        """
        lines = [
            [sample, None if calm is None else [each.tolist() for each in calm]]
            for sample, calm in limits.items()
        ]
        self._append(LIMITS, lines)
        self._append(RUNS, ([*key, *_finite(figures)] for key, figures in runs.items()))
        self.limits |= limits
        self.runs |= runs

    def write(self, name: str, content: bytes) -> None:
        """Write a file in place of an older one; it is complete or as it was.

        Raises:
            RunError: it cannot be written.
        """
        with self.writing(self.directory / name) as stream:
            stream.write(content)

    def _kept(self) -> str:
        return f'{len(self.runs)} runs'

    def _append(self, name: str, lines: Iterable[Any]) -> None:
        path = self.directory / name
        text = ''.join(json.dumps(line) + '\n' for line in lines)
        try:
            with path.open('a') as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise self._full(path, error) from None

    def _open(self) -> None:
        self.searches.mkdir(exist_ok=True)
        if self.new:
            self._write_manifest(self._identity)
        else:
            held = self.manifest(self.directory)
            for key, value in self._identity.items():
                if held.get(key) != value:
                    raise InputError(
                        f'{self.directory} holds a benchmark with another {key}; '
                        'choose another --out'
                    )
        for line in self._lines(LIMITS):
            sample, calm = line
            self.limits[sample] = None if calm is None else Calm(*map(np.asarray, calm))
        for law, gains, sample, status, reason, *figures in self._lines(RUNS):
            numbers = [math.nan if each is None else each for each in figures]
            self.runs[RunKey(law, gains, sample)] = RunFigures(status, reason, *numbers)

    def _lines(self, name: str) -> list[Any]:
        """Whole lines of a file, from which a last one that a kill cut is taken away.

        Raises:
            InputError: a line is not as it was written.
        """
        path = self.directory / name
        stream: IO[bytes]
        with path.open('ab+') as stream:
            stream.seek(0)
            content = stream.read()
            whole = content[: content.rfind(b'\n') + 1]
            stream.truncate(len(whole))
        try:
            return [json.loads(line) for line in whole.splitlines()]
        except ValueError:
            raise InputError(f'{path} cannot be read; choose another --out') from None


def _finite(figures: RunFigures) -> list[Any]:
    """Figures for JSON, which has no NaN."""
    return [
        None if isinstance(each, float) and not math.isfinite(each) else each for each in figures
    ]
