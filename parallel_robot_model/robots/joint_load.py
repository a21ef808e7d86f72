"""What acts on the actuated joints besides the motors."""

from __future__ import annotations

from typing import NamedTuple

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.robots.disturbance import DisturbanceParameters, disturbance_torque
from parallel_robot_model.robots.friction import FrictionParameters, friction_torque


class JointLoad(NamedTuple):
    """Friction and disturbance of the actuated joints."""

    friction: FrictionParameters
    disturbance: DisturbanceParameters


@kernel
def net_torque(load: JointLoad, torque: Array, velocity: Array, time: float) -> Array:
    """Motor torque less friction and disturbance [N m], shape (n,).

    Args:
        load: Friction and disturbance.
        torque: Torque of the motors [N m], shape (n,).
        velocity: Rates of the actuated joints [rad/s], shape (n,).
        time: Time since the start [s].
    """
    friction = friction_torque(load.friction, velocity)
    return torque - friction - disturbance_torque(load.disturbance, time)
