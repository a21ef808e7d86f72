"""Progress of long work: a bar on a terminal that is removed at the end, nothing in a pipe."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import TypeVar

from parallel_robot.bags.printable_output import as_it_is

Item = TypeVar('Item')

QUIET = 1.0  # s of work before a bar appears
UPDATE_INTERVAL = 0.1  # s between two updates
WIDTH = 30  # characters of the bar
CLEAR = '\r\x1b[K'


class Progress:
    """A progress bar; use as a context manager, so that it is removed at the end."""

    def __init__(self, total: float | None, unit: str = '') -> None:
        """Prepare; `total` is what :meth:`show` counts up to, in a unit; None: nobody knows."""
        self._total = total
        self._unit = f' {unit}' if unit else ''
        self._stream = as_it_is(sys.stderr)
        self._terminal = self._stream.isatty()
        self._next = time.monotonic() + QUIET
        self._drawn = False

    def show(self, done: float, what: str = '') -> None:
        """Draw how much is done, if an update is due."""
        if not self._terminal or time.monotonic() < self._next:
            return
        line = f'{done:.6g}'
        if self._total is not None:
            share = min(1.0, done / self._total) if self._total else 1.0
            line = f'[{"#" * round(WIDTH * share):<{WIDTH}}] {line} of {self._total:.6g}'
        print(f'{CLEAR}{line}{self._unit} {what}', end='', file=self._stream, flush=True)
        self._next = time.monotonic() + UPDATE_INTERVAL
        self._drawn = True

    def __enter__(self) -> Progress:
        """Return the bar."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the bar."""
        if self._drawn:
            print(CLEAR, end='', file=self._stream, flush=True)


def tracked(items: Iterable[Item], total: int | None, unit: str) -> Iterator[Item]:
    """Pass items on and show how many of them are done, of a total if it is known."""
    with Progress(total, unit) as progress:
        for done, item in enumerate(items):
            progress.show(done)
            yield item
