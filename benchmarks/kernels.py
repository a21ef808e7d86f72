"""Plant and closed loop beside MuJoCo's plant, C loop against C loop: processor time of a step.

Usage: python benchmarks/kernels.py [rounds] [seconds of motion of the long run]

The rounds alternate between all rows; ratios are of the times within a round. MuJoCo has the same
robot, step and viscous friction, and no controller; `mj_step(model, data, n)` is its own loop. Our
plant has Coulomb friction as well.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rows import Row, ratios, row, show

from parallel_robot_control.configuration import resolve
from parallel_robot_model.compiler import kernel
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import Experiment, assemble, configure
from parallel_robot_sim.mujoco_model import coordinates_of, planar_3rrr
from parallel_robot_sim.plant import step
from trajectory_gen.trajectory import Reference

STEPS = 12_000  # the run of the paper, two turns of the circle
SHORT = 1_000  # steps of a second of motion
PERIOD = 1e-3  # s
LAW = 's_fotsmc'
TORQUE = (0.3, -0.2, 0.1)  # N m, of the plants without a controller
PLANT, LOOP = 'plant, ode3', f'closed loop, {LAW}'
FAST, EXACT = 'MuJoCo, implicitfast', 'MuJoCo, RK4'
RATIOS = (  # times the peer: name of the peer, of ours, target
    (FAST, PLANT, '>= 6'),
    (EXACT, PLANT, '>= 20'),
    (FAST, LOOP, '>= 2.5'),
)


@kernel
def plant_alone(setup: Any, state: Any, command: Any, period: float, steps: int) -> Any:
    """The plant under a constant torque."""
    for _ in range(steps):
        state = step(setup, state, command, period)
    return state


def main() -> None:
    """Print the figures."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 31
    seconds = int(sys.argv[2]) if len(sys.argv) > 2 else 3600
    configuration = configure(resolve('paper_circle', {'law': LAW, 'duration': STEPS * PERIOD}))
    experiment = assemble(configuration)
    runs = cases(experiment)
    times: dict[str, list[float]] = {name: [] for name in runs}
    for run_it, _ in runs.values():
        run_it()  # compiles
    for _ in range(rounds):
        for name, (run_it, steps) in runs.items():
            times[name].append(cost(run_it, steps))
    found = [row(name, 'us a step', values) for name, values in times.items()]
    found += [
        row(f'{peer}, times that of {ours}', 'x', ratios(times[peer], times[ours]), target)
        for peer, ours, target in RATIOS
    ]
    show(found + long_run(experiment, assemble(configuration), seconds))


def cost(run_it: Callable[[], Any], steps: int) -> float:
    """Processor time of a step [us]."""
    begun = time.process_time()
    run_it()
    return (time.process_time() - begun) / steps * 1e6


def cases(experiment: Experiment) -> dict[str, tuple[Callable[[], Any], int]]:
    """What is measured, by name, and its number of steps."""
    control, plant = experiment.control, experiment.plant
    reference = experiment.trajectory.sample(np.arange(STEPS) * PERIOD)
    torque = plant.state.torque + np.array(TORQUE)
    return {
        FAST: (mujoco_alone(experiment, mujoco.mjtIntegrator.mjINT_IMPLICITFAST), STEPS),
        EXACT: (mujoco_alone(experiment, mujoco.mjtIntegrator.mjINT_RK4), STEPS),
        PLANT: (lambda: plant_alone(plant.setup, plant.state, torque, PERIOD, STEPS), STEPS),
        LOOP: (lambda: run(control, plant, reference, PERIOD), STEPS),
    }


def mujoco_alone(experiment: Experiment, integrator: Any) -> Callable[[], None]:
    """MuJoCo's plant under a constant torque."""
    robot = experiment.trajectory.robot.parameters
    model = planar_3rrr(robot, (2.5, 2.5, 2.5), PERIOD)
    model.opt.integrator = integrator
    data = mujoco.MjData(model)
    begin = coordinates_of(robot, experiment.trajectory.sample(0.0).pose[0])

    def go() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos = begin
        data.qfrc_applied[3::2] = TORQUE
        mujoco.mj_step(model, data, STEPS)

    return go


def long_run(experiment: Experiment, other: Experiment, seconds: int) -> list[Row]:
    """A long run second by second, beside the first of another, begun after every two turns."""
    begin = other.control, other.plant
    control, plant = experiment.control, experiment.plant
    turns = experiment.trajectory.sample(np.arange(STEPS) * PERIOD)
    parts = [
        Reference(*(values[k : k + SHORT] for values in turns)) for k in range(0, STEPS, SHORT)
    ]
    single = experiment.trajectory.sample(0.0)
    calls, first, later, memory = [], [], [], []
    for k in range(max(len(parts) + 1, seconds)):
        begun = time.process_time()
        block = run(control, plant, parts[k % len(parts)], PERIOD, anew=not k)
        used = time.process_time() - begun
        control = control._replace(state=control.setup.memory.state.value)
        plant = plant._replace(state=block.plant)
        memory.append(resident())
        if k and k % len(parts) == 0:
            later.append(1e6 * used / SHORT)
            first.append(cost(lambda: run(*begin, parts[0], PERIOD), SHORT))
            calls.append(1e-3 * cost(lambda: run(*begin, single, PERIOD), 1))
    motion = f'{seconds / 3600:g} h' if seconds >= 3600 else f'{seconds} s'
    half = len(memory) // 2
    return [
        row('a call of the loop, whatever its length', 'ms', calls),
        row(f'{LOOP}, the first second, call included', 'us a step', first),
        row(f'{LOOP}, a second within {motion}, call included', 'us a step', later),
        row('a second within it, times the first', 'x', ratios(later, first), '<= 1.1'),
        row('memory that its second half adds', 'MB', [memory[-1] - memory[half]], '<= 1'),
    ]


def resident() -> float:
    """Resident memory of this process [MB]."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


if __name__ == '__main__':
    main()
