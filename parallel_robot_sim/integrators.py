"""Fixed-step integrators of second-order motion: each takes the acceleration as a function."""

from __future__ import annotations

from typing import Any

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inlined


@inlined
def ode3(
    acceleration: Any, q: Array, v: Array, t: float, h: float, arguments: Any
) -> tuple[Array, Array]:
    """One step of Bogacki-Shampine 3(2) without its error estimate, as Simulink's ode3.

    Args:
        acceleration: Second derivative of q, called with q, v, t and the arguments.
        q: Coordinates at the start of the step, shape (c,).
        v: Their derivative, shape (c,).
        t: Time at the start of the step [s].
        h: Length of the step [s].
        arguments: Further arguments of the acceleration.

    Returns:
        Both at the end of the step.

    Source:
        Bogacki, Shampine (1989), Appl. Math. Lett. 2(4).
    """
    a1 = acceleration(q, v, t, arguments)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(q + 0.5 * h * v, v2, t + 0.5 * h, arguments)
    v3 = v + 0.75 * h * a2
    a3 = acceleration(q + 0.75 * h * v2, v3, t + 0.75 * h, arguments)
    return (
        q + h / 9.0 * (2.0 * v + 3.0 * v2 + 4.0 * v3),
        v + h / 9.0 * (2.0 * a1 + 3.0 * a2 + 4.0 * a3),
    )


@inlined
def rk4(
    acceleration: Any, q: Array, v: Array, t: float, h: float, arguments: Any
) -> tuple[Array, Array]:
    """One step of the classical Runge-Kutta method of order 4; arguments as of :func:`ode3`."""
    a1 = acceleration(q, v, t, arguments)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(q + 0.5 * h * v, v2, t + 0.5 * h, arguments)
    v3 = v + 0.5 * h * a2
    a3 = acceleration(q + 0.5 * h * v2, v3, t + 0.5 * h, arguments)
    v4 = v + h * a3
    a4 = acceleration(q + h * v3, v4, t + h, arguments)
    return (
        q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
    )
