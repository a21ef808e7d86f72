"""Whether torque moves the robot as it should, by the momentum observer.

It finds what efforts do not tell: commands that do not act where no efforts are reported, brakes
and obstacles, an encoder that stands still while its joint turns.
"""

from __future__ import annotations

import numpy as np

from parallel_robot_base.arrays import Array
from parallel_robot_compiler import inner, read_at, select, some, write_at
from parallel_robot_control import cycle_memory
from parallel_robot_control.momentum_observer import Observed, observed
from parallel_robot_model.contract import Model

BANDWIDTH = 20.0  # 1/s
SHARE = 0.25  # of the damping of the safe action, times the speed: friction that does not count
LASTS = 0.1  # s, for which the residual must be above the limit
LOOKED_AT = 0.5  # of the limit: a torque from which on the residual is computed


@inner
def is_resisted(
    memory: int,
    limit: Array,
    damping: Array,
    model: Model,
    velocity: Array,
    torque: Array,
    comparable: bool,
    dt: float,
) -> bool:
    """Whether much more than friction has acted against the torque for a tenth of a second.

    Args:
        memory: Address of the memory of the cycle.
        limit: Residual that does not count [N m], shape (n,).
        damping: Damping of the safe action [N m s/rad], shape (n,).
        model: Nominal model at the state; none in a fault of the robot.
        velocity: Measured rates [rad/s], shape (n,).
        torque: Torque since the state before [N m], shape (n,).
        comparable: Whether there was a state not long before.
        dt: Time since then [s].
    """
    row = cycle_memory.MOMENTUM
    since = read_at(memory, row, velocity)  # 0: not looked at; 1 and more: 1 + s above the limit
    look = comparable and some(np.abs(torque) > LOOKED_AT * limit) and model.M[0, 0] > 0.0
    if not look:
        if since[0] != 0.0:
            write_at(memory, row, np.zeros_like(velocity))
        return False
    before = Observed(
        read_at(memory, row + 1, velocity),
        read_at(memory, row + 2, velocity),
        read_at(memory, row + 3, velocity),
    )
    now = observed(BANDWIDTH, before, since[0] != 0.0, model, velocity, torque, dt)
    write_at(memory, row + 1, now.momentum)
    write_at(memory, row + 2, now.drift)
    write_at(memory, row + 3, now.residual)
    above = some(np.abs(now.residual) - SHARE * damping * np.abs(velocity) > limit)
    lasts = select(above, select(since[0] > 1.0, since[0], 1.0) + dt, 1.0)
    write_at(memory, row, np.zeros_like(velocity) + lasts)
    return lasts - 1.0 > LASTS
