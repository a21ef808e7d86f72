"""Stretches of a run between changes of its law or of gains."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from parallel_robot.bags.history import History
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.units import NANOSECONDS

GROUPS = ('estimator', 'safety', 'approach', 'controller')  # of the controller, beside its law


class Stretch(NamedTuple):
    """A part of a run with one law and one set of gains.

    Attributes:
        begin: When it begins, since t = 0 [s].
        law: The active law.
        change: What changed at its begin, for people; empty for the first one.
    """

    begin: float
    law: str
    change: str = ''


def of_run(past: History, log: RunLog) -> list[Stretch]:
    """Stretches of a run that was read, see :func:`stretches`."""
    return stretches(past, log.law, log.start_stamp, int(log.stamps[-1]))


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


def laws(found: list[Stretch]) -> tuple[str, ...]:
    """The laws of a run in the order in which they were active first."""
    return tuple(dict.fromkeys(one.law for one in found))


def told(found: list[Stretch]) -> list[str]:
    """A line that says what changed when; none where nothing did."""
    if len(found) == 1:
        return []
    changes = '; '.join(f't = {one.begin:.3f} s: {one.change}' for one in found[1:])
    return [f'changed while it ran, figures of the whole run are of no one law: {changes}']
