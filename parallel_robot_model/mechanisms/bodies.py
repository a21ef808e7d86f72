"""Inertia of the bodies in the world, about its origin; composite ones are sums.

Of a body with mass m, first moments h, second moments J that moves with V = (w, u): linear
momentum f = m u + w x h, angular momentum n = J w + h x u, and half the derivative of J, D.
"""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.mechanisms.spatial import (
    Triple,
    crossed,
    in_world,
    inner_product,
    plus,
    second_triple,
    times,
    triple,
)
from parallel_robot_model.mechanisms.workspace import Workspace


@inner
def place_bodies(mechanism: Mechanism, workspace: Workspace) -> None:
    """Write `inertia` of each body: m, h, J by its rows xx xy xz yy yz zz."""
    out, rotation = workspace.inertia, workspace.rotation
    for i in range(len(mechanism.mass)):
        mass = mechanism.mass[i]
        x, y, z = in_world(rotation, workspace.origin, i, triple(mechanism.centre, i))
        R, own = rotation[i], mechanism.inertia[i]
        out[i, 0] = mass
        out[i, 1], out[i, 2], out[i, 3] = mass * x, mass * y, mass * z
        a = _times_rows(own, R[0, 0], R[0, 1], R[0, 2])
        b = _times_rows(own, R[1, 0], R[1, 1], R[1, 2])
        c = _times_rows(own, R[2, 0], R[2, 1], R[2, 2])
        out[i, 4] = _row(R, 0, a) + mass * (y * y + z * z)
        out[i, 5] = _row(R, 1, a) - mass * x * y
        out[i, 6] = _row(R, 2, a) - mass * x * z
        out[i, 7] = _row(R, 1, b) + mass * (x * x + z * z)
        out[i, 8] = _row(R, 2, b) - mass * y * z
        out[i, 9] = _row(R, 2, c) + mass * (x * x + y * y)


@inner
def _times_rows(a: Array, x: float, y: float, z: float) -> Triple:
    """A symmetric matrix times a vector."""
    return (
        a[0, 0] * x + a[0, 1] * y + a[0, 2] * z,
        a[1, 0] * x + a[1, 1] * y + a[1, 2] * z,
        a[2, 0] * x + a[2, 1] * y + a[2, 2] * z,
    )


@inner
def _row(R: Array, i: int, x: Triple) -> float:
    return R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@inner
def symmetric(x: Array, i: int, k: int, a: Triple) -> Triple:
    """The symmetric matrix in row i from element k, times a vector."""
    return (
        x[i, k] * a[0] + x[i, k + 1] * a[1] + x[i, k + 2] * a[2],
        x[i, k + 1] * a[0] + x[i, k + 3] * a[1] + x[i, k + 4] * a[2],
        x[i, k + 2] * a[0] + x[i, k + 4] * a[1] + x[i, k + 5] * a[2],
    )


@inner
def momentum_of(inertia: Array, i: int, turn: Triple, slide: Triple) -> tuple[Triple, Triple]:
    """Angular and linear momentum of body i in a motion."""
    h = (inertia[i, 1], inertia[i, 2], inertia[i, 3])
    return (
        plus(symmetric(inertia, i, 4, turn), crossed(h, slide)),
        plus(times(slide, inertia[i, 0]), crossed(turn, h)),
    )


@inner
def place_momenta(workspace: Workspace) -> None:
    """Write `momentum` of each body: D by its rows xx xy xz yy yz zz, n, f."""
    inertia, out = workspace.inertia, workspace.momentum
    for i in range(len(inertia)):
        w, u = triple(workspace.V, i), second_triple(workspace.V, i)
        n, f = momentum_of(inertia, i, w, u)
        h = (inertia[i, 1], inertia[i, 2], inertia[i, 3])
        # D = sym(w x J) - sym(h u^T) + (h u) 1
        a = crossed(w, (inertia[i, 4], inertia[i, 5], inertia[i, 6]))
        b = crossed(w, (inertia[i, 5], inertia[i, 7], inertia[i, 8]))
        c = crossed(w, (inertia[i, 6], inertia[i, 8], inertia[i, 9]))
        along = inner_product(h, u)
        out[i, 0] = a[0] - h[0] * u[0] + along
        out[i, 1] = 0.5 * (a[1] + b[0] - h[0] * u[1] - h[1] * u[0])
        out[i, 2] = 0.5 * (a[2] + c[0] - h[0] * u[2] - h[2] * u[0])
        out[i, 3] = b[1] - h[1] * u[1] + along
        out[i, 4] = 0.5 * (b[2] + c[1] - h[1] * u[2] - h[2] * u[1])
        out[i, 5] = c[2] - h[2] * u[2] + along
        out[i, 6], out[i, 7], out[i, 8] = n
        out[i, 9], out[i, 10], out[i, 11] = f
