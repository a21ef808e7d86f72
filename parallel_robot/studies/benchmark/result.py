"""The result of a benchmark: as tables, as JSON, and what differs between two."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from parallel_robot.bags.experiment import software
from parallel_robot.studies.benchmark.judged_runs import TUNED, Competitors, Gains, digest
from parallel_robot.studies.benchmark.protocol import Protocol
from parallel_robot.studies.benchmark.scores import (
    WHOLE,
    ScoredRun,
    Summary,
    as_data,
    by_label,
)
from parallel_robot.studies.sweep.tasks import version
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.tables import Part, ShownResult, Table

FORMAT = 'parallel_robot benchmark score 1'
OF_MACHINE = ('machine', 'seconds')  # what may differ between two of the same benchmark
MOST_DIFFERENCES = 10  # that are told


@dataclass(frozen=True, repr=False)
class Scores(ShownResult):
    """The scores of a benchmark.

    Attributes:
        protocol: Its protocol.
        phrase: The phrase from which its samples were drawn; None for the public ones.
        laws: The laws.
        gains: Their tuned gains by law and robot.
        runs: Law, and 'default' or 'tuned', to its runs.
        seconds: How long it took [s].
    """

    protocol: Protocol
    phrase: str | None
    laws: Competitors
    gains: Gains
    runs: Mapping[str, Mapping[str, list[ScoredRun]]]
    seconds: float

    @cached_property
    def summaries(self) -> list[tuple[str, str, dict[str, dict[str, Summary]]]]:
        """Law, kind of gains, and the summaries of its runs by label and value."""
        return [
            (law, kind, by_label(runs))
            for law, kinds in self.runs.items()
            for kind, runs in kinds.items()
        ]

    @property
    def count(self) -> int:
        """Number of runs of each law with one kind of gains."""
        return len(next(iter(next(iter(self.runs.values())).values())))

    def parts(self) -> list[Part]:
        """The scores, and those of each robot, mix, speed and age."""
        every = sorted(self.summaries, key=lambda each: -each[2][WHOLE][WHOLE].median.value)
        rows, groups = [], []
        for law, kind, found in every:
            whole = found[WHOLE][WHOLE]
            failed = str(whole.failed) if whole.failed else ''
            rows.append([law, kind, _interval(whole.median), _interval(whole.tail), failed])
            medians = [
                f'{summary.median.value:.3f}'
                for label in ('robot', 'mix', 'age')
                for summary in found[label].values()
            ]
            groups.append([law, kind, *medians])
        heads = [value for label in ('robot', 'mix', 'age') for value in every[0][2][label]]
        below = sum(found[WHOLE][WHOLE].below for *_, found in every)
        return [
            *self.head(),
            Table(['law', 'gains', 'score', '5 % tail', 'failed'], rows, 'llrrr'),
            '\nmedian scores',
            Table(['law', 'gains', *heads], groups, 'll' + 'r' * len(heads)),
            *(
                [f'{below} runs are below the limit, which is one of the mean over long runs']
                if below
                else []
            ),
        ]

    def head(self) -> list[str]:
        """What it is the result of, in two lines."""
        protocol = self.protocol
        seeds = 'public samples' if self.phrase is None else f'samples of "{self.phrase}"'
        what = f'protocol {protocol.version} ({protocol.digest[:12]}), {seeds}'
        quick = ' A first look (--quick), not the protocol.' if protocol.quick else ''
        return [
            f'{what}, {self.count} runs of each law with its default and its tuned gains.{quick}',
            'score: least error of any controller at the chattering of the run, over its true '
            'error; median of the runs, and the 5 % tail, with 95 % intervals',
        ]

    def as_data(self) -> dict[str, Any]:
        """All of it as plain data, for JSON."""
        laws: dict[str, Any] = {}
        sources = self.laws.sources()
        for law, kind, found in self.summaries:
            entry = laws.setdefault(law, {'source': sources[law]})
            entry[kind] = {
                label: {value: as_data(each) for value, each in of_label.items()}
                for label, of_label in found.items()
            }
            if kind == TUNED:
                entry['gains'] = {
                    robot: {'within_effort': each.within, **each.values}
                    for robot, each in self.gains[law].items()
                }
        facts = software()
        return {
            'format': FORMAT,
            'protocol': facts_of(self.protocol, self.phrase),
            'suite': version(),
            'laws': laws,
            'runs_sha256': digest(self.runs),
            'machine': {key: facts[key] for key in facts if key not in ('version', 'revision')},
            'seconds': round(self.seconds, 1),
        }

    def json(self) -> str:
        """The same as text."""
        return json.dumps(self.as_data(), indent=1) + '\n'


def facts_of(protocol: Protocol, phrase: str | None) -> dict[str, Any]:
    """What a score says of its protocol."""
    return {
        'name': protocol.name,
        'version': protocol.version,
        'sha256': protocol.digest,
        'quick': protocol.quick,
        'phrase': phrase,
        'seed': protocol.seed,
    }


def read(path: Path) -> dict[str, Any]:
    """Read the score of a benchmark.

    Raises:
        InputError: it is none.
    """
    try:
        found = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f'cannot read {path}: {error.strerror}') from None
    except ValueError:
        found = None
    if not isinstance(found, dict) or found.get('format') != FORMAT:
        raise InputError(f'{path} is not the score of a benchmark of this version')
    return found


def differences(given: Mapping[str, Any], ours: Mapping[str, Any]) -> list[str]:
    """What differs between two scores, but for the machine and the time, a line each."""
    parts = ({k: v for k, v in each.items() if k not in OF_MACHINE} for each in (given, ours))
    return [*_differences('', *parts)]


def _differences(where: str, given: Any, ours: Any) -> Iterator[str]:
    if isinstance(given, dict) and isinstance(ours, dict):
        for key in {**given, **ours}:
            below = f'{where}.{key}' if where else key
            if key not in given or key not in ours:
                yield f'{printable(below)} is only {"here" if key not in given else "in the file"}'
            else:
                yield from _differences(below, given[key], ours[key])
    elif given != ours:
        yield f'{printable(where)}: {printable(given)} in the file, {ours} here'


def _interval(estimate: Any) -> str:
    return f'{estimate.value:.3f} [{estimate.low:.3f}, {estimate.high:.3f}]'
