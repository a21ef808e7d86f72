"""The plant as one compiled object: command message in, state message out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.messages import joint_row, parse
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import is_finite, kernel, read_row, write_row
from parallel_robot_model.messages import cdr, layouts
from parallel_robot_model.messages.layouts import passive_names
from parallel_robot_sim.closed_loop import ClosedLoopRun
from parallel_robot_sim.noise_and_delay import sample_at
from parallel_robot_sim.plant import PlantSetup, demanded, observe, step


class PlantCore(NamedTuple):
    """The true robot, its state, and the message for it, as a Struct."""

    setup: PlantSetup  # the robot, its load, its integrator
    period: float  # length of a step [s]
    state: Any  # PlantState, a Struct
    waiting: Any  # Waiting, a Struct
    demand: Array  # torque demanded of the motors over a period [N m], shape (n,)
    stamp: NDArray[np.int32]  # in the message, seconds and nanoseconds, shape (2,)
    position: Array  # joints in it [rad], shape (n,) or with the passive joints (n + p,)
    velocity: Array  # their rates [rad/s], same shape
    effort: Array  # torques in it [N m], same shape


@kernel
def update_demand(core: Any, command: Array, arrived: bool) -> None:
    """Find the torque demanded of the motors over the next period.

    Args:
        core: The plant.
        command: The newest command [N m], shape (n,).
        arrived: Whether it is one for this period.
    """
    newest, sample = read_row(command, 0, core.demand), sample_at(core.state.time, core.period)
    core.demand, core.waiting.value = demanded(
        core.setup, core.state, core.waiting.value, newest, arrived, sample
    )


@kernel
def advance(core: Any, command: Array, arrived: bool) -> bool:
    """Advance by one period; arguments as of :func:`update_demand`.

    Returns:
        Whether the robot is still in its workspace; if not, the state is left unchanged.
    """
    update_demand(core, command, arrived)
    after = step(core.setup, core.state.value, core.demand, core.period)
    if not (is_finite(after.coordinates) and is_finite(after.rate)):
        return False
    core.state.value = after
    return True


@kernel
def write_state(core: Any, stamp: int) -> bool:
    """Write the state into the message; `stamp`: of the sample [ns].

    Where sensors tell when they measured, the stamp in the message is earlier.

    Returns:
        Whether the state has joint positions, i.e. the robot is in its workspace.
    """
    sample = sample_at(core.state.time, core.period)
    seen = observe(core.setup, core.state.value, sample, core.period, True)
    if core.setup.imperfections.on:
        stamp -= int(core.setup.imperfections.age * NANOSECONDS + 0.5)
    joints = seen.true
    core.stamp[0] = stamp // NANOSECONDS
    core.stamp[1] = stamp % NANOSECONDS
    n = len(joints.position)
    write_row(core.position, 0, seen.position)
    write_row(core.velocity, 0, seen.velocity)
    write_row(core.effort, 0, seen.effort)
    if len(core.position) > n:
        write_row(core.position, n, joints.passive_position)
        write_row(core.velocity, n, joints.passive_velocity)
    return bool(is_finite(joints.velocity))


@kernel
def read_command(wire: Any, data: bytes, command: Array) -> bool:
    """Read a command message; False, with nothing read, if it has no finite torques."""
    if not parse(wire, data):
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
        reported = np.zeros_like(known)
        reported[self._late :] = known[: max(len(known) - self._late, 0)]
        return reported[len(before) :]
