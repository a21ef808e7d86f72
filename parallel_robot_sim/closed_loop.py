"""The closed loop as one compiled loop: reference in, complete record out."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.assembly import Control
from parallel_robot_control.cycle import cycle_of
from parallel_robot_control.reference_buffer import reference_row
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.limiting import REFERENCE, When
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import FunctionValue, is_finite, kernel, vector, write_row
from parallel_robot_model.configuration.hazard_table import Reception
from parallel_robot_model.messages.topics import Telemetry
from parallel_robot_sim.configuration import Plant
from parallel_robot_sim.hazards import CommandState, no_command_yet
from parallel_robot_sim.plant import PlantSetup, PlantState, demanded, observe, step
from parallel_robot_sim.timeline import Timeline, timeline_of
from trajectory_gen.trajectory import Reference


class ClosedLoopRun(NamedTuple):
    """Complete record of a run, one row per state, shape (N, n) unless stated otherwise."""

    pose: Array  # true pose, shape (N, m)
    joints: Array  # actuated joints as they are [rad]
    position: Array  # actuated joints as they are measured [rad]
    velocity: Array  # their measured rates [rad/s]
    passive_position: Array  # passive joints [rad], shape (N, p)
    passive_velocity: Array  # their rates [rad/s], shape (N, p)
    effort: Array  # torque applied during the step that ended at the state [N m]
    command: Array  # torque computed from the state [N m]; NaN, as the next, without an answer
    telemetry_rows: Array  # telemetry of the cycles, see `telemetry`, shape (N, T, n)
    fault: NDArray[np.int64]  # fault of the controller at the state, see faults.py, shape (N,)
    active_limits: NDArray[np.int64]  # bits of the limits that acted at the state, shape (N,)
    steps: int  # number of rows that were computed; fewer than N if the plant left its workspace
    plant: PlantState  # state of the plant after the last command
    waiting: CommandState  # what the motors know of the commands after the last row
    sent: Array  # the last command [N m], shape (n,)
    cause: int  # fault whose cause was there at the last state, see Cycle

    @property
    def telemetry(self) -> Telemetry:
        """What is reported of the cycles, each shape (N, n)."""
        return Telemetry(*np.moveaxis(self.telemetry_rows, 1, 0))


TOLD = len(Telemetry._fields)
COLUMNS = ClosedLoopRun._fields[: ClosedLoopRun._fields.index('steps')]


class LoopState(NamedTuple):
    """What one sample hands to the next; attributes as the last ones of a ClosedLoopRun."""

    plant: PlantState
    waiting: CommandState
    sent: Array
    cause: int


def run(
    control: Control,
    plant: Plant,
    reference: Reference,
    period: float,
    complete: bool = True,
    anew: bool = True,
) -> ClosedLoopRun:
    """Run the loop over all samples of a reference.

    Args:
        control: The controller before its first state.
        plant: The plant at its first state.
        reference: Desired motion, one sample per period.
        period: Time between samples [s].
        complete: Whether the record is to be complete; else it has what metrics are computed from:
            positions, efforts, faults and limits.
        anew: Whether the law begins with an empty memory; else it has that of its last cycle.
    """
    timeline = timeline_of(plant, reference, period)
    return run_part(
        control, plant, timeline, initial_state(control, plant, anew), period, 0, complete
    )


def initial_state(control: Control, plant: Plant, anew: bool = True) -> LoopState:
    """State of a loop before its first sample; arguments as of :func:`run`."""
    if anew:
        control.law.reset()
    control.setup.memory.state.value = control.state
    waiting = no_command_yet(len(control.state.fault_position))
    return LoopState(plant.state, waiting, waiting.command, faults.NONE)


def final_state(run: ClosedLoopRun) -> LoopState:
    """State of a loop after the last sample of a part of its run."""
    return LoopState(run.plant, run.waiting, run.sent, run.cause)


def run_part(
    control: Control,
    plant: Plant,
    timeline: Timeline,
    state: LoopState,
    period: float,
    first: int = 0,
    complete: bool = True,
    refused: list[tuple[int, int]] | None = None,
) -> ClosedLoopRun:
    """Run the loop over samples that follow one another: all, or those after another part.

    Args:
        control: The controller; its law has the memory of the samples before.
        plant: The plant.
        timeline: The course of these samples.
        state: State before them, of :func:`initial_state` or :func:`final_state`.
        period: Time between samples [s].
        first: Index of the first of them.
        complete: As of :func:`run`.
        refused: Is given the rows at which a fault is not cleared, and the fault that is why.
    """
    loop = partial(
        compiled_loop,
        cycle_of(control.setup),
        FunctionValue(step, plant.setup, state.plant, state.plant.torque, period),
        control.setup,
        plant.setup,
        timeline.reference,
        timeline.reception,
        timeline.dt,
    )
    parts: list[ClosedLoopRun] = []
    for row, stop in itertools.pairwise([*timeline.cuts, len(timeline.dt)]):
        timeline.apply_events(row, control, state.plant.torque, state.cause)
        fault = control.setup.memory.state.fault
        if refused is not None and row in timeline.clears and fault != faults.NONE:
            refused.append((row, state.cause or fault))
        part: ClosedLoopRun = loop(state, complete, period, first, row, stop)
        parts.append(part)
        state = final_state(part)
        if part.steps < stop - row:
            break
    record = parts[0] if len(parts) == 1 else _concatenated(parts)
    record.active_limits[timeline.overdue[: len(record.active_limits)]] |= REFERENCE
    return record


def head(run: ClosedLoopRun) -> ClosedLoopRun:
    """The rows of a run that were computed."""
    return run._replace(**{name: getattr(run, name)[: run.steps] for name in COLUMNS})


def _concatenated(parts: list[ClosedLoopRun]) -> ClosedLoopRun:
    """Runs that follow one another as one; its state is that of the last one."""
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS
    }
    return parts[-1]._replace(**columns, steps=sum(part.steps for part in parts))


@kernel
def compiled_loop(
    run_cycle: Any,
    step: Any,
    control: Any,
    plant: PlantSetup,
    reference: Reference,
    reception: Reception,
    since: Array,
    initial: LoopState,
    complete: bool,
    period: float,
    origin: int,
    begun: int,
    stop: int,
) -> ClosedLoopRun:
    """The loop of :func:`run_part` over some rows, with its kernels as FunctionValue.

    Row 0 of reference, `reception` and `since` is the sample `origin`; `since`: time since the
    state that was answered before [s].
    """
    state, waiting, torque, cause = initial
    row = state.torque
    # 1. Arrays for all rows; the robot gives the number of passive joints.
    first = plant.measure(plant.robot, state.coordinates, state.rate)
    count = stop - begun
    more = count if complete else 0
    joints = np.empty((count, len(row)))
    position = np.empty((count, len(row)))
    efforts = np.empty((count, len(row)))
    pose = np.empty((more, len(first.pose)))
    velocity = np.empty((more, len(row)))
    passive_position = np.empty((more, len(first.passive_position)))
    passive_velocity = np.empty((more, len(first.passive_velocity)))
    command = np.full((more, len(row)), np.nan)
    telemetry = np.full((more, TOLD, len(row)), np.nan)
    fault = np.empty(count, np.int64)
    active_limits = np.zeros(count, np.int64)
    steps = count
    for k in range(count):
        place = begun + k
        sample = origin + place
        # 2. Measurement of the state; a robot that has left its workspace ends there.
        answered, late, dt, is_published = True, 0, period, True
        if plant.hazards.on:
            is_published, answered, late = (
                reception.published[place],
                reception.answered[place],
                reception.late[place],
            )
            dt = since[place]
        seen = observe(plant, state, sample, period, is_published)
        true = seen.true
        if not is_finite(true.velocity):
            steps = k
            break
        write_row(joints, k, true.position)
        write_row(position, k, seen.position)
        write_row(efforts, k, state.torque)
        if complete:
            write_row(pose, k, true.pose)
            write_row(velocity, k, seen.velocity)
            write_row(passive_position, k, true.passive_position)
            write_row(passive_velocity, k, true.passive_velocity)
        # 3. The torque computed from it.
        if answered:
            desired = reference_row(reference, place - late, row)
            when = When(sample - late, plant.imperfections.age, dt)
            cycle = run_cycle(control, desired, seen.position, seen.velocity, seen.effort, when)
            torque, cause = cycle.torque, cycle.cause
            write_row(active_limits, k, cycle.active_limits)
            if complete:
                write_row(command, k, torque)
                write_row(telemetry, k, vector(cycle.telemetry))
        write_row(fault, k, control.memory.state.fault)
        # 4. It acts until the next state.
        demand, waiting = demanded(plant, state, waiting, torque, answered, sample)
        state = step(plant, state, demand, period)
    return ClosedLoopRun(
        pose,
        joints,
        position,
        velocity,
        passive_position,
        passive_velocity,
        efforts,
        command,
        telemetry,
        fault,
        active_limits,
        steps,
        state,
        waiting,
        torque,
        cause,
    )
