"""A benchmark from its protocol and laws to its score and page."""

from __future__ import annotations

import base64
import html
import json
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis import pictures
from parallel_robot.bags.experiment import software
from parallel_robot.studies.benchmark import protocol as protocols
from parallel_robot.studies.benchmark.judged_runs import (
    SHIPPED,
    TUNED,
    Competitors,
    Gains,
    competitors,
    digest,
    identity,
    run,
    search,
)
from parallel_robot.studies.benchmark.protocol import Protocol
from parallel_robot.studies.benchmark.scores import (
    WHOLE,
    ScoredRun,
    Store,
    Summary,
    as_data,
    by_label,
)
from parallel_robot.studies.sweep.run_chunk import version
from parallel_robot.studies.sweep.summary import cells, html_page
from parallel_robot.studies.sweep.sweep import workers_of
from parallel_robot.studies.sweep.workers import Workers
from parallel_robot_control.laws import title as title_of
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.options import named, optional_path, path
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.configuration.config import Place

# The result of a benchmark: as tables, as JSON, and what differs between two.

SCORE = 'score.json'
FORMAT = 'parallel_robot benchmark score 1'
OF_MACHINE = ('machine', 'seconds')  # what may differ between two of the same benchmark
MOST_DIFFERENCES = 10  # that are told


@dataclass(frozen=True, repr=False)
class Scores(ShownResult):
    """The scores of a benchmark."""

    protocol: Protocol
    phrase: str | None  # the phrase from which its samples were drawn; None for the public ones
    laws: Competitors
    gains: Gains  # their tuned gains by law and robot
    runs: Mapping[str, Mapping[str, list[ScoredRun]]]  # law, and 'default' or 'tuned', to its runs
    seconds: float  # how long it took [s]
    out: Path  # its directory

    def file_lines(self) -> list[str]:
        """Its files."""
        return [f'score   {self.out / SCORE}', f'page    {self.out / "page.html"} (.pdf)']

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


# The page of a benchmark, as HTML and PDF: scores with their intervals, and by condition.

WIDTH, LINE, MARGIN = 11.0, 0.26, 2.2  # in; LINE of a law with one kind of gains
LABELS = ('robot', 'mix', 'age', 'speed')
COLOURS = {TUNED: '#1f5a8f'}
PLAIN = '#8a8a8a'


def files(scores: Scores) -> dict[str, bytes]:
    """The page by name of its file."""
    found = pictures.encoded(_figure(scores), ('png', 'pdf'))
    return {
        'page.html': _html(scores, found['png']).encode(),
        'page.pdf': found['pdf'],
    }


def _html(scores: Scores, picture: bytes) -> str:
    parts = [f'<p>{html.escape(line)}</p>' for line in scores.head()]
    text = base64.b64encode(picture).decode()
    parts.append(f'<img alt="Scores of the laws" src="data:image/png;base64,{text}">')
    for part in [*scores.parts()[len(scores.head()) :], *_by_robot(scores)]:
        if isinstance(part, Table):
            rows = [('th', part.head), *(('td', row) for row in part.rows)]
            lines = (cells(row, tag) for tag, row in rows)
            parts.append('<table>' + '\n'.join(lines) + '</table>')
        else:
            parts.append(f'<h2>{html.escape(part.strip())}</h2>')
    return html_page('Benchmark', parts)


def _by_robot(scores: Scores) -> list[Any]:
    """What laws spend on each robot."""
    heads = ['law', 'gains', 'score', '5 % tail', 'chattering', 'torque', 'energy [J]']
    tables: dict[str, list[list[str]]] = {}
    for law, kind, found in scores.summaries:
        for robot, each in found['robot'].items():
            spent = [f'{value:.4g}' for value in (each.chattering, each.torque, each.energy)]
            figures = [f'{each.median.value:.3f}', f'{each.tail.value:.3f}', *spent]
            tables.setdefault(robot, []).append([law, kind, *figures])
    units = {robot.name: robot.unit for robot in scores.protocol.robots}
    parts: list[Any] = []
    for robot, rows in tables.items():
        unit = units[robot]
        named = [
            f'{head} [{unit}]' if head in ('chattering', 'torque') else head for head in heads
        ]
        parts += [robot, Table(named, rows, 'llrrrrr')]
    return parts


