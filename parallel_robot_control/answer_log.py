"""Which states were answered, from which references, and how old they were then."""

from __future__ import annotations

import numpy as np

from parallel_robot_base import layouts
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control.messages import answers_message
from parallel_robot_control.shared_arrays import AGES, ANSWERS, LOGGED, SKIPPED, Array, Shared


class AnswerLog:
    """What the kernels note of each answer, taken out now and then."""

    def __init__(self, arrays: Shared) -> None:
        """Prepare; `arrays` are those of the kernels."""
        self._arrays = arrays
        self._numbers = arrays.numbers
        self._ages_taken = 0

    @property
    def answered(self) -> int:
        """How many states were answered."""
        return int(self._numbers[ANSWERS])

    @property
    def skipped(self) -> int:
        """How many states were not, because a newer one was there or they never came."""
        return int(self._numbers[SKIPPED])

    def zero_command(self) -> bytes:
        """A command of zero torque that answers no state; it stands in the log as such."""
        self._arrays.log[self._numbers[LOGGED] % AGES] = 0
        self._numbers[LOGGED] += 1
        return layouts.float64_multi_array(len(self._arrays.torques)).template.tobytes()

    def take(self) -> bytes:
        """Message of ``controller/answered``: which states were answered since the last call."""
        count = min(int(self._numbers[LOGGED]), AGES)
        self._numbers[LOGGED] = 0
        return answers_message(self._arrays.log[:count])

    def take_ages(self) -> Array:
        """Ages of the states answered since the last call, of the newest AGES at most [s]."""
        rows = np.arange(max(self._ages_taken, self.answered - AGES), self.answered) % AGES
        self._ages_taken = self.answered
        return self._arrays.ages[rows] / NANOSECONDS
