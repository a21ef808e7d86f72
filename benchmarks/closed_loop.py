"""Time of the closed loop without ROS, beside MuJoCo's time for the plant alone.

Usage: python benchmarks/closed_loop.py [runs]
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

from parallel_robot_control.configuration import resolve
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import simulate

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
from mujoco_robot import open_loop

DURATION = 12.0  # s of motion


def main() -> None:
    """Alternate between both; print medians and their ratio."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    configuration = configure(resolve('paper_circle', {'duration': DURATION}))
    robot = configuration.control.robot.parameters
    run = simulate(configuration).run  # also loads the kernels
    ours, peer = [], []
    for _ in range(runs):
        ours.append(simulate(configuration).loop_time)
        begun = time.perf_counter()
        open_loop(robot, run.pose[0], run.effort[1:], 1e-3, (2.5, 2.5, 2.5), step=1e-3)
        peer.append(time.perf_counter() - begun)
    ratios = [a / b for a, b in zip(ours, peer, strict=True)]
    print(f'{runs} runs of {DURATION:g} s of motion; median (min - max)')
    for name, unit, figures in (
        ('closed loop, ode3 1 ms', 's', ours),
        ('MuJoCo, plant alone, RK4 1 ms', 's', peer),
        ('ratio', '', ratios),
    ):
        span = f'({min(figures):.3f} - {max(figures):.3f})'
        print(f'  {name:<30}{statistics.median(figures):8.3f} {unit:<2}{span}')


if __name__ == '__main__':
    main()
