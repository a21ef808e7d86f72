"""When hazards act: which states are told and how late, which references are known."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from parallel_robot_model.configuration.hazards import Hazard

SIGNS = {'states_late': (1,), 'states_ahead': (-1,)}
EARLY = 1e-6  # of a period, by which a time may be missed by rounding
UNTOLD = {'states_lost', 'controller_paused', 'controller_restarted', 'plant_paused'}


REFUSED = 0.1  # s, for which all states are refused before that is a fault


class HazardTimes:
    """The hazards of a loop by sample, counted from the start of its motion.

    Attributes:
        clears: Samples from which on the next state comes after a call of ``~/clear_fault``.
        renewals: Samples from which on the next state is the first that a new controller hears.
    """

    def __init__(self, hazards: Sequence[Hazard], period: float, state_age: float) -> None:
        """Take the hazards.

        Args:
            hazards: The hazards.
            period: Of the samples [s].
            state_age: Age of a state from which on it is not answered [s].
        """
        times = [(hazard, *hazard.samples(period)) for hazard in hazards]
        self._untold = [(begin, end) for each, begin, end in times if each.what in UNTOLD]
        self._paused = [(begin, end) for each, begin, end in times if each.what == 'plant_paused']
        self._invalid = [(begin, end) for each, begin, end in times if each.what == 'velocity_nan']
        self._lost = [(begin, end) for each, begin, end in times if each.what == 'references_lost']
        self._late = [
            (begin, end, round(sign * each.size / period))
            for each, begin, end in times
            for sign in SIGNS.get(each.what, ())
        ]
        self.clears = sorted(begin for each, begin, _ in times if each.what == 'clear_fault')
        self.renewals = sorted(
            end for each, _, end in times if each.what == 'controller_restarted'
        )
        self._oldest, self._patience = state_age / period + EARLY, round(REFUSED / period)
        self._losses: dict[int, str] = {}  # sample to the reason
        self._looked_at, self._spell = 0, ('', 0)  # samples; reason, and since which

    def is_told(self, sample: int) -> bool:
        """Whether there is a state message at a sample; one that is late is not there at first."""
        waits = any(begin <= sample < min(begin + late, end) for begin, end, late in self._late)
        return not (waits or _within(sample, self._untold))

    def is_answered(self, sample: int) -> bool:
        """Whether a controller answers the state at a sample."""
        return self.is_told(sample) and not self.refusal(sample)

    def refusal(self, sample: int) -> str:
        """Code of the fault that states as that at a sample lead to; empty for none."""
        late = self.late(sample)
        if _within(sample, self._invalid):
            return 'states_invalid'
        if abs(late) > self._oldest:
            return 'states_late' if late > 0 else 'states_ahead'
        return ''

    def loss(self, sample: int) -> str:
        """The same where it is a fault at a sample: all states have been refused for too long."""
        for k in range(self._looked_at, sample + 1):
            if not self.is_told(k):
                continue
            reason, since = self.refusal(k), self._spell[1]
            if reason != self._spell[0]:
                self._spell = reason, k
            elif reason and k - since > self._patience:
                self._losses[k] = reason
                self._spell = reason, sys.maxsize  # told once
        self._looked_at = max(self._looked_at, sample + 1)
        return self._losses.get(sample, '')

    def sample_of(self, index: int, before: int) -> int:
        """Sample at which the state that was measured at `index` is told, after another one."""
        candidates = (index + late for late in (0, *(late for _, _, late in self._late)))
        known = [k for k in candidates if k > before and k - self.late(k) == index]
        return min(known, default=index)

    def is_shown(self, sample: int) -> bool:
        """Whether the pose at a sample is told."""
        return not _within(sample, self._paused)

    def late(self, sample: int) -> int:
        """Samples since that which is told at a sample; negative if its stamp is ahead."""
        return sum(late for begin, end, late in self._late if begin <= sample < end)

    def last_told(self, last: int) -> int:
        """Sample that the last state message tells, up to a sample; 0 if there is none."""
        told = next(filter(self.is_told, range(last, 0, -1)), 0)
        return told - self.late(told)

    def due(self, count: int, every: int) -> list[int]:
        """Samples at which what is told every few states is due: the first one of each interval.

        Args:
            count: Number of samples.
            every: Samples from one interval to the next.
        """
        samples, before = [], None
        for sample in filter(self.is_answered, range(count)):
            index = sample - self.late(sample)
            if before is not None and any(before < each <= index for each in self.renewals):
                before = None  # a new controller knows of no interval before
            if index % every == 0 or (before is not None and index // every != before // every):
                samples.append(sample)
            before = index
        return samples

    def newest_reference(self, sample: int) -> int:
        """Sample of the newest reference up to a sample that the controller knows."""
        newest, before = sample, sample + 1
        while newest < before:  # the one before a loss may be lost, too
            before = newest
            for begin, end in self._lost:
                if begin <= newest < end:
                    newest = begin - 1
        return max(0, newest)


def _within(sample: int, times: Sequence[tuple[int, int]]) -> bool:
    return any(begin <= sample < end for begin, end in times)
