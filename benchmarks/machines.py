"""Machines by their descriptions beside MuJoCo and Pinocchio: processor time of a call.

Usage: python benchmarks/machines.py [rounds]

The rounds alternate between all rows; ratios are of the times within a round. MuJoCo steps the
same machine without control (`mj_step`, implicitfast, its soft constraints); Pinocchio computes
the accelerations of the same joints and contacts (`constraintDynamics`), called from Python for
each sample. Ours follow a motion of half a second sampled at 1 kHz, in a compiled loop.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import checkout
import mujoco
import numpy as np
from rows import Row, ratios, row, show

import parallel_robot as pr
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.dynamics import free_acceleration, model
from parallel_robot_model.mechanisms.margins import margins

sys.path.append(str(checkout.ROOT / 'test'))
from mjcf_machines import made

SAMPLES = 500  # of a motion at 1 kHz
SPEED = 0.5  # rad/s or lengths/s
TARGETS = {'planar_3rrr': '<= 5', 'hexapod': '<= 15', 'arm': ''}  # us, of posture and model

SIMULATED = {  # scenarios, times real time
    'hexapod_circle': '>= 15', 'delta_circle': '', 'five_bar_circle': '', 'arm6_circle': '',
}  # fmt: skip


@kernel
def postures_and_models(m: Any, w: Any, q: Array, v: Array, out: Array) -> None:
    """Posture and model of each sample."""
    for k in range(len(q)):
        close(m, w, q[k])
        model(m, w, v[k], out[0], out[1], out[2, 0])


@kernel
def accelerations(m: Any, w: Any, q: Array, v: Array, out: Array) -> None:
    """Acceleration at one posture and the rates of each sample."""
    for k in range(len(q)):
        free_acceleration(m, w, v[k], out[0, 0], out[1, 0])


@kernel
def all_margins(m: Any, w: Any, q: Array, v: Array, out: Array) -> None:
    """Margins at one posture."""
    for _ in range(len(q)):
        out[0, 0, 0], out[0, 0, 1] = margins(m, w)


def main() -> None:
    """Print the figures."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 31
    runs = {name: cases(name) for name in TARGETS}
    times: dict[tuple[str, str], list[float]] = {}
    for _ in range(rounds + 1):
        for machine, found in runs.items():
            for name, run_it in found.items():
                times.setdefault((machine, name), []).append(cost(run_it))
    rows: list[Row] = []
    for (machine, name), values in times.items():
        target = TARGETS[machine] if name == 'posture and model' else ''
        rows.append(row(f'{machine}, {name}', 'us', values[1:], target))  # the first compiles
    for name, target in SIMULATED.items():
        values = [simulated(name) for _ in range(max(3, rounds // 6) + 1)][1:]
        rows.append(row(f'{name}, simulate, real time', 'x', values, target))
    for machine in TARGETS:
        peer, ours = times[machine, 'mj_step'][1:], times[machine, 'posture and model'][1:]
        rows.append(row(f'{machine}, mj_step, times that', 'x', ratios(peer, ours)))
    show(rows)


def simulated(scenario: str) -> float:
    """Simulated time of a run of a scenario over its processor time."""
    begun = time.process_time()
    run = pr.simulate(scenario)
    return float(run.time[-1]) / (time.process_time() - begun)


def cost(run_it: Callable[[], Any]) -> float:
    """Processor time of a sample [us]."""
    begun = time.process_time()
    run_it()
    return (time.process_time() - begun) / SAMPLES * 1e6


def cases(name: str) -> dict[str, Callable[[], Any]]:
    """What is measured of a machine, by name."""
    machine = made(name)
    m, w = machine.boxed()
    n = machine.n
    scale = np.where(m.turns[m.actuated] == 0.0, m.length, 1.0)
    phase = (
        2.0 * np.pi * np.arange(n) / n + 2.0 * np.pi * np.arange(SAMPLES)[:, np.newaxis] / SAMPLES
    )
    rate = 2.0 * np.pi * 1e3 / SAMPLES
    q = w.q + scale * SPEED / rate * (np.sin(phase) - np.sin(phase[0]))
    v = scale * SPEED * np.cos(phase)
    ours = (m, w, q, v, np.zeros((3, n, n)))
    close(m, w, w.q)
    found: dict[str, Callable[[], Any]] = {
        'posture and model': lambda: postures_and_models(*ours),
        'acceleration': lambda: accelerations(*ours),
        'margins': lambda: all_margins(*ours),
        'mj_step': mujoco_steps(machine, np.array(w.all)),
    }
    peer = pinocchio_accelerations(m, np.array(w.all))
    return {**found, 'Pinocchio, constraintDynamics': peer} if peer else found


def mujoco_steps(machine: Any, home: Array) -> Callable[[], None]:
    """MuJoCo's steps from home."""
    machine.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    machine.model.opt.timestep = 1e-3
    data = mujoco.MjData(machine.model)

    def go() -> None:
        mujoco.mj_resetData(machine.model, data)
        data.qpos = home
        mujoco.mj_step(machine.model, data, SAMPLES)

    return go


def pinocchio_accelerations(m: Any, home: Array) -> Callable[[], None] | None:
    """Pinocchio's accelerations at home; None where it is not installed."""
    try:
        import pinocchio as pin
    except ImportError:
        return None
    from pinocchio_tree import contacts, tree

    known = tree(m)
    data, loops, still = known.createData(), contacts(m, known), np.zeros(len(home))
    loop_data = pin.StdVec_RigidConstraintData()
    loop_data.extend(loop.createData() for loop in loops)
    pin.initConstraintDynamics(known, data, loops, loop_data)
    settings = pin.ProximalSettings(1e-10, 1e-8, 20)

    def go() -> None:
        for _ in range(SAMPLES):
            pin.constraintDynamics(known, data, home, still, still, loops, loop_data, settings)

    return go


if __name__ == '__main__':
    main()
