"""Plant and closed loop beside MuJoCo's plant, C loop against C loop: time of a step.

Usage: python benchmarks/kernels.py [rounds]

Processor time, in rounds that alternate between all rows; medians, and medians of the ratios
within a round, so that a machine that is not idle harms all rows alike.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from parallel_robot_base.kernel import kernel
from parallel_robot_control.configuration import resolve
from parallel_robot_sim.assembly import assemble
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.closed_loops import LANES, run_side_by_side
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.plant import step

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
from mujoco_robot import _model

STEPS = 12_000  # the run of the paper
LAW = 's_fotsmc'


@kernel
def plant_alone(setup: Any, state: Any, command: Any, period: float, steps: int) -> Any:
    """The plant under a constant torque."""
    for _ in range(steps):
        state = step(setup, state, command, period)
    return state


def main() -> None:
    """Print the table; the last line is the same as JSON."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 31
    cases = _cases()
    rows: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(rounds):
        for name, (run_it, steps) in cases.items():
            begun = time.process_time()
            run_it()
            rows[name].append((time.process_time() - begun) / steps * 1e6)
    peer = rows['MuJoCo, implicitfast']
    print(f'{rounds} rounds; us a step, median (min); times of MuJoCo implicitfast, median')
    result = {}
    for name, times in rows.items():
        ratio = statistics.median(b / a for a, b in zip(times, peer, strict=True))
        result[name] = {'us': statistics.median(times), 'ratio': ratio}
        print(f'  {name:<34}{statistics.median(times):8.3f} ({min(times):.3f}){ratio:8.2f}')
    print(json.dumps(result))


def _cases() -> dict[str, tuple[Callable[[], Any], int]]:
    configuration = configure(resolve('paper_circle', {'law': LAW, 'duration': STEPS * 1e-3}))
    experiment = assemble(configuration)
    control, plant = experiment.control, experiment.plant
    reference = experiment.trajectory.sample(np.arange(STEPS) * 1e-3)
    row = plant.state.torque + np.array([0.3, -0.2, 0.1])
    cases: dict[str, tuple[Callable[[], Any], int]] = {
        'MuJoCo, implicitfast': (_mujoco(configuration, 'mjINT_IMPLICITFAST'), STEPS),
        'MuJoCo, RK4': (_mujoco(configuration, 'mjINT_RK4'), STEPS),
        'plant, ode3': (lambda: plant_alone(plant.setup, plant.state, row, 1e-3, STEPS), STEPS),
        f'closed loop, {LAW}': (lambda: run(control, plant, reference, 1e-3), STEPS),
        f'{LANES} closed loops side by side': (
            lambda: run_side_by_side([experiment] * LANES, reference, complete=False),
            STEPS * LANES,
        ),
    }
    for run_it, _ in cases.values():
        run_it()  # compiles
    return cases


def _mujoco(configuration: Any, integrator: str) -> Callable[[], None]:
    model = _model(configuration.plant.robot.parameters, (2.5, 2.5, 2.5), 1e-3)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, integrator)
    data = mujoco.MjData(model)
    start = np.array(configuration.plant.parameters.initial_pose)
    experiment = assemble(configuration)
    joints = experiment.trajectory.sample(0.0)
    theta, beta = joints.position[0], joints.passive[0]
    begin = np.array([*start, *np.column_stack([theta, beta - theta]).ravel()])

    def go() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos = begin
        data.qfrc_applied[3::2] = (0.3, -0.2, 0.1)
        mujoco.mj_step(model, data, STEPS)

    return go


if __name__ == '__main__':
    main()
