"""Bodies that MuJoCo moves under torques."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import optional
from parallel_robot_model.common.units import Array

STEP = 1e-4  # s, of the integration


class MujocoBodies:
    """A compiled model whose actuated joints are moved by torques."""

    def __init__(self, model: Any, actuated: Any) -> None:
        """Take the model.

        Args:
            model: It has a hinge or a slide for each of its freedoms.
            actuated: Indices of the actuated joints.
        """
        self._engine = optional('mujoco')
        self._model, self._actuated = model, actuated
        self._data = self._engine.MjData(model)

    def advance(self, torque: Array, period: float) -> None:
        """Hold torques [N m], shape (n,), over a period [s], a multiple of the step."""
        self._data.qfrc_applied[self._actuated] = torque
        self._step(period)

    def advance_under(self, load: Callable[[Array, float], Array], period: float) -> None:
        """Advance by a period [s], a multiple of the step, under torques that change within it.

        Args:
            load: Function of the rates of the actuated joints [rad/s], shape (n,), and the time
                since the start [s] that returns their torques [N m], shape (n,).
            period: How long.
        """

        def control(_: Any, data: Any) -> None:
            velocity = data.qvel[self._actuated]
            data.qfrc_applied[self._actuated] = load(velocity, data.time)

        self._engine.set_mjcb_control(control)  # called by the integrator at each of its stages
        try:
            self._step(period)
        finally:
            self._engine.set_mjcb_control(None)

    def _put(self, positions: Any) -> None:
        """Put all joints somewhere [rad or m]."""
        self._data.qpos = np.asarray(positions)
        self._engine.mj_forward(self._model, self._data)

    def _step(self, period: float) -> None:
        steps = round(period / self._model.opt.timestep)
        self._engine.mj_step(self._model, self._data, steps)
        self._engine.mj_kinematics(self._model, self._data)
