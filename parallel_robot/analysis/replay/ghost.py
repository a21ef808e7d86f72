"""What another law would ask for on the states of a motion, computed while it goes on.

As a program: compiles the law of the configuration that stands, as JSON, on its standard input.
Compilation holds up all threads of a process, and in another process it holds up nobody.
"""

from __future__ import annotations

import json
import sys

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.assembly import assemble
from parallel_robot_control.batch import States, answer
from parallel_robot_control.configuration import ControlConfiguration, configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller_state import joining
from parallel_robot_control.reference_buffer import RESTART
from parallel_robot_model.common.units import NANOSECONDS, Array


class Ghost:
    """A controller that sees states and references, and whose torques go nowhere."""

    def __init__(self, configuration: ControlConfiguration, age: int = 0) -> None:
        """Prepare a law; it takes over at the first state.

        Args:
            configuration: Of the controller, with the law.
            age: Of a state when the controller gets it, as it knows it [ns].
        """
        self.law = configuration.loop.law
        self._configuration, self._age = configuration, age
        self._last: int | None = None
        row = np.zeros((1, configuration.joints))
        self._begin(row[0])  # and whatever is compiled is compiled now
        stamps = np.array([configuration.loop.period_ns], dtype=np.int64)
        self.answer(stamps, row, row, JointReference(row, row, row), row)
        self._last = None

    def _begin(self, effort: Array) -> None:
        self._control = assemble(self._configuration)
        self._state = joining(self._control.state, effort)

    def answer(
        self,
        stamps: NDArray[np.int64],
        position: Array,
        velocity: Array,
        references: JointReference,
        effort: Array,
    ) -> Array:
        """Torques that the law asks for [N m], shape (N, n).

        Args:
            stamps: Of the next states [ns], increasing, shape (N,).
            position: Measured angles [rad], shape (N, n).
            velocity: Measured rates [rad/s], shape (N, n).
            references: Desired motion when the torques act, each shape (N, n).
            effort: Torques that acted [N m], shape (N, n); where the law begins, it takes over
                from them.
        """
        if not len(stamps):
            return np.empty_like(position)
        loop = self._configuration.loop
        if self._last is None or not 0 < stamps[0] - self._last < RESTART:
            self._begin(effort[0])
            self._last = int(stamps[0]) - loop.period_ns
        states = States(
            np.ascontiguousarray(position),
            np.ascontiguousarray(velocity),
            np.full_like(effort, np.nan),  # those of another law do not obey this one
            np.diff(stamps, prepend=self._last) / NANOSECONDS,
            (stamps + self._age) // loop.period_ns,
            np.full(len(stamps), self._age / NANOSECONDS),
        )
        self._last = int(stamps[-1])
        free = np.full_like(states.position, np.nan)
        references = JointReference(*map(np.ascontiguousarray, references))
        batch = answer(self._control.setup, references, states, free, self._state)
        self._state = batch.state
        torque: Array = batch.torque
        return torque


if __name__ == '__main__':
    Ghost(configure(json.load(sys.stdin)))
