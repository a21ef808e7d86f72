"""Fixed-step integrators: each takes the derivative, so the plant is independent of the choice."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.kernel import inlined

Array = NDArray[np.float64]


@inlined
def ode3(derivative: Any, y: Array, h: float, arguments: Any) -> Array:
    """One step of Bogacki-Shampine 3(2) without its error estimate, as Simulink's ode3.

    Source:
        Bogacki, Shampine (1989), Appl. Math. Lett. 2(4).
    """
    k1 = derivative(y, arguments)
    k2 = derivative(y + 0.5 * h * k1, arguments)
    k3 = derivative(y + 0.75 * h * k2, arguments)
    return y + h / 9.0 * (2.0 * k1 + 3.0 * k2 + 4.0 * k3)


@inlined
def rk4(derivative: Any, y: Array, h: float, arguments: Any) -> Array:
    """One step of the classical Runge-Kutta method of order 4."""
    k1 = derivative(y, arguments)
    k2 = derivative(y + 0.5 * h * k1, arguments)
    k3 = derivative(y + 0.5 * h * k2, arguments)
    k4 = derivative(y + h * k3, arguments)
    return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
