"""Joint states that a controller does not answer: by which clocks, and what was wrong lately."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from parallel_robot_control.safety import faults
from parallel_robot_control.states import state_warnings
from parallel_robot_model.common.units import NANOSECONDS

LATELY = 0.2  # s, since a state was refused, in which that is told


class RefusedStates:
    """Judges stamps by the clocks of this machine, and keeps why a state was refused last."""

    def __init__(self, limit: float, ros_time: Callable[[], int]) -> None:
        """Begin with none.

        Args:
            limit: How old a state may be, and how far its stamp may be ahead [s].
            ros_time: Gives the time of ROS, perhaps a simulated one [ns].
        """
        self._limit, self._ros_time = limit, ros_time
        self._clock_offset = time.time_ns() - time.monotonic_ns()
        self._last, self._noted_at = (faults.NONE, 0), -math.inf

    def now(self) -> int:
        """Time against which the age of a state is checked [ns].

        The earlier of two clocks: stamps go on as before when the system clock is set.
        """
        return min(time.time_ns(), self._clock_offset + time.monotonic_ns())

    def judge(self, stamp: int) -> int:
        """Why a state with this stamp [ns] is refused: it waited in a queue, or is ahead."""
        clocks, limit = self._clocks(), round(self._limit * NANOSECONDS)
        if min(clocks) - stamp > limit:
            return self.note(faults.STATES_LATE, min(clocks) - stamp)
        if max(clocks) - stamp < -limit:
            return self.note(faults.STATES_AHEAD, stamp - max(clocks))
        return faults.NONE

    def note(self, wrong: int, difference: int = 0) -> int:
        """Note why a state is refused, and by how much its stamp is wrong [ns]."""
        self._last, self._noted_at = (wrong, difference), time.monotonic()
        return wrong

    def told(self, stamp: int, problem: str, joints: tuple[str, ...]) -> dict[str, str]:
        """What is wrong with the states, for people; see SuiteNode.doubts.

        Args:
            stamp: Stamp of the state that was answered last [ns].
            problem: What was wrong with the last message that was not understood.
            joints: Names of the joints.
        """
        doubts, ahead = {}, stamp - max(self._clocks())
        if time.monotonic() - self._noted_at < LATELY:
            wrong, difference = self._last
            if wrong == faults.STATES_AHEAD:
                ahead = difference
            elif wrong == faults.STATES_LATE:
                doubts['age'] = state_warnings.of_age(difference, self._limit)
            else:
                doubts['numbers'] = state_warnings.of_numbers(problem, joints)
        return doubts | {'ahead': state_warnings.of_clock(ahead)}

    def _clocks(self) -> tuple[int, int, int]:
        """Present times that a stamp may be of [ns]."""
        return time.time_ns(), self._clock_offset + time.monotonic_ns(), self._ros_time()
