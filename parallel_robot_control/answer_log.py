"""Which states were answered, from which references, and how old they were then."""

from __future__ import annotations

import numpy as np

from parallel_robot_base import layouts
from parallel_robot_base.arrays import Array
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control.messages import answers_message
from parallel_robot_control.shared_arrays import AGES, ANSWERS, LOGGED, SKIPPED, Shared


class AnswerLog:
    """The record that the kernels keep of each answer, collected from time to time."""

    def __init__(self, arrays: Shared) -> None:
        """Prepare the log; `arrays` are shared with the kernels."""
        self._arrays = arrays
        self._numbers = arrays.numbers
        self._ages_taken = 0

    @property
    def answered(self) -> int:
        """Number of states that were answered."""
        return int(self._numbers[ANSWERS])

    @property
    def skipped(self) -> int:
        """Number of states not answered, because a newer one was there or they never arrived."""
        return int(self._numbers[SKIPPED])

    def zero_command(self) -> bytes:
        """A command of zero torque that answers no state, and is logged as such."""
        self._arrays.log[self._numbers[LOGGED] % AGES] = 0
        self._numbers[LOGGED] += 1
        return layouts.float64_multi_array(len(self._arrays.torques)).template.tobytes()

    def take(self) -> bytes:
        """Message of ``controller/answered``: which states were answered since the last call."""
        count = min(int(self._numbers[LOGGED]), AGES)
        self._numbers[LOGGED] = 0
        return answers_message(self._arrays.log[:count])

    def take_ages(self) -> Array:
        """Ages of the states answered since the last call [s]; at most the newest AGES of them."""
        rows = np.arange(max(self._ages_taken, self.answered - AGES), self.answered) % AGES
        self._ages_taken = self.answered
        return self._arrays.ages[rows] / NANOSECONDS
