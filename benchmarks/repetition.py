"""What repetitive control gains from turn to turn: the table of docs/laws.md.

Usage: python benchmarks/repetition.py [robots] [KEY=VALUE ...]

The paper's circle with disturbances that come back in each turn, with some that do not, and
the robots of config/studies/laboratory.yaml. True error of the end effector over a turn, rms: the
last of eleven without learning, then those after 3 and 10 turns of learning.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np

from parallel_robot.bags.output import tracked
from parallel_robot.studies.sweep import plan, study
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import yaml_file
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import simulate

LAWS = ('s_fotsmc', 'pid', 'lqg_tracking', 'tdc', 'computed_torque')
TURNS = 11
AFTER = (3, 10)
NOISE = {
    'sensor.stamp': 'measured', 'sensor.delay': 0.002, 'sensor.position_noise': 5e-6,
    'sensor.velocity_noise': 0.005, 'disturbance.bandwidth': 10.0,
}  # fmt: skip
COGGING: dict[str, Any] = {'disturbance.ripple': 0.5, 'approach.duration': 0.4}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    'masses + 10 %, friction, cogging': ('heavy_circle', COGGING),
    '5 N m at 3 Hz': ('disturbed_circle', {'approach.duration': 0.4}),
    'the first with noise': ('heavy_circle', {**COGGING, **NOISE, 'disturbance.noise': 0.5}),
}


def main() -> None:
    """Print the errors of each case."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 32
    learning = {'repetition.gain': 0.5, **yaml_file.parse_assignments(sys.argv[2:])}
    for name, (scenario, given) in CASES.items():
        show(name, {law: errors(scenario, law, given, learning) for law in LAWS})
    asked = study.parse(study.read(study.file_of('laboratory')), 'laboratory')
    planned = plan.plan(replace(asked, laws=tuple(x for x in asked.laws if x.name == 'pid')))
    rows = planned.rows(0, 0, count)
    found: dict[str, list[Array]] = {law: [] for law in LAWS}
    for row in tracked(rows, len(rows), 'robots'):
        for law in LAWS:
            found[law].append(
                errors(
                    row.scenario,
                    law,
                    dict(row.overrides),
                    learning,
                )
            )
    show(
        f'{len(rows)} robots of laboratory, median',
        {law: np.median(np.array(all_), axis=0) for law, all_ in found.items()},
    )


def errors(scenario: str, law: str, given: dict[str, Any], learning: dict[str, Any]) -> Array:
    """Errors without learning and after AFTER turns [um]; inf for a robot that is lost."""
    without = of_turns(scenario, law, {**given, 'repetition.gain': 0.0})
    return np.array([without[-1], *of_turns(scenario, law, {**given, **learning})[list(AFTER)]])


def of_turns(scenario: str, law: str, given: dict[str, Any]) -> Array:
    """Error of each turn [um], shape (TURNS,)."""
    values = resolve(scenario, {**given, 'law': law})
    turn = round(2.0 * np.pi / values['circle.rate'] / values['period'])
    values['duration'] = TURNS * turn * values['period']
    try:
        made = simulate(configure(values))
    except ParallelRobotError:
        return np.full(TURNS, np.inf)
    if made.fault:
        return np.full(TURNS, np.inf)
    error = (made.run.pose - made.reference.pose)[: TURNS * turn, :2]
    squares: Array = (error**2).sum(axis=1).reshape(TURNS, turn)
    return np.asarray(1e6 * np.sqrt(squares.mean(axis=1)))


def show(name: str, found: dict[str, Array]) -> None:
    """Print a case."""
    print(f'{name}: without, after {", ".join(map(str, AFTER))} turns [um]')
    for law, values in found.items():
        print(f'  {law:<16}' + ''.join(f'{value:9.3g}' for value in values), flush=True)


if __name__ == '__main__':
    main()
