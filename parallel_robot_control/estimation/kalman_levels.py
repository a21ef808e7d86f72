"""Levels of noise and disturbance that the Kalman filter finds by itself, from its innovations.

With the right levels the square of what is measured less what was expected has the mean P + R, P
the variance of the prediction and R that of the noise; and the square of an estimate and its
variance sum up to that of what is estimated. So each level follows a moving mean.

Sources:
    Mehra (1970), On the identification of variances and adaptive Kalman filtering, IEEE Trans.
    Automatic Control 15(2), for the noise; Shumway, Stoffer (1982), J. Time Series Analysis 3(4),
    for the disturbance.
"""

from __future__ import annotations

from parallel_robot_control.estimation.cycle_memory import LEVELS
from parallel_robot_control.estimation.kalman_equations import Kalman
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, read_at, select, write_at

RANGE = 100.0  # of a variance, to either side of the given one


@inner
def with_levels(kalman: Kalman) -> Kalman:
    """The filter with the levels that it found; as it is where it finds none."""
    if kalman.levels == 0.0:
        return kalman
    like = kalman.position
    return Kalman(
        kalman.period,
        kalman.command_delay,
        kalman.lag,
        kalman.velocities,
        read_at(kalman.memory, LEVELS, like),
        read_at(kalman.memory, LEVELS + 1, like),
        read_at(kalman.memory, LEVELS + 2, like),
        kalman.bandwidth,
        kalman.offset,
        kalman.coulomb,
        kalman.levels,
        kalman.memory,
    )


@inner
def begin(kalman: Kalman) -> None:
    """Begin at the given levels."""
    write_at(kalman.memory, LEVELS, kalman.position)
    write_at(kalman.memory, LEVELS + 1, kalman.velocity)
    write_at(kalman.memory, LEVELS + 2, kalman.disturbance)


@inner
def follow(kalman: Kalman, which: int, given: Array, square: Array, dt: float) -> None:
    """Let a level follow a square.

    Args:
        kalman: The filter.
        which: 0 of the positions, 1 of the velocities, 2 of the disturbance.
        given: The level at the beginning, shape (n,).
        square: What has the level for its mean, shape (n,).
        dt: Time since the state before [s].
    """
    level = read_at(kalman.memory, LEVELS + which, given)
    share = select(dt < kalman.levels, dt / kalman.levels, 1.0)
    level = level + share * (square - level)
    level = select(level < given / RANGE, given / RANGE, level)
    write_at(kalman.memory, LEVELS + which, select(level > given * RANGE, given * RANGE, level))
