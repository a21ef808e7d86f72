"""The plant as one compiled object: command message in, state message out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.experimental import structref

from parallel_robot_control.messages import joint_row, lay_open
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import is_finite, kernel, read_row, write_row
from parallel_robot_model.messages import cdr, layouts
from parallel_robot_model.messages.layouts import passive_names
from parallel_robot_sim.closed_loop import ClosedLoopRun
from parallel_robot_sim.hazards import Waiting, commanded, told, waited
from parallel_robot_sim.noise_and_delay import sample_at
from parallel_robot_sim.plant import PlantSetup, PlantState, step
from parallel_robot_sim.sensors_actuators import effort_at_stamp, sensed


@structref.register
class PlantCoreType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a PlantCore."""


class PlantCore(structref.StructRefProxy):  # type: ignore[misc]
    """The true robot, its state, and the message for it. Made by :func:`plant_core`."""


FIELDS = (
    'setup', 'period', 'start', 'coordinates', 'rate', 'torque', 'time',
    'silent', 'held', 'command', 'asked', 'stamp', 'position', 'velocity', 'effort',
)  # fmt: skip
structref.define_boxing(PlantCoreType, PlantCore)
structref.define_constructor(PlantCore, PlantCoreType, FIELDS)


@kernel
def plant_core(
    setup: PlantSetup,
    period: float,
    start: PlantState,
    coordinates: Array,
    rate: Array,
    torque: Array,
    time: Array,
    silent: Any,
    held: Array,
    command: Array,
    asked: Array,
    stamp: Any,
    position: Array,
    velocity: Array,
    effort: Array,
) -> Any:
    """Put robot, state and message together; the arrays are shared, not copied.

    Args:
        setup: The robot, its load, its integrator.
        period: Length of a step [s].
        start: The first state; the arrays hold the present one.
        coordinates: Coordinates of the state, see PlantState, shape (c,).
        rate: Their derivative, shape (c,).
        torque: Torque of the step that ended at the state [N m], shape (n,).
        time: Time of the state [s], shape (1,).
        silent: Samples since the last command, see Waiting, shape (1,).
        held: Joint angles when the safe action of the motors began [rad], shape (n,).
        command: The last command [N m], shape (n,).
        asked: What the motors are asked for over a period [N m], shape (n,).
        stamp: Stamp in the message, seconds and nanoseconds, shape (2,).
        position: Joints in the message [rad], shape (n,) or with the passive joints (n + p,).
        velocity: Their rates [rad/s], same shape.
        effort: Torques in the message [N m], same shape.
    """
    return PlantCore(
        setup,
        period,
        start,
        coordinates,
        rate,
        torque,
        time,
        silent,
        held,
        command,
        asked,
        stamp,
        position,
        velocity,
        effort,
    )


@kernel
def take(core: Any, command: Array, arrived: bool) -> None:
    """Find what the motors are asked for over the next period.

    Args:
        core: The plant.
        command: The newest command [N m], shape (n,).
        arrived: Whether it is one for this period.
    """
    setup, row = core.setup, core.start.torque
    newest = read_row(command, 0, row)
    if arrived and not setup.hazards.on:
        core.silent[0] = 0
        write_row(core.asked, 0, newest)
        return
    coordinates = read_row(core.coordinates, 0, core.start.coordinates)
    rate = read_row(core.rate, 0, core.start.rate)
    joints = setup.measure(setup.robot, coordinates, rate)
    before = Waiting(core.silent[0], read_row(core.held, 0, row), read_row(core.command, 0, row))
    if setup.hazards.on:
        sample = sample_at(core.time[0], core.period)
        arrived, newest = commanded(setup.hazards, sample, arrived, newest, before)
    asked, after = waited(
        setup.patience, before, arrived, newest, joints.position, joints.velocity
    )
    core.silent[0] = after.silent
    write_row(core.held, 0, after.held)
    write_row(core.command, 0, after.command)
    write_row(core.asked, 0, asked)


