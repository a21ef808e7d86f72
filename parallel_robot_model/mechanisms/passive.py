"""Passive forces of a mechanism, beside those of its bodies: springs, dampers, rotors, lifts.

They act along lengths that are sums of joint positions times ratios: a joint is one, a fixed
tendon another. With x from where the spring is slack and the rate v

    force = x (k0 + k1 x + k2 x^2) + v (d0 + d1 |v| + d2 v^2) + armature dv/dt.

The rotor of a ball is felt at the relative angular rate of its bodies, w: with three hinges x, y,
z one after the other that are orthogonal at zero, |w|^2 = x'^2 + y'^2 + z'^2 + 2 sin(y) x' z'. Of
a rod along the last or the first hinge that may spin freely, whose spin meets no inertia but the
rotor, only the part of w across it is felt: x'^2 cos(y)^2 + y'^2, or z in place of x. Of a rod
with rotors a and b at both its ends, a b / (a + b) is felt at the rate along it, too.

Source:
    MuJoCo documentation, Computation, Passive forces, for the polynomials.
"""

from __future__ import annotations

import math

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import cross, dot, internal
from parallel_robot_model.mechanisms.mechanism import (
    BASE,
    FIRST,
    LAST,
    WHOLE,
    Mechanism,
)
from parallel_robot_model.mechanisms.spatial import in_world, of_array, triple
from parallel_robot_model.mechanisms.workspace import Workspace


@internal
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


@internal
def _sum(ratio: Array, k: int, x: Array) -> float:
    total = 0.0
    for j in range(len(x)):
        total += ratio[k, j] * x[j]
    return total


@internal
def _lift(mechanism: Mechanism, workspace: Workspace, i: int) -> None:
    """Take the weight that is lifted of body i off the joints that carry it."""
    elements, mass = mechanism.elements, mechanism.elements.lifted[i]
    down = of_array(mechanism.gravity)
    arm = in_world(workspace.rotation, workspace.origin, i, triple(elements.lifted_at, i))
    moment = cross(arm, mass * down)
    j = i
    while j != BASE:
        turn, slide = triple(workspace.S, j), triple(workspace.S, j, 3)
        workspace.load[j] += dot(turn, moment) + mass * dot(slide, down)
        j = mechanism.parent[j]


@internal
def add_bias(mechanism: Mechanism, workspace: Workspace) -> None:
    """Add the forces of rotors at no acceleration of the actuated joints to `load`."""
    elements, load, bias, rate = (
        mechanism.elements, workspace.load, workspace.bias, workspace.rate,
    )  # fmt: skip
    for k in range(len(elements.ratio)):
        if elements.armature[k] != 0.0:
            force = elements.armature[k] * _sum(elements.ratio, k, bias)
            for j in range(len(load)):
                load[j] += elements.ratio[k, j] * force
    for i in range(2, len(load)):
        if _has_rotor(elements.ball, i):
            angle, x, y, z = workspace.all[i - 1], rate[i - 2], rate[i - 1], rate[i]
            s, c = math.sin(angle), math.cos(angle)
            a = 1.0 * elements.ball[i, WHOLE]
            load[i - 2] += a * (bias[i - 2] + s * bias[i] + c * y * z)
            load[i - 1] += a * (bias[i - 1] - c * x * z)
            load[i] += a * (bias[i] + s * bias[i - 2] + c * x * y)
            for side in (LAST, FIRST):
                a, k = elements.ball[i, side], i - 2 if side == LAST else i
                load[k] += a * (c * c * bias[k] - 2.0 * c * s * rate[k] * y)
                load[i - 1] += a * (bias[i - 1] + c * s * rate[k] * rate[k])


@internal
def add_inertia(mechanism: Mechanism, workspace: Workspace, W: Array, out: Array) -> None:
    """Add the inertia matrix of rotors in all joints, times W, shape (N, n), to `out`."""
    elements, n = mechanism.elements, W.shape[1]
    for k in range(len(elements.ratio)):
        if elements.armature[k] != 0.0:
            for column in range(n):
                total = 0.0
                for j in range(len(W)):
                    total += elements.ratio[k, j] * W[j, column]
                for j in range(len(W)):
                    out[j, column] += elements.armature[k] * elements.ratio[k, j] * total
    for i in range(2, len(W)):
        if _has_rotor(elements.ball, i):
            angle, a = workspace.all[i - 1], elements.ball[i, WHOLE]
            s, c = math.sin(angle), math.cos(angle)
            last, first = elements.ball[i, LAST], elements.ball[i, FIRST]
            for k in range(n):
                x, y, z = W[i - 2, k], W[i - 1, k], W[i, k]
                out[i - 2, k] += a * (x + s * z) + last * c * c * x
                out[i - 1, k] += (a + last + first) * y
                out[i, k] += a * (z + s * x) + first * c * c * z


@internal
def add_coriolis(mechanism: Mechanism, workspace: Workspace) -> None:
    """Add the Coriolis matrix of rotors in all joints, times `W`, to `QW`."""
    elements, W, out, rate = mechanism.elements, workspace.W, workspace.QW, workspace.rate
    for i in range(2, len(W)):
        if _has_rotor(elements.ball, i):
            angle, x, y, z = workspace.all[i - 1], rate[i - 2], rate[i - 1], rate[i]
            s, c = math.sin(angle), math.cos(angle)
            half = 0.5 * c * elements.ball[i, WHOLE]
            last, first = elements.ball[i, LAST] * c * s, elements.ball[i, FIRST] * c * s
            for k in range(W.shape[1]):
                p, q, r = W[i - 2, k], W[i - 1, k], W[i, k]
                out[i - 2, k] += half * (z * q + y * r) - last * (y * p + x * q)
                out[i - 1, k] += last * x * p + first * z * r - half * (z * p + x * r)
                out[i, k] += half * (y * p + x * q) - first * (y * r + z * q)


@internal
def _has_rotor(ball: Array, i: int) -> bool:
    return bool(ball[i, WHOLE] + ball[i, LAST] + ball[i, FIRST] != 0.0)
