"""What each law loses on a robot as it is measured: the table of docs/noise.md.

Usage: python benchmarks/noise.py [seconds]

True error of the end effector over the second half of paper_circle, rms, and the mean change of
the torque from sample to sample, over three seeds.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_control.configuration import resolve
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import simulate

ENCODER = {'sensor.resolution': 2e-5, 'sensor.differentiate': True}
CASES: dict[str, Mapping[str, Any]] = {
    'exact': {},
    'velocity noise': {'sensor.velocity_noise': 0.01},
    'encoder': ENCODER,
    'encoder, filter': {**ENCODER, 'estimator.kind': 'filter'},
    'encoder, levant': {**ENCODER, 'estimator.kind': 'levant'},
    'states 2 ms late': {'sensor.delay': 0.002},
    'motor lag 2 ms': {'actuator.lag': 0.002},
}
SEEDS = range(3)


def main() -> None:
    """Print the table in Markdown."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 12.0
    print('| law | ' + ' | '.join(CASES) + ' |')
    print('| --- |' + ' ---: |' * len(CASES))
    for law in LAWS:
        cells = [_cell(law, changes, seconds) for changes in CASES.values()]
        print(f'| `{law}` | ' + ' | '.join(cells) + ' |', flush=True)


def _cell(law: str, changes: Mapping[str, Any], seconds: float) -> str:
    errors, steps = [], []
    for seed in SEEDS if changes else SEEDS[:1]:
        values = resolve(
            'paper_circle', {'law': law, 'duration': seconds, 'seed': seed, **changes}
        )
        try:
            made = simulate(configure(values))
        except ParallelRobotError:
            return 'lost'
        if made.fault is not None:
            return 'fault'
        half = slice(made.run.steps // 2, None)
        error = (made.run.pose - made.reference.pose)[half, :2]
        errors.append(np.sqrt((error**2).sum(axis=1).mean()))
        steps.append(np.abs(np.diff(made.run.command[half], axis=0)).mean())
    return f'{1e6 * np.mean(errors):.0f} ({np.mean(steps):.2g})'


if __name__ == '__main__':
    main()
