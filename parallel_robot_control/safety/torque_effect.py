"""Whether torque moves the robot as it should, by the momentum observer.

It finds what efforts do not tell: commands that do not act where no efforts are reported, brakes
and obstacles, an encoder that stands still while its joint turns.
"""

from __future__ import annotations

import numpy as np

from parallel_robot_control.estimation import cycle_memory
from parallel_robot_control.estimation.estimator import Observed, observed
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, largest, read_at, select, write_at
from parallel_robot_model.robots.contract import Model

BANDWIDTH = 20.0  # 1/s
SHARE = 0.25  # of the damping of the safe action, times the speed: friction that does not count
LASTS = 0.1  # s, for which the residual must be at the limit; twice of it half as long
LATELY = 32.0  # samples after which it begins anew
LOOKED_AT = 0.5  # of the limit: a torque from which on the residual is looked at


@inner
def is_resisted(
    memory: int,
    sample: int,
    limit: Array,
    damping: Array,
    model: Model,
    velocity: Array,
    torque: Array,
    comparable: bool,
    dt: float,
) -> bool:
    """Whether much more than friction has acted against the torque: the more, the shorter.

    Args:
        memory: Address of the memory of the cycle.
        sample: Index of the sample from which on the next torque acts.
        limit: Residual that does not count [N m], shape (n,).
        damping: Damping of the safe action [N m s/rad], shape (n,).
        model: Nominal model at the state; none in a fault of the robot.
        velocity: Measured rates [rad/s], shape (n,).
        torque: Torque since the state before [N m], shape (n,).
        comparable: Whether there was a state not long before.
        dt: Time since then [s].
    """
    row = cycle_memory.MOMENTUM
    since = sample - read_at(memory, row, velocity)[0]  # samples since it looked
    follows = comparable and since >= 0.0 and since <= LATELY
    if not model.M[0, 0] > 0.0:
        return False
    before = Observed(
        read_at(memory, row + 1, velocity),
        read_at(memory, row + 2, velocity),
        read_at(memory, row + 3, velocity),
    )
    now = observed(BANDWIDTH, before, follows, model, velocity, torque, dt)
    write_at(memory, row + 1, now.momentum)
    write_at(memory, row + 2, now.drift)
    write_at(memory, row + 3, now.residual)
    level = np.abs(now.residual) - SHARE * damping * np.abs(velocity)
    times = largest(select(level > 0.0, level, np.zeros_like(level)) / limit)
    lasted = read_at(memory, row + 4, velocity)[0]
    lasts = select(times > 1.0 and follows, lasted + times * dt, 0.0)
    write_at(memory, row, np.zeros_like(velocity) + float(sample))
    write_at(memory, row + 4, np.zeros_like(velocity) + lasts)
    return lasts > LASTS
