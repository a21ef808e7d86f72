"""A run in parts: windows of any length, and stretches of one law."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.columns import Columns
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import joint_table, matching, recording, run_log
from parallel_robot.bags.run.matching import Answers
from parallel_robot.bags.run.recorded_robot import SECONDS
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import EMPTY, RunLog, TopicCount
from parallel_robot_model.common.errors import WholeNeededError, printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import RECORDED

STATES = (
    100_000  # of which the period is the median, at least: that of a recording does not change
)
Result = TypeVar('Result')


class RunWindows:
    """A run in windows; references and commands may be missing."""

    def __init__(self, bag: Path, view: BagView = AS_RECORDED) -> None:
        """Open a bag.

        Args:
            bag: Directory of the bag, or its MCAP file.
            view: What it does not say itself, and which part is wanted.

        Raises:
            BagError: not a bag, or one that is not of a run.
        """
        self._bag, self._view = bag, view
        self._whole: Recording | None = None
        if joint_table.is_table(bag):  # is read at once, and once
            self._whole = recording.read(bag, motion_only=True, view=view)
        # log: the run without its states; history: what happened beside the motion;
        # period: time between two states [s]; 0 where there are no two
        self.log, self.history, self.period = self._evaluated(_begun)

    def evaluated(self, evaluate: Callable[[Iterator[RunLog]], Result]) -> Result:
        """What is made of all windows, or of the run at once where windows are not enough.

        Raises:
            BagError: a window takes too much, or there is no state in the part that is wanted.
        """
        return self._evaluated(lambda windows: evaluate(self._alike(windows)))

    def _evaluated(self, evaluate: Callable[[Iterator[Recording]], Result]) -> Result:
        if self._whole is None:
            try:
                return evaluate(self._recordings())
            except WholeNeededError:
                self._whole = recording.read(self._bag, motion_only=True, view=self._view)
        return evaluate(self._recordings())

    def _recordings(self) -> Iterator[Recording]:
        if self._whole is not None:
            return iter([self._whole])
        return recording.chunks(self._bag, SECONDS, motion_only=True, view=self._view)

    def _alike(self, windows: Iterator[Recording]) -> Iterator[RunLog]:
        kind = None
        for window in windows:
            kind = kind or window.log.kind
            if self._whole is None and window.log.kind != kind:
                raise WholeNeededError('the parts of the bag do not hold the same')
            yield window.log


def _begun(windows: Iterator[Recording]) -> tuple[RunLog, History, float]:
    """The run without its states, what happened beside it, and its period."""
    first: Recording | None = None
    steps, count = [], 0
    for window in windows:
        first = first or window._replace(log=run_log.head(window.log, 0))
        between = np.diff(window.log.time)
        steps.append(between[between > 0.0])
        count += len(between)
        if count >= STATES:
            break
    if first is None:
        raise WholeNeededError('no window has a state')
    known = np.concatenate(steps)
    return first.log, first.history, float(np.median(known)) if len(known) else 0.0


# Warnings of the parts of a bag, each kind once.

NUMBER = re.compile(r'\d+(\.\d+)?(e[+-]?\d+)?')


@dataclass
class _Kind:
    """Lines that differ in nothing but their numbers."""

    first: str
    count: int = 1
    same: bool = True


class AlikeLines:
    """Collects lines; those that differ in nothing but their numbers count as one."""

    def __init__(self) -> None:
        self._kinds: dict[str, _Kind] = {}
        self._bag = Path()
        self._unreferenced, self._since = 0, 0.0  # states without a reference, the first one [s]

    def add(self, lines: Sequence[str]) -> None:
        """Take the lines of a part."""
        for line in lines:
            kind = self._kinds.setdefault(NUMBER.sub('0', line), _Kind(line, 0))
            kind.count += 1
            kind.same &= line == kind.first

    def take(self, bag: Path, log: RunLog) -> None:
        """Take what a window of a bag says of itself."""
        self.add(log.warnings)
        self.count(bag, log)

    def count(self, bag: Path, log: RunLog) -> None:
        """Count the states of a window that have no reference of their time."""
        known = log.referenced.all() or not np.isfinite(log.reference_position).any()
        if known or any(matching.NO_REFERENCE in line for line in log.warnings):
            return
        if not self._unreferenced:
            self._bag, self._since = bag, float(log.time[np.argmin(log.referenced)])
        self._unreferenced += int((~log.referenced).sum())

    @property
    def lines(self) -> tuple[str, ...]:
        """The first line of each kind; where others have other numbers, it says how many."""
        found = [
            kind.first if kind.same else f'{kind.first} (the first of {kind.count} such lines)'
            for kind in self._kinds.values()
        ]
        if self._unreferenced:
            text = matching.unreferenced(self._unreferenced, self._since)
            found.append(f'{self._bag}: {text}')
        return tuple(found)


# A run that was read in windows, as a whole.


class LogColumns:
    """Puts windows of a run together, without the references that its controller used."""

    def __init__(self, bag: Path) -> None:
        self._bag, self._warnings = bag, AlikeLines()
        self._states, self._answers = Columns('the states'), Columns('the commands')
        self._last: RunLog | None = None

    def add(self, log: RunLog) -> None:
        """Take the next window.

        Raises:
            InputError: there is no room for it.
        """
        self._warnings.take(self._bag, log)
        arrays = {key: each for key, each in log._asdict().items() if isinstance(each, np.ndarray)}
        self._answers.add({'command': arrays.pop('command')})
        self._states.add(arrays)
        if log.answers is not None:
            self._answers.add({f'answers.{key}': each for key, each in _rows_of(log.answers)})
        before = self._last
        if before is not None:
            counts = {**before.messages, **log.messages}
            none = TopicCount(0, 0)
            for name in counts:
                one, other = (each.messages.get(name, none) for each in (before, log))
                both = one.count + other.count, one.missing + other.missing
                counts[name] = TopicCount(*both)
            differ = before.efforts_differ if before.efforts_differ.text else log.efforts_differ
            log = log._replace(
                messages=counts,
                has_efforts=before.has_efforts and log.has_efforts,
                efforts_differ=differ,
                answers=log.answers or before.answers,
            )
        self._last = log

    def log(self) -> RunLog:
        """The run, when there was a window."""
        assert self._last is not None
        last, arrays, others = self._last, self._states.arrays(), self._answers.arrays()
        answers = last.answers
        if answers is not None:
            answers = answers._replace(
                **{key: others[f'answers.{key}'] for key, _ in _rows_of(answers)}
            )
        messages = {
            each.name: last.messages[each.name] for each in RECORDED if each.name in last.messages
        }
        return last._replace(
            **arrays,
            command=others['command'],
            messages=messages,
            answers=answers,
            used=None,
            warnings=self._warnings.lines,
        )


def _rows_of(answers: Answers) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays with a row for each answer."""
    names = ('states', 'references', 'acts', 'torque', 'heard')
    return ((name, getattr(answers, name)) for name in names)


