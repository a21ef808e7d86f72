"""Motions of the joints and bodies at rates of the actuated joints."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner, kernel
from parallel_robot_model.mechanisms.closure_rates import bias
from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism
from parallel_robot_model.mechanisms.spatial import (
    clear,
    crossed,
    plus,
    second_triple,
    set_row,
    times,
    triple,
)
from parallel_robot_model.mechanisms.workspace import Workspace


@kernel
def rates(mechanism: Mechanism, workspace: Workspace, velocity: Array) -> None:
    """Write `rate`, the rates of all joints, at those of the actuated ones, shape (n,)."""
    W, rate = workspace.W, workspace.rate
    for i in range(len(rate)):
        total = 0.0
        for j in range(len(velocity)):
            total += W[i, j] * velocity[j]
        rate[i] = total


@inner
def motions(mechanism: Mechanism, workspace: Workspace, rate: Array) -> None:
    """Write V and S_rate at the rates of all joints, shape (N,)."""
    parent, S, V, S_rate = mechanism.parent, workspace.S, workspace.V, workspace.S_rate
    for i in range(len(parent)):
        j = parent[i]
        turn, slide = triple(S, i), second_triple(S, i)
        angular, linear = times(turn, rate[i]), times(slide, rate[i])
        if j != BASE:
            angular, linear = plus(triple(V, j), angular), plus(second_triple(V, j), linear)
        set_row(V, i, angular, linear)
        moved = plus(crossed(linear, turn), crossed(angular, slide))
        set_row(S_rate, i, crossed(angular, turn), moved)


@inner
def accelerations(
    mechanism: Mechanism, workspace: Workspace, rate: Array, acceleration: Array
) -> None:
    """Write A at rates and accelerations of all joints, shape (N,); V and S_rate are known."""
    parent, S, S_rate, A = mechanism.parent, workspace.S, workspace.S_rate, workspace.A
    for i in range(len(parent)):
        j = parent[i]
        angular = plus(times(triple(S_rate, i), rate[i]), times(triple(S, i), acceleration[i]))
        linear = plus(
            times(second_triple(S_rate, i), rate[i]),
            times(second_triple(S, i), acceleration[i]),
        )
        if j != BASE:
            angular, linear = plus(triple(A, j), angular), plus(second_triple(A, j), linear)
        set_row(A, i, angular, linear)


@inner
def move(mechanism: Mechanism, workspace: Workspace, velocity: Array) -> None:
    """Write all rates, motions, and accelerations at none of the actuated joints."""
    rates(mechanism, workspace, velocity)
    motions(mechanism, workspace, workspace.rate)
    clear(workspace.bias)
    accelerations(mechanism, workspace, workspace.rate, workspace.bias)
    bias(mechanism, workspace, workspace.bias)
    accelerations(mechanism, workspace, workspace.rate, workspace.bias)


@kernel
def all_accelerations(
    mechanism: Mechanism, workspace: Workspace, velocity: Array, acceleration: Array, out: Array
) -> None:
    """Write the accelerations of all joints, shape (N,), and their rates to `rate`.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace, at a closed posture.
        velocity: Rates of the actuated joints [rad/s or m/s], shape (n,).
        acceleration: Their accelerations, shape (n,).
        out: Accelerations of all joints, shape (N,).
    """
    move(mechanism, workspace, velocity)
    W = workspace.W
    for i in range(len(out)):
        total = workspace.bias[i]
        for j in range(len(acceleration)):
            total += W[i, j] * acceleration[j]
        out[i] = total