def _figure(scores: Scores) -> Any:
    """Scores with their intervals at the left, medians by condition at the right."""
    every = sorted(scores.summaries, key=lambda each: each[2][WHOLE][WHOLE].median.value)
    height = MARGIN + LINE * len(every)
    figure = pictures.new((WIDTH, height))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    names = [f'{title_of(law)}, {kind}' for law, kind, _ in every]
    for place, (_, kind, found) in enumerate(every):
        whole = found[WHOLE][WHOLE]
        colour = COLOURS.get(kind, PLAIN)
        left.plot(
            [whole.median.low, whole.median.high], [place, place], color=colour, lw=3, alpha=0.4
        )
        left.plot(whole.median.value, place, 'o', color=colour, ms=6)
        left.plot(whole.tail.value, place, '|', color=colour, ms=9)
    left.set_yticks(range(len(every)), names, fontsize=8)
    left.set_ylim(-0.6, len(every) - 0.4)
    left.set_xlim(0.0, 1.0)
    left.axvline(1.0, color='black', lw=1.6, ls=(0, (1, 1)))
    left.set_xlabel('score; bar: 95 % interval, |: 5 % tail')
    left.grid(axis='x', alpha=0.3)
    _draw_medians(right, [found for *_, found in every])
    figure.suptitle(scores.head()[0], fontsize=9)
    return figure


def _draw_medians(panel: Any, every: list[dict[str, dict[str, Summary]]]) -> None:
    heads = [(label, value) for label in LABELS for value in every[0][label]]
    medians = np.array(
        [[found[label][value].median.value for label, value in heads] for found in every]
    )
    panel.imshow(medians, aspect='auto', origin='lower', cmap='Blues', vmin=0.0, vmax=1.0)
    for (row, column), value in np.ndenumerate(medians):
        colour = 'white' if value > 0.6 else 'black'
        panel.text(column, row, f'{value:.2f}', ha='center', va='center', fontsize=7, color=colour)
    names = [f'{label} {value}' if label == 'speed' else value for label, value in heads]
    panel.set_xticks(range(len(heads)), names, rotation=45, ha='right', fontsize=8)
    panel.set_yticks([])
    panel.set_title('median scores', fontsize=9)


def benchmark(
    *laws: Place,
    out: Place,
    quick: bool = False,
    phrase: str | None = None,
    protocol: Place = protocols.DEFAULT,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Scores:
    """Judge laws against the limit by a fixed protocol, as ``parallel_robot benchmark`` does.

    >>> import parallel_robot as pr
    >>> found = pr.benchmark('pid', 'my_law.py', out='runs/scores', quick=True)  # doctest: +SKIP
    >>> scores = found.as_data()['laws'].get('pid')  # doctest: +SKIP
    >>> scores['tuned'].get('all')  # doctest: +SKIP

    Args:
        laws: Name of a law, or the file of one of yours: .py, .so, .fmu.
        out: Directory of the results; new, or that of the same benchmark, which is continued.
        quick: Whether only a first look is wanted, in a minute, which is not the protocol.
        phrase: Words nobody knew before, by which other samples are drawn than those to develop
            on.
        protocol: Name of one in ``config/benchmarks``, or its file.
        workers: Processes; default: one for each core.
        scheduler: Address of a dask scheduler, on whose cluster it runs instead.

    Returns:
        The scores; ``as_data()`` has all of them.

    Raises:
        InputError: something in the arguments is wrong, or the directory is of another benchmark.
        RunError: workers cannot run it, or the disk is full; what is finished is kept.
    """
    make, _ = workers_of(workers, scheduler)
    asked = protocols.read(named('protocol', protocol), quick, phrase)
    judged = competitors([named('law', law) for law in laws])
    return benchmarked(asked, phrase, judged, path('out', out), make)


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
        seconds = time.monotonic() - begin
        scores = Scores(protocol, phrase, laws, gains, runs, seconds, directory)
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

    @property
    def failed(self) -> bool:
        """Whether something differs."""
        return bool(self.differences)

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


def check_score(
    score: Place,
    laws: Sequence[Place] = (),
    *,
    out: Place | None = None,
    protocol: Place = protocols.DEFAULT,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Checked:
    """Run the benchmark of a score again, as ``parallel_robot benchmark --check`` does.

    >>> import parallel_robot as pr
    >>> pr.check_score('runs/scores/score.json', ['my_law.py']).failed  # doctest: +SKIP
    False

    Args:
        score: The file SCORE.json of a benchmark, which is run again to tell whether it is the
            same; LAW: the files of its laws that are not of the suite.
        laws: Files of those of its laws that are not of the suite.
        out: Directory of the results; default: none is kept.
        protocol: Name of one in ``config/benchmarks``, or its file.
        workers: Processes; default: one for each core.
        scheduler: Address of a dask scheduler, on whose cluster it runs instead.

    Raises:
        InputError: it is no score, or the file of a law is missing.
        RunError: workers cannot run it, or the disk is full.
    """
    make, _ = workers_of(workers, scheduler)
    files = [named('law', law) for law in laws]
    with tempfile.TemporaryDirectory() as folder:
        place = optional_path('out', out) or Path(folder) / 'benchmark'
        return _checked(path('score', score), named('protocol', protocol), files, place, make)


def _checked(
    path: Path,
    protocol: str,
    files: Sequence[str],
    directory: Path,
    workers: Callable[[], Workers],
) -> Checked:
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
