"""The plant as one compiled object: command message in, state message out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.experimental import structref
from numpy.typing import NDArray

from parallel_robot_base.kernel import kernel
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control.wire import lay_open, vector
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_sim.disturbance import DisturbanceParameters
from parallel_robot_sim.friction import FrictionParameters
from parallel_robot_sim.plant import PlantState, Stepping, measure, step

Array = NDArray[np.float64]


@structref.register
class PlantCoreType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a PlantCore."""


class PlantCore(structref.StructRefProxy):  # type: ignore[misc]
    """The true robot with its state, and the message that tells it. Made by :func:`plant_core`."""


FIELDS = (
    'stepping', 'robot', 'friction', 'disturbance', 'period',
    'pose', 'rate', 'torque', 'time', 'stamp', 'position', 'velocity', 'effort',
)  # fmt: skip
structref.define_boxing(PlantCoreType, PlantCore)
structref.define_constructor(PlantCore, PlantCoreType, FIELDS)


@kernel
def plant_core(
    stepping: Stepping,
    robot: RobotParameters,
    friction: FrictionParameters,
    disturbance: DisturbanceParameters,
    period: float,
    pose: Array,
    rate: Array,
    torque: Array,
    time: Array,
    stamp: Any,
    position: Array,
    velocity: Array,
    effort: Array,
) -> Any:
    """Tie robot, state and message together; the arrays are shared, not copied.

    Args:
        stepping: Integrator, substeps, torque limit.
        robot: The true robot.
        friction: Of the actuated joints.
        disturbance: Of the actuated joints.
        period: [s].
        pose: Of the state [m, m, rad], shape (3,).
        rate: Its derivative, shape (3,).
        torque: Of the step that ended at the state [N m], shape (3,).
        time: Of the state [s], shape (1,).
        stamp: Of the message, seconds and nanoseconds, shape (2,).
        position: Of the message [rad], shape (n,): actuated, then perhaps passive joints.
        velocity: Of the message [rad/s], shape (n,).
        effort: Of the message [N m], shape (n,).
    """
    return PlantCore(
        stepping,
        robot,
        friction,
        disturbance,
        period,
        pose,
        rate,
        torque,
        time,
        stamp,
        position,
        velocity,
        effort,
    )


@kernel
def advance(core: Any, command: Array) -> bool:
    """Advance by one period under a command [N m], shape (3,).

    Returns:
        Whether the robot still is in its workspace; if not, the state stays as it was.
    """
    state = PlantState(core.pose.copy(), core.rate.copy(), core.torque.copy(), core.time[0])
    after = step(
        core.stepping, core.robot, core.friction, core.disturbance, state, command, core.period
    )
    for i in range(3):
        if not (np.isfinite(after.pose[i]) and np.isfinite(after.rate[i])):
            return False
    core.pose[:] = after.pose
    core.rate[:] = after.rate
    core.torque[:] = after.torque
    core.time[0] = after.time
    return True


@kernel
def tell(core: Any, stamp: int) -> bool:
    """Write the state into the message; `stamp` in nanoseconds.

    Returns:
        Whether the state has joints: the robot is in its workspace.
    """
    state = PlantState(core.pose, core.rate, core.torque, core.time[0])
    joints = measure(core.robot, state)
    core.stamp[0] = stamp // NANOSECONDS
    core.stamp[1] = stamp % NANOSECONDS
    inside = True
    for i in range(3):
        inside = inside and np.isfinite(joints.theta_dot[i])
        core.position[i] = joints.theta[i]
        core.velocity[i] = joints.theta_dot[i]
        core.effort[i] = core.torque[i]
        if len(core.position) > 3:
            core.position[3 + i] = joints.psi[i]
            core.velocity[3 + i] = joints.psi_dot[i]
    return inside


@kernel
def read_command(wire: Any, data: bytes, command: Array) -> bool:
    """Read a command message; False, and nothing read, when it is not one of finite torques."""
    if not lay_open(wire, data):
        return False
    torques = vector(wire, 0)
    for i in range(len(torques)):
        if not np.isfinite(torques[i]):
            return False
    command[:] = torques
    return True
