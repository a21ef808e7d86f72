"""Which states were answered, from which references, and how old they were then."""

from __future__ import annotations

import numpy as np

from parallel_robot_control.messages import answers_message
from parallel_robot_control.shared_arrays import AGES, ANSWERS, LOGGED, Shared
from parallel_robot_control.states.state_rhythm import StateRhythm
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.messages import layouts


class AnswerLog:
    """The record that the kernels keep of each answer, collected from time to time.

    Attributes:
        rhythm: How often states come and are skipped, of what was collected.
    """

    def __init__(self, arrays: Shared, period: int) -> None:
        """Prepare the log; `arrays` are shared with the kernels, `period` is in ns."""
        self.rhythm = StateRhythm(period)
        self._arrays = arrays
        self._numbers = arrays.numbers
        self._ages_taken = 0

    @property
    def answered(self) -> int:
        """Number of states that were answered."""
        return int(self._numbers[ANSWERS])

    def zero_command(self) -> bytes:
        """A command of zero torque that answers no state, and is logged as such."""
        row = self._numbers[LOGGED] % AGES
        self._arrays.log[row] = self._arrays.commanded[row] = 0
        self._numbers[LOGGED] += 1
        return layouts.float64_multi_array(len(self._arrays.torques)).template.tobytes()

    def take(self) -> bytes:
        """Message of ``controller/answered``: which states were answered since the last call."""
        count = min(int(self._numbers[LOGGED]), AGES)
        self._numbers[LOGGED] = 0
        self.rhythm.note(self._arrays.log[:count, 0].copy())
        return answers_message(self._arrays.log[:count], self._arrays.commanded[:count])

    def take_ages(self) -> Array:
        """Ages of the states answered since the last call [s]; at most the newest AGES of them."""
        rows = np.arange(max(self._ages_taken, self.answered - AGES), self.answered) % AGES
        self._ages_taken = self.answered
        return self._arrays.ages[rows] / NANOSECONDS