# The end of a run, and how many states it has, read in windows.


def run_end(bag: Path, memory: int = MEMORY) -> tuple[RunLog, History, int]:
    """The last state of a run, what happened beside it, and how many states it has.

    Args:
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of a window [bytes].

    Returns:
        The log has the last state of each window.

    Raises:
        BagError: not a bag, or one that is not of a run or takes too much.
    """
    count = 0

    def last(windows: Iterator[Recording]) -> Iterator[Recording]:
        nonlocal count
        for window in windows:
            states = len(window.log.stamps)
            count += states
            yield window._replace(log=run_log.rows(window.log, np.arange(states - 1, states)))

    try:
        found = _gathered(bag, last(recording.chunks(bag, SECONDS, (), memory)))
    except WholeNeededError:
        count = 0
        found = _gathered(bag, last(iter([recording.read(bag, (), memory)])))
    return found.log, found.history, count


def _gathered(bag: Path, windows: Iterator[Recording]) -> Recording:
    """The run of some windows that follow each other: stamps and times of their states."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in ('stamps', 'time')}
    told = AlikeLines()
    first: Recording | None = None
    kind = None
    for window in windows:
        first = first or window._replace(log=run_log.head(window.log, 0))
        kind = kind or window.log.kind
        if window.log.kind != kind:
            raise WholeNeededError('the parts of the bag do not hold the same')
        told.take(bag, window.log)
        for name, found in parts.items():
            found.append(getattr(window.log, name))
    if first is None:
        raise WholeNeededError('no window has a state')
    whole: dict[str, Any] = {
        name: EMPTY for name, value in first.log._asdict().items() if isinstance(value, np.ndarray)
    }
    whole |= {name: np.concatenate(parts.pop(name)) for name in [*parts]}
    log = first.log._replace(**whole, warnings=told.lines, answers=None, used=None)
    return Recording(log, first.history, {})


# Stretches of a run between changes of its law or of gains.

GROUPS = ('estimator', 'safety', 'approach', 'controller')  # of the controller, beside its law


class Stretch(NamedTuple):
    """A part of a run with one law and one set of gains."""

    begin: float  # when it begins, since t = 0 [s]
    law: str  # the active law
    change: str = ''  # what changed at its begin, for people; empty for the first one


def stretches(past: History, law: str, start: int, end: int) -> list[Stretch]:
    """Stretches of a run, one if nothing was changed.

    Args:
        past: What the bag says beside the motion.
        law: The law at the start, where no status tells it.
        start: Stamp of t = 0 [ns].
        end: Stamp of the last state [ns].
    """
    first = next((one.law for one in past.statuses), law)
    found = [Stretch(0.0, first)]
    for stamp, new, gains in sorted(_changes(past, first), key=lambda change: change[0]):
        now = new or found[-1].law
        if now == found[-1].law and not gains:
            continue
        text = ', '.join(filter(None, [f'law {now}' if now != found[-1].law else '', gains]))
        begin = (stamp - start) / NANOSECONDS
        if stamp <= start or begin == found[-1].begin:
            before = found[-1].change if begin > 0.0 else ''
            joined = ', '.join(filter(None, [before, text])) if begin > 0.0 else ''
            found[-1] = Stretch(found[-1].begin, now, joined)
        elif stamp <= end:
            found.append(Stretch(begin, now, text))
    return found


def _changes(past: History, law: str) -> Iterable[tuple[int, str, str]]:
    """Stamps [ns] of changes with the law from there on and the gains that changed, for people."""
    laws = {law}
    for before, status in zip(past.statuses, past.statuses[1:], strict=False):
        laws.add(status.law)
        if status.law != before.law:
            yield status.stamp, status.law, ''
    for change in past.changes:
        gains = {
            key: value
            for key, value in change.values.items()
            if key.partition('.')[0] in (*GROUPS, *laws) and '.' in key
        }
        if gains and change.node.rpartition('/')[2] == 'controller':
            text = ', '.join(f'{key} {printable(value, 40)}' for key, value in gains.items())
            yield change.stamp, '', text


def laws_of(found: list[Stretch]) -> tuple[str, ...]:
    """The laws of a run in the order in which they were active first."""
    return tuple(dict.fromkeys(one.law for one in found))


def stretches_told(found: list[Stretch]) -> list[str]:
    """A line that says what changed when; none where nothing did."""
    if len(found) == 1:
        return []
    changes = '; '.join(f't = {one.begin:.3f} s: {one.change}' for one in found[1:])
    return [f'changed while it ran, figures of the whole run are of no one law: {changes}']
