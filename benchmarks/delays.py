"""How well the age of states is found where stamps hide it: the table of docs/noise.md.

Usage: python benchmarks/delays.py [robots] [KEY=VALUE ...]

The robots of config/studies/laboratory.yaml with `sensor.stamp: sent` and delays of 0 to 5 whole
samples, under observer_s_fotsmc. The age is identified, known, or taken to be 2 ms. True error of
the end effector over the second half of 12 s, rms.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np

from parallel_robot.bags.output import tracked
from parallel_robot.studies.sweep import plan, study
from parallel_robot_control.configuration import resolve
from parallel_robot_control.estimation.lock_in import KEPT, result
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.configuration import yaml_file
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import Simulation, simulate

LAW = 'observer_s_fotsmc'


def main() -> None:
    """Print what was found, and the errors."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 256
    changes = {'sensor.stamp': 'sent', **yaml_file.parse_assignments(sys.argv[2:])}
    asked = study.parse(study.read(study.file_of('laboratory')), 'laboratory')
    planned = plan.plan(replace(asked, laws=tuple(x for x in asked.laws if x.name == LAW)))
    rows = planned.rows(0, 0, count)
    misses, apart, kept = [], [], 0
    errors: dict[str, list[float]] = {'identified': [], 'known': [], '2 ms assumed': []}
    for row in tracked(rows, len(rows), 'robots'):
        given = {**row.overrides, **changes}
        period = float(resolve(row.scenario, given)['period'])
        delay = float(np.floor(given['sensor.delay'] / period + 0.5) * period)
        made = run(row.scenario, given, 'identify')
        if made is not None:
            found = result(made.experiment.control.setup)
            kept += found.phase == KEPT
            misses.append((found.delay - delay) / period)
            apart.append(float(np.ptp(found.of_joints)) / period)
        errors['identified'].append(error(made))
        errors['known'].append(error(run(row.scenario, given, delay)))
        errors['2 ms assumed'].append(error(run(row.scenario, given, 0.002)))
    off = np.abs(misses)
    print(f'{len(rows)} robots, default kept on {kept}')
    print(f'  exact {np.sum(off < 1e-9)}, within half a period {np.sum(off <= 0.5)}')
    print(f'  joints apart [periods]: median {np.median(apart):.3f}, largest {max(apart):.3f}')
    for name, values in errors.items():
        low, middle, high = np.percentile(values, [5, 50, 95])
        print(f'  {name:<14}{middle:8.2f} um  (5 to 95 %: {low:.2f} to {high:.2f})')
        print(f'{"":16}{max(values):8.2f} um at worst')


def run(scenario: str, given: dict[str, Any], delay: float | str) -> Simulation | None:
    """A run with a delay of the estimator; None if the robot is lost."""
    try:
        made = simulate(configure(resolve(scenario, {**given, 'estimator.delay': delay})))
    except ParallelRobotError:
        return None
    return None if made.fault else made


def error(made: Simulation | None) -> float:
    """True error over the second half [um]; inf for a robot that is lost."""
    if made is None:
        return float('inf')
    error = (made.run.pose - made.reference.pose)[made.run.steps // 2 :, :2]
    return float(1e6 * np.sqrt((error**2).sum(axis=1).mean()))


if __name__ == '__main__':
    main()
