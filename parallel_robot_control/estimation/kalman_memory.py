"""What the Kalman filter keeps from state to state, in the memory of the cycle."""

from __future__ import annotations

import numpy as np

from parallel_robot_control.estimation import cycle_memory
from parallel_robot_control.estimation.cycle_memory import MEAN, RUNNING, SAMPLE, SIZE, VARIANCE
from parallel_robot_control.estimation.kalman_equations import Kalman, Mean, Variance
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, read_at, select, vector, write_at

MOST = 50  # samples, largest age from which is predicted
AT_REST = 1e-6  # (rad/s)^2, variance of the velocity of a robot at rest
MOVING = 1.0  # (rad/s)^2, of one that moves
MEANS = 5


@inner
def running(kalman: Kalman, sample: int, known: bool) -> bool:
    """Whether the filter ran not long before a sample; `known`: whether there was one."""
    since = sample - read_at(kalman.memory, SAMPLE, 0.0)
    on = read_at(kalman.memory, RUNNING, 0.0) != 0.0
    return known and on and since >= 0.0 and since <= SIZE - 2 * MOST


@inner
def known_velocity(kalman: Kalman, like: Array) -> Array:
    """The last estimate of the velocity [rad/s], shape (n,)."""
    return read_at(kalman.memory, MEAN + 1, like)


@inner
def forget(memory: int) -> None:
    """Let the filter begin anew at the next state."""
    write_at(memory, RUNNING, 0.0)


@inner
def write(kalman: Kalman, x: Mean, p: Variance) -> None:
    """Keep what is known."""
    mean = vector((x.position, x.velocity, x.disturbance, x.offset, x.coulomb))
    write_at(kalman.memory, MEAN // MEANS, mean)
    of_q = vector((p.qq, p.qv, p.qw, p.qc, p.qf))
    of_v = vector((p.vv, p.vw, p.vc, p.vf, p.ww))
    of_w = vector((p.wc, p.wf, p.cc, p.cf, p.ff))
    for k, part in enumerate((of_q, of_v, of_w)):
        write_at(kalman.memory, VARIANCE // MEANS + k, part)


@inner
def read(kalman: Kalman, like: Array) -> tuple[Mean, Variance]:
    """What is known; `like` is any vector of shape (n,)."""
    five = vector((like, like, like, like, like))
    x = read_at(kalman.memory, MEAN // MEANS, five)
    q = read_at(kalman.memory, VARIANCE // MEANS, five)
    v = read_at(kalman.memory, VARIANCE // MEANS + 1, five)
    w = read_at(kalman.memory, VARIANCE // MEANS + 2, five)
    mean = Mean(x[0], x[1], x[2], x[3], x[4])
    return mean, Variance(
        q[0], q[1], q[2], q[3], q[4], v[0], v[1], v[2], v[3], v[4], w[0], w[1], w[2], w[3], w[4]
    )


@inner
def begin(
    kalman: Kalman, moving: bool, position: Array, velocity: Array, torque: Array
) -> tuple[Mean, Variance]:
    """Begin anew at a measured motion, under a torque that has acted for long [N m]."""
    z = np.zeros_like(position)
    cycle_memory.fill(kalman.memory, torque)
    v = z + select(moving, MOVING, AT_REST)
    q, w, c, f = (
        z + kalman.position,
        z + kalman.disturbance,
        z + kalman.offset,
        z + kalman.coulomb,
    )
    mean = Mean(position, velocity, z, z, z)
    return mean, Variance(q, z, z, z, z, v, z, z, z, w, z, z, c, z, f)
