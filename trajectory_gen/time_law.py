"""Progress along a path from rest to rest."""

from __future__ import annotations

import math

from parallel_robot_model.compiler import kernel


@kernel
def quintic(duration: float, t: float) -> tuple[float, float, float]:
    """Fraction of the path s = 10 u^3 - 15 u^4 + 6 u^5, u = t / duration, with two derivatives.

    Before the start s is 0, after the end 1.

    Args:
        duration: Time from the start to the end of the path [s].
        t: Time since the start [s].
    """
    T = duration
    u = min(max(t / T, 0.0), 1.0)
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    s_dot = 30.0 * u**2 * (1.0 - u) ** 2 / T
    s_ddot = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / T**2
    return s, s_dot, s_ddot


@kernel
def trapezoid(speed: float, acceleration: float, t: float) -> tuple[float, float, float]:
    """Fraction of the path with two derivatives, the rate of trapezoidal shape.

    It accelerates, keeps its rate if there is time for that, and slows down. Before the start the
    fraction is 0, after the end 1.

    Args:
        speed: Largest rate [1/s].
        acceleration: Acceleration and deceleration [1/s^2].
        t: Time since the start [s].
    """
    slope = min(speed / acceleration, 1.0 / math.sqrt(acceleration))
    rate = acceleration * slope
    end = slope + 1.0 / rate
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    if t < slope:
        return 0.5 * acceleration * t**2, acceleration * t, acceleration
    if t <= end - slope:
        return rate * (t - 0.5 * slope), rate, 0.0
    if t < end:
        left = end - t
        return 1.0 - 0.5 * acceleration * left**2, acceleration * left, -acceleration
    return 1.0, 0.0, 0.0
