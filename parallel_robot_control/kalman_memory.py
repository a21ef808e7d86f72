"""Memory of the Kalman filter: what it knows, and the torques that were asked for."""

from __future__ import annotations

import numpy as np

from parallel_robot_base.arrays import Array
from parallel_robot_compiler import Space, inner, read_at, select, vector, write_at
from parallel_robot_control import lock_in
from parallel_robot_control.kalman_equations import Kalman, Mean, Variance

MOST = 50  # samples, largest age from which is predicted
AT_REST = 1e-6  # (rad/s)^2, variance of the velocity of a robot at rest
MOVING = 1.0  # (rad/s)^2, of one that moves

SIZE = 128  # torques that are remembered
MEANS = 5
SAMPLE, RUNNING = 0, 1  # floats in the first rows: newest sample; whether the filter ran at it
MEAN, VARIANCE, TORQUE = 5, 10, 25  # rows where these begin
WAYS = TORQUE + SIZE  # row where that of state_consistency.py begins
ROWS = WAYS + 5
AGE = 4  # float in the first rows: age of the last state [s]


def memory(like: Array) -> Space:
    """Memory of filter, checks and lock-in for vectors as `like`, shape (n,)."""
    return Space((ROWS + lock_in.ROWS) * like.size)


def of_lock_in(memory: Space) -> Space:
    """The part of the memory that is the lock-in's."""
    rows = memory.floats.reshape(ROWS + lock_in.ROWS, -1)
    return Space.within(rows[-lock_in.ROWS :].reshape(-1))


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
def newest(kalman: Kalman) -> int:
    """Index of the last sample of which a torque is remembered."""
    return int(read_at(kalman.memory, SAMPLE, 0.0))


@inner
def torque(kalman: Kalman, sample: int, like: Array) -> Array:
    """Torque that was asked for at one of the last SIZE samples [N m], shape (n,), as `like`."""
    return read_at(kalman.memory, TORQUE + sample % SIZE, like)


@inner
def forget(kalman: Kalman) -> None:
    """Let the filter begin anew at the next state."""
    write_at(kalman.memory, RUNNING, 0.0)


@inner
def between(kalman: Kalman, age: float, known: bool, dt: float) -> float:
    """Time between the moments at which the last torque and the next one act [s].

    Args:
        kalman: The filter.
        age: From the measurement of a state to the moment at which its torque acts [s].
        known: Whether there was a state before.
        dt: Time between the measurements [s].
    """
    before = read_at(kalman.memory, AGE, 0.0)
    write_at(kalman.memory, AGE, age)
    return select(known, dt + age - before, dt)


@inner
def fill(kalman: Kalman, torque: Array) -> None:
    """Take a torque for the one that has acted for long [N m], shape (n,)."""
    for k in range(SIZE):
        write_at(kalman.memory, TORQUE + k, torque)


@inner
def remember(kalman: Kalman, sample: int, torque: Array, tracking: bool) -> None:
    """Keep the torque that acts from a sample on; where samples are left out, the last one acted.

    Args:
        kalman: The filter.
        sample: Index of the sample.
        torque: [N m], shape (n,).
        tracking: Whether the filter ran at this sample.
    """
    last = newest(kalman)
    if sample > last + 1:
        held = read_at(kalman.memory, TORQUE + last % SIZE, torque)
        for missed in range(max(last + 1, sample - SIZE), sample):
            write_at(kalman.memory, TORQUE + missed % SIZE, held)
    write_at(kalman.memory, TORQUE + sample % SIZE, torque)
    write_at(kalman.memory, SAMPLE, float(sample))
    write_at(kalman.memory, RUNNING, 1.0 if tracking else 0.0)


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
    fill(kalman, torque)
    v = z + select(moving, MOVING, AT_REST)
    q, w, c, f = (
        z + kalman.position,
        z + kalman.disturbance,
        z + kalman.offset,
        z + kalman.coulomb,
    )
    mean = Mean(position, velocity, z, z, z)
    return mean, Variance(q, z, z, z, z, v, z, z, z, w, z, z, c, z, f)
