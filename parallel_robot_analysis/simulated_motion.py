"""Joints of a simulation, as the metrics take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_sim.messages import told_effort
from parallel_robot_sim.simulation import Simulation


class SimulatedMotion(NamedTuple):
    """Joints of a simulation, of which metrics are computed; see metrics.Motion.

    Attributes:
        time: Since t = 0 [s], shape (N,).
        position: Actuated joints [rad], shape (N, n).
        reference_position: Their desired positions [rad], shape (N, n).
        effort: Torques [N m], shape (N, n).
    """

    time: np.ndarray
    position: np.ndarray
    reference_position: np.ndarray
    effort: np.ndarray

    @classmethod
    def of(cls, made: Simulation) -> SimulatedMotion:
        """The joints of a simulation as their messages tell them: as old as their stamps say."""
        run, period, heard = made.run, made.experiment.loop.period, made.course.heard
        late, rows = round(made.age / period), np.flatnonzero(heard.answered)
        measured = rows - heard.late[rows]
        return cls(
            period * (measured - late),
            run.position[rows],
            made.desired.position[measured],
            told_effort(run.effort, late)[measured],
        )
