"""A long bag window by window: its motions, its timing, and what is known of it by then."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot.analysis import recorded_motions
from parallel_robot.analysis.recorded_motions import MOST_STEPS, PLANNED, PlantWindows, Recorded
from parallel_robot.bags.run.recording import Recording
from parallel_robot_model.common.errors import KinematicsError, ParallelRobotError
from parallel_robot_model.common.units import Array
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.ideal_torque import IdealTorque
from parallel_robot_sim.motions import Motion
from parallel_robot_sim.plant import MUJOCO
from trajectory_gen.configuration import trajectory_of

# The motions of a bag of any length, window by window.


class MotionWindows:
    """The motions of windows that follow each other, as those of the whole bag.

    Of a bag whose states do not tell the true joints, a plant has to move once more.
    """

    def __init__(self, count: int, plant: PlantWindows | None = None) -> None:
        """Prepare.

        Args:
            count: How many states the bag has, about.
            plant: Tells the true motion, if the states do not.
        """
        self._count = count
        self._ideal: _Ideal | None = None
        self._motions, self._plant = recorded_motions.InParts(plant), plant
        self._end = math.nan  # s, time of the last state that was followed
        # why the motion was followed up to a window alone; empty when it was not cut off
        self.cut = ''

    def of(self, found: Recording) -> Recorded | None:
        """The motions of the next window; None where it has none, as after a cut.

        Raises:
            InputError: the robot of the bag cannot be built.
            KinematicsError: the first sample of the bag has no pose.
            WholeNeededError: the plant cannot move once more in windows.
        """
        log = found.log
        if self.cut or not log.referenced.any():
            return None
        try:
            part = self._motions.of(log, found.history, whole=False)
        except KinematicsError as error:
            if math.isnan(self._end):
                raise
            self.cut = f'evaluated up to t = {self._end:.3f} s: {error}'
            return None
        true = part.motions.true
        if true is not None:
            self._ideal = self._ideal or _Ideal(log.config, self._count)
            part = part._replace(motions=part.motions._replace(ideal=self._ideal.of(true)))
        self._end, self.cut = float(part.log.time[-1]), part.cut
        return part

    def check(self) -> None:
        """Refuse a plant that was another one than that of the bag, at its end.

        Raises:
            WholeNeededError: it was.
        """
        if self._plant is not None:
            self._plant.check()


class _Ideal:
    """The ideal torque at the samples of a true motion, as long as it is the planned one."""

    def __init__(self, values: Mapping[str, Any], count: int) -> None:
        """Prepare; `count`: how many samples it has, about."""
        self._first = self._samples = 0
        self._known = False
        try:
            configuration, self._trajectory = configure_plant(values), trajectory_of(values)
            self._period = configuration.loop.period
            if (configuration.loop.last_index or 0) < count - 1:  # it had no end
                duration = (count - 1) * self._period
                configuration = configuration.with_parts(
                    loop=configuration.loop._replace(duration=duration)
                )
            self._last = configuration.loop.last_index or 0
            self._torque = IdealTorque(self._trajectory, configuration)
            self._known = configuration.plant.engine != MUJOCO
        except ParallelRobotError:
            return

    def of(self, true: Motion) -> Array | None:
        """Torques at the next samples [N m], shape (N, n); None where they are not known."""
        if not self._known:
            return None
        rows = np.rint(true.time / self._period).astype(np.int64)
        first, last = self._first, int(rows[-1])
        self._samples += len(rows)
        self._known = first <= rows[0] <= last <= min(MOST_STEPS * self._samples, self._last)
        if not self._known:
            return None
        try:
            planned = self._trajectory.sample(self._period * rows).position
            self._known = bool(np.abs(planned - true.reference_position).max() <= PLANNED)
            self._first = last + 1
            return self._torque.between(first, last + 1)[rows - first] if self._known else None
        except ParallelRobotError:
            self._known = False
            return None
