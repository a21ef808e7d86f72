"""Progress along a path from rest to rest."""

from __future__ import annotations

from parallel_robot_compiler import kernel


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
