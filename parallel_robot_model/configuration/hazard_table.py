"""What the hazards of a loop make of its samples, counted from the start of its motion.

One table for simulation, nodes and bags: which states are told and answered, how late, and which
references are known.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from hashlib import blake2b
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.configuration.hazards import parse
from parallel_robot_model.configuration.loop import LoopParameters

LATE = {'states_late': 1, 'states_ahead': -1}  # sign of how late states are
UNPUBLISHED = {'states_lost', 'controller_paused', 'controller_restarted', 'plant_paused'}
EARLY = 1e-6  # of a period, by which a time may be missed by rounding
AT_ONCE = 1000  # samples, of which one that is published is looked for together
AROUND = 2  # samples without a hazard, after which none is looked back at
REFUSED = 0.1  # s, for which all states are refused before that is a fault
# Codes of the faults that states lead to; none comes first.
REASONS = ('', 'states_invalid', 'states_late', 'states_ahead')
INVALID = REASONS.index('states_invalid')


class Reception(NamedTuple):
    """What is received of samples, one row for each, shape (N,); of one sample, numbers."""

    published: NDArray[np.bool_]  # whether there is a message of the state
    answered: NDArray[np.bool_]  # whether a controller answers it
    shown: NDArray[np.bool_]  # whether the pose is told
    late: NDArray[np.int64]  # samples since that which is told; negative if its stamp is ahead
    newest: NDArray[np.int64]  # sample of the newest reference that the controller knows
    refused: NDArray[np.int64]  # number in REASONS: why a controller refuses the state


class HazardTable:
    """The hazards of a loop by sample; between two of its edges, all samples are alike.

    But for states that are dropped at random.
    """

    def __init__(self, loop: LoopParameters, state_age: float) -> None:
        """Make the table; `state_age`: age of a state from which on it is not answered [s]."""
        period = loop.period
        times = [(each, *each.samples(period)) for each in parse(loop.hazards)]
        late = [
            (begin, end, round(LATE[each.what] * each.size / period))
            for each, begin, end in times
            if each.what in LATE
        ]
        self.on = bool(times)  # whether there are any
        # first sample from which on nothing differs from a loop without hazards
        ends = [end for _, _, end in times] + [end + abs(shift) for _, end, shift in late]
        self.undisturbed_from = max(ends, default=-AROUND) + AROUND
        # samples from which on the next state comes after a call of ``~/clear_fault``
        self.clears = sorted(begin for each, begin, _ in times if each.what == 'clear_fault')
        # samples from which on the next state is the first that a new controller hears
        self.renewals = sorted(
            end for each, _, end in times if each.what == 'controller_restarted'
        )
        self._dropped = [
            (begin, end, each.size, f'{loop.seed} {begin} ')
            for each, begin, end in times
            if each.what == 'states_dropped'
        ]
        self._shifts = np.array([0, *(shift for _, _, shift in late)])
        edges = {0, *(k for _, *both in times for k in both)}
        self._edges = first = np.array(sorted(edges.union(b + max(n, 0) for b, _, n in late)))

        def during(*kinds: str) -> NDArray[np.bool_]:
            acting = [(first >= b) & (first < e) for each, b, e in times if each.what in kinds]
            return np.any([np.zeros(len(first), bool), *acting], axis=0)

        waits, shift = during(), np.zeros(len(first), np.int64)
        for begin, end, samples in late:
            shift[(first >= begin) & (first < end)] += samples
            waits |= (first >= begin) & (first < min(begin + samples, end))
        refused = np.where(shift > 0, *map(REASONS.index, LATE))
        refused[np.abs(shift) <= state_age / period + EARLY] = 0
        refused[during('velocity_nan')] = INVALID
        told, lost = ~(waits | during(*UNPUBLISHED)), during('references_lost')
        before = np.maximum.accumulate(np.where(np.diff(lost, prepend=False) & lost, first, 0)) - 1
        newest = np.where(lost, before, sys.maxsize)
        shown = ~during('plant_paused')
        self._stretches = Reception(told, told & (refused == 0), shown, shift, newest, refused)
        # samples at which all states have been refused for too long, and the number of why
        self.lost = dict(self._losses(round(REFUSED / period)))

    def reception(self, samples: Any) -> Reception:
        """What is received of samples, shape (N,), or of one."""
        least = samples if isinstance(samples, int) else np.min(samples, initial=sys.maxsize)
        if least >= self.undisturbed_from:
            all_, none = samples >= self.undisturbed_from, 0 * samples
            return Reception(all_, all_, all_, none, samples, none)
        samples = np.asarray(samples)
        rows = np.searchsorted(self._edges, samples, side='right') - 1
        found = Reception(*(column[rows] for column in self._stretches))
        sent = np.ones(samples.shape, bool)
        for begin, end, share, draws in self._dropped:
            drawn = (begin <= samples) & (samples < end)
            each = samples[drawn].tolist() if share < 1.0 else ()
            some = [_drawn(f'{draws}{k}') >= share for k in each] or False
            sent[drawn] &= np.array(some, bool)
        return found._replace(
            published=found.published & sent,
            answered=found.answered & sent,
            newest=np.maximum(np.minimum(found.newest, samples), 0),
        )

    def sample_of(self, index: int, before: int) -> int:
        """Sample at which the state that was measured at `index` is told, after another one."""
        near = index + self._shifts
        known = near[(near > before) & (near - self.reception(near).late == index)]
        return min(known.tolist(), default=index)

    def last_told(self, last: int) -> int:
        """Sample that the last state message tells, up to a sample; 0 if there is none."""
        told = next((k for k in range(last, 0, -1) if self.reception(k).published), 0)
        return told - int(self.reception(told).late)

    def due(self, count: int, every: int) -> NDArray[np.int64]:
        """Samples at which what is told every few states is due: the first one of each interval.

        Args:
            count: Number of samples.
            every: Samples from one interval to the next.
        """
        reception = self.reception(np.arange(count))
        samples = np.flatnonzero(reception.answered)
        index = samples - reception.late[samples]
        interval = index // every
        # a new controller knows of no interval before
        renewed = np.diff(np.searchsorted(self.renewals, index, side='right'), prepend=0) > 0
        enters = np.diff(interval, prepend=interval[:1]) != 0
        return samples[(index % every == 0) | (enters & ~renewed)]

    def _losses(self, patience: int) -> Iterator[tuple[int, int]]:
        """When all states have been refused for too long, and why, once for each reason."""
        reason, since = 0, 0  # of the last states
        of_stretches = zip(
            self._stretches.published, self._stretches.refused.tolist(), strict=True
        )
        for (begin, end), (told, refused) in zip(
            itertools.pairwise(self._edges.tolist()), of_stretches, strict=False
        ):
            if not told:
                continue
            if refused != reason:
                first = self._first_sent(begin, end)
                reason, since = (reason, since) if first is None else (refused, first)
            if refused and refused == reason:
                first = self._first_sent(max(begin, since + patience + 1), end)
                if first is not None:
                    since = sys.maxsize  # told once
                    yield first, reason

    def _first_sent(self, begin: int, end: int) -> int | None:
        """First sample of a stretch whose state is not dropped."""
        while begin < end:
            samples = np.arange(begin, min(end, begin + AT_ONCE))
            if (published := self.reception(samples).published).any():
                return int(samples[published][0])
            begin += AT_ONCE
        return None


def _drawn(text: str) -> float:
    """A number from [0, 1) that follows from a text alone."""
    return int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), 'big') / 2**32