@kernel
def advance(core: Any, command: Array, arrived: bool) -> bool:
    """Advance by one period; arguments as of :func:`take`.

    Returns:
        Whether the robot is still in its workspace; if not, the state is left unchanged.
    """
    take(core, command, arrived)
    start = core.start
    state = PlantState(
        read_row(core.coordinates, 0, start.coordinates),
        read_row(core.rate, 0, start.rate),
        read_row(core.torque, 0, start.torque),
        core.time[0],
    )
    after = step(core.setup, state, read_row(core.asked, 0, start.torque), core.period)
    if not (is_finite(after.coordinates) and is_finite(after.rate)):
        return False
    write_row(core.coordinates, 0, after.coordinates)
    write_row(core.rate, 0, after.rate)
    write_row(core.torque, 0, after.torque)
    core.time[0] = after.time
    return True


@kernel
def tell(core: Any, stamp: int) -> bool:
    """Write the state into the message; `stamp`: of the sample [ns].

    Where sensors tell when they measured, the stamp in the message is earlier.

    Returns:
        Whether the state has joint positions, i.e. the robot is in its workspace.
    """
    setup, start = core.setup, core.start
    coordinates = read_row(core.coordinates, 0, start.coordinates)
    rate = read_row(core.rate, 0, start.rate)
    joints = setup.measure(setup.robot, coordinates, rate)
    angles, rates = joints.position, joints.velocity
    torque = read_row(core.torque, 0, start.torque)
    if setup.imperfections.on:
        angles, rates = sensed(setup, joints, core.time[0], core.period)
        torque = effort_at_stamp(setup, torque, core.time[0], core.period)
        stamp -= int(setup.imperfections.age * NANOSECONDS + 0.5)
    if setup.hazards.on:
        sample = sample_at(core.time[0], core.period)
        angles, rates, torque = told(setup.hazards, sample, angles, rates, torque)
    core.stamp[0] = stamp // NANOSECONDS
    core.stamp[1] = stamp % NANOSECONDS
    n = len(joints.position)
    write_row(core.position, 0, angles)
    write_row(core.velocity, 0, rates)
    write_row(core.effort, 0, torque)
    if len(core.position) > n:
        write_row(core.position, n, joints.passive_position)
        write_row(core.velocity, n, joints.passive_velocity)
    return bool(is_finite(joints.velocity))


@kernel
def read_command(wire: Any, data: bytes, command: Array) -> bool:
    """Read a command message; False, with nothing read, if it has no finite torques."""
    if not lay_open(wire, data):
        return False
    torques = joint_row(wire, 0)
    for i in range(len(torques)):
        if not np.isfinite(torques[i]):
            return False
    command[:] = torques
    return True


# The state of the plant as messages; one row per state.


def state_layout(joints: tuple[str, ...], passive: int) -> cdr.Layout:
    """sensor_msgs/JointState: the actuated joints first, then some passive ones."""
    names = joints
    if passive:
        names += passive_names(joints[:passive])
    return layouts.joint_state(names)


def state_messages(
    layout: cdr.Layout,
    stamps: Any,
    run: ClosedLoopRun,
    effort: np.ndarray,
) -> np.ndarray:
    """Fill the layout of :func:`state_layout` with a run; passive joints have no effort.

    Args:
        layout: The layout.
        stamps: Of the states [ns], shape (N,).
        run: The run.
        effort: What its states tell of the efforts [N m], shape (N, n).
    """
    records = layout.records(run.steps, stamps)
    rows, n = slice(run.steps), run.position.shape[1]
    records['position'][:, :n] = run.position[rows]
    records['velocity'][:, :n] = run.velocity[rows]
    records['effort'][:, :n] = effort
    if records['position'].shape[1] > n:
        records['position'][:, n:] = run.passive_position[rows]
        records['velocity'][:, n:] = run.passive_velocity[rows]
    return records


class ReportedEffort:
    """Efforts in the rows of states that tell of an earlier time; zero before the first one."""

    def __init__(self, late: int) -> None:
        """Prepare; `late`: samples from the measurement of a state to its row."""
        self._late = late
        self._before: np.ndarray | None = None  # the last efforts

    def of(self, effort: np.ndarray) -> np.ndarray:
        """What the next states of a run tell.

        Args:
            effort: Torque applied during the step that ended at each sample [N m], shape (N, n).
        """
        before = effort[:0] if self._before is None else self._before
        known = np.vstack([before, effort])
        self._before = known[max(len(known) - self._late, 0) :]
        told = np.zeros_like(known)
        told[self._late :] = known[: max(len(known) - self._late, 0)]
        return told[len(before) :]
