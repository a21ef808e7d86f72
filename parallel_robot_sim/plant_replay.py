"""Replay of the plant under recorded torques: the true motion behind a bag."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import FunctionValue, is_finite, kernel, read_row, write_row
from parallel_robot_model.configuration.fields import neutral
from parallel_robot_model.configuration.hazard_table import Reception
from parallel_robot_sim.configuration import Configuration, assemble_plant
from parallel_robot_sim.hazards import CommandState, no_command_yet
from parallel_robot_sim.plant import (
    PlantSetup,
    PlantState,
    demanded,
    observe,
    step,
    unlimited,
)
from trajectory_gen.trajectory import Reference


class PlantReplay(NamedTuple):
    """What a plant did, one row for each sample."""

    joints: Array  # actuated joints as they were [rad], shape (N, n)
    measured: Array  # the same as measured [rad], shape (N, n)
    # torque of the motors during the step that ended at the sample [N m], shape (N, n)
    effort: Array
    reception: Reception  # which states were published and answered


def under_commands(
    configuration: Configuration, commands: Array, reference: Reference
) -> PlantReplay | None:
    """What a plant did under the commands of a controller that answered in step.

    Args:
        configuration: That of the plant.
        commands: Answers to the states that hazards left to be answered, in order [N m],
            shape (M, n).
        reference: Desired motion, one sample per period, shape (N, n).

    Returns:
        What it did; None where there are not as many commands.

    Raises:
        InputError: the plant cannot be put together.
    """
    plant, period = assemble_plant(configuration), configuration.loop.period
    reception = plant.hazards.reception(np.arange(len(reference.position)))
    rows = np.flatnonzero(reception.answered)
    if not len(rows) - 1 <= len(commands) <= len(rows):  # that to the last state may be missing
        return None
    torque = np.zeros_like(reference.position)
    since = np.searchsorted(rows, np.arange(len(torque)), side='right')
    torque[since > 0] = commands[np.minimum(since[since > 0], len(commands)) - 1]
    joints, seen, effort, _ = _run_under(plant.setup, plant.state, reception, torque, period)
    return PlantReplay(joints, seen, effort, reception)


class UnderCommands:
    """A plant without hazards under commands that come in parts, see :func:`under_commands`."""

    def __init__(self, configuration: Configuration) -> None:
        """Put it together.

        Raises:
            InputError: it cannot be.
        """
        self._plant, self._period = assemble_plant(configuration), configuration.loop.period
        self._state = self._plant.state

    def moved(self, commands: Array) -> tuple[Array, Array, Array]:
        """Move by the next commands, one for each sample [N m], shape (N, n).

        Returns:
            Joints at the samples, and as states tell them [rad], each shape (N, n); fewer where
            they stop to be finite. The torque of the motors there [N m], likewise.
        """
        plant, reception = (
            self._plant.setup,
            self._plant.hazards.reception(np.arange(len(commands))),
        )
        joints, seen, effort, self._state = _run_under(
            plant, self._state, reception, commands, self._period
        )
        return joints, seen, effort


def under_torques(
    configuration: Configuration, effort: Array, reference: Reference
) -> PlantReplay:
    """What a plant did, from the torques of its motors.

    Args:
        configuration: That of the plant.
        effort: Torque of the step that ended at each sample [N m], shape (N, n).
        reference: Desired motion, one sample per period, shape (N, n).

    Raises:
        InputError: the plant cannot be put together.
    """
    ideal = neutral(configuration.imperfections.actuator)._replace(fault_time=0.0)
    plant = assemble_plant(
        configuration.with_parts(
            plant=unlimited(configuration.plant),
            imperfections=configuration.imperfections._replace(actuator=ideal),
        )
    )
    period = configuration.loop.period
    reception = plant.hazards.reception(np.arange(len(reference.position)))
    torque = np.vstack([effort[1:], effort[-1:]])
    joints, seen, effort, _ = _run_under(plant.setup, plant.state, reception, torque, period)
    return PlantReplay(joints, seen, effort, reception)


def _run_under(
    setup: PlantSetup, state: PlantState, reception: Reception, torque: Array, period: float
) -> tuple[Array, Array, Array, PlantState]:
    waiting = no_command_yet(torque.shape[1])
    value = FunctionValue(step, setup, state, state.torque, period)
    states: tuple[Array, Array, Array, PlantState] = _loop(
        value, setup, state, reception.published, reception.answered, waiting, torque, period
    )
    return states


@kernel
def _loop(
    step: Any,
    plant: PlantSetup,
    state: PlantState,
    is_published: NDArray[np.bool_],
    answered: NDArray[np.bool_],
    waiting: CommandState,
    torque: Array,
    period: float,
) -> tuple[Array, Array, Array, PlantState]:
    """Joints, true and measured, torques, and the state then, without a controller."""
    row = state.torque
    joints, seen, effort = np.empty_like(torque), np.empty_like(torque), np.empty_like(torque)
    for k in range(len(torque)):
        now = observe(plant, state, k, period, is_published[k])
        if not is_finite(now.true.velocity):
            return joints[:k], seen[:k], effort[:k], state
        write_row(joints, k, now.true.position)
        write_row(seen, k, now.position)
        write_row(effort, k, state.torque)
        demand, waiting = demanded(plant, state, waiting, read_row(torque, k, row), answered[k], k)
        state = step(plant, state, demand, period)
    return joints, seen, effort, state
