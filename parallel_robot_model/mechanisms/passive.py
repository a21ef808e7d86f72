"""Passive forces of a mechanism, beside those of its bodies: springs, dampers, rotors, lifts.

They act along lengths that are sums of joint positions times ratios: a joint is one, a fixed
tendon another. With x from where the spring is slack and the rate v

    force = x (k0 + k1 x + k2 x^2) + v (d0 + d1 |v| + d2 v^2) + armature dv/dt.

The rotor of a ball is felt at the relative angular rate of its bodies, w: with three hinges x, y,
z one after the other that are orthogonal at zero, |w|^2 = x'^2 + y'^2 + z'^2 + 2 sin(y) x' z'. Of
a rod that may spin freely about z, whose spin meets no inertia but the rotor, only the part of w
across z is felt: x'^2 cos(y)^2 + y'^2.

Source:
    MuJoCo documentation, Computation, Passive forces, for the polynomials.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner
from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    crossed,
    in_world,
    inner_product,
    second_triple,
    times,
    triple,
)
from parallel_robot_model.mechanisms.workspace import Workspace


class _Ball(NamedTuple):
    """Angle and rates of the hinges of a ball that count, and its rotor."""

    rotor: float
    spins: bool
    sine: float
    cosine: float
    x: float
    y: float
    z: float


@inner
def _ball(mechanism: Mechanism, workspace: Workspace, i: int) -> _Ball:
    """The ball whose last hinge is joint i."""
    whole, across = mechanism.elements.ball[i, 0], mechanism.elements.ball[i, 1]
    angle, rate = workspace.all[i - 1], workspace.rate
    sine, cosine = math.sin(angle), math.cos(angle)
    return _Ball(whole + across, across > 0.0, sine, cosine, rate[i - 2], rate[i - 1], rate[i])


@inner
def add_loads(mechanism: Mechanism, workspace: Workspace) -> None:
    """Add the forces at the posture and the rates of the workspace to `load`."""
    elements, load = mechanism.elements, workspace.load
    for i in range(len(load)):
        if elements.lifted[i] != 0.0:
            _lift(mechanism, workspace, i)
    for k in range(len(elements.ratio)):
        x, v = _sum(elements.ratio, k, workspace.all), _sum(elements.ratio, k, workspace.rate)
        x = max(x - elements.rest[k, 1], 0.0) + min(x - elements.rest[k, 0], 0.0)
        s, d = elements.stiffness, elements.damping
        force = x * (s[k, 0] + x * (s[k, 1] + x * s[k, 2]))
        force += v * (d[k, 0] + d[k, 1] * abs(v) + d[k, 2] * v * v)
        for j in range(len(load)):
            load[j] += elements.ratio[k, j] * force


@inner
def _sum(ratio: Array, k: int, x: Array) -> float:
    total = 0.0
    for j in range(len(x)):
        total += ratio[k, j] * x[j]
    return total


@inner
def _lift(mechanism: Mechanism, workspace: Workspace, i: int) -> None:
    """Take the weight that is lifted of body i off the joints that carry it."""
    elements, mass = mechanism.elements, mechanism.elements.lifted[i]
    down = (mechanism.gravity[0], mechanism.gravity[1], mechanism.gravity[2])
    arm = in_world(workspace.rotation, workspace.origin, i, triple(elements.lifted_at, i))
    moment = crossed(arm, times(down, mass))
    j = i
    while j != BASE:
        turn, slide = triple(workspace.S, j), second_triple(workspace.S, j)
        workspace.load[j] += inner_product(turn, moment) + mass * inner_product(slide, down)
        j = mechanism.parent[j]


@inner
def add_bias(mechanism: Mechanism, workspace: Workspace) -> None:
    """Add the forces of rotors at no acceleration of the actuated joints to `load`."""
    elements, load, bias = mechanism.elements, workspace.load, workspace.bias
    for k in range(len(elements.ratio)):
        if elements.armature[k] != 0.0:
            force = elements.armature[k] * _sum(elements.ratio, k, bias)
            for j in range(len(load)):
                load[j] += elements.ratio[k, j] * force
    for i in range(2, len(load)):
        if elements.ball[i, 0] + elements.ball[i, 1] != 0.0:
            a, spins, s, c, x, y, z = _ball(mechanism, workspace, i)
            if spins:
                load[i - 2] += a * (c * c * bias[i - 2] - 2.0 * c * s * x * y)
                load[i - 1] += a * (bias[i - 1] + c * s * x * x)
            else:
                load[i - 2] += a * (bias[i - 2] + s * bias[i] + c * y * z)
                load[i - 1] += a * (bias[i - 1] - c * x * z)
                load[i] += a * (bias[i] + s * bias[i - 2] + c * x * y)


@inner
def add_inertia(mechanism: Mechanism, workspace: Workspace, W: Array, out: Array) -> None:
    """Add the inertia matrix of rotors in all joints, times W, shape (N, n), to `out`."""
    elements, n = mechanism.elements, W.shape[1]
    for k in range(len(elements.ratio)):
        if elements.armature[k] != 0.0:
            for c in range(n):
                total = 0.0
                for j in range(len(W)):
                    total += elements.ratio[k, j] * W[j, c]
                for j in range(len(W)):
                    out[j, c] += elements.armature[k] * elements.ratio[k, j] * total
    for i in range(2, len(W)):
        if elements.ball[i, 0] + elements.ball[i, 1] != 0.0:
            a, spins, sine, cosine, _, _, _ = _ball(mechanism, workspace, i)
            for c in range(n):
                out[i - 1, c] += a * W[i - 1, c]
                if spins:
                    out[i - 2, c] += a * cosine * cosine * W[i - 2, c]
                else:
                    out[i - 2, c] += a * (W[i - 2, c] + sine * W[i, c])
                    out[i, c] += a * (W[i, c] + sine * W[i - 2, c])


@inner
def add_coriolis(mechanism: Mechanism, workspace: Workspace) -> None:
    """Add the Coriolis matrix of rotors in all joints, times `W`, to `QW`."""
    elements, W, out = mechanism.elements, workspace.W, workspace.QW
    for i in range(2, len(W)):
        if elements.ball[i, 0] + elements.ball[i, 1] != 0.0:
            a, spins, sine, cosine, x, y, z = _ball(mechanism, workspace, i)
            half, both = 0.5 * a * cosine, a * cosine * sine
            for c in range(W.shape[1]):
                if spins:
                    out[i - 2, c] -= both * (y * W[i - 2, c] + x * W[i - 1, c])
                    out[i - 1, c] += both * x * W[i - 2, c]
                else:
                    out[i - 2, c] += half * (z * W[i - 1, c] + y * W[i, c])
                    out[i - 1, c] -= half * (z * W[i - 2, c] + x * W[i, c])
                    out[i, c] += half * (y * W[i - 2, c] + x * W[i - 1, c])
