"""Cost of the Kalman filter: processor time of a control cycle with it, beside one without.

The recorded states of the paper's circle are answered again in a compiled loop, without plant and
record, in turns; the ratio is that within a round.

Usage: python benchmarks/estimators.py [rounds]
"""

from __future__ import annotations

import sys
import time
from typing import Any

import checkout  # noqa: F401 finds the suite
import numpy as np
from rows import ratios, row, show

from parallel_robot_control.batch import States, answer
from parallel_robot_control.configuration import resolve
from parallel_robot_control.contract import JointReference
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import Simulation, simulate

LAW = 's_fotsmc'
CASES: dict[str, dict[str, Any]] = {
    'estimator none': {'estimator.kind': 'none'},
    'estimator kalman': {'estimator.kind': 'kalman'},
    'estimator kalman, states 3 ms late': {'estimator.kind': 'kalman', 'sensor.delay': 0.003},
}
NONE, KALMAN, LATE = CASES
TARGET = '<= 2'


def main() -> None:
    """Print the figures."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 31
    stamps = {'law': LAW, 'duration': 12.0, 'sensor.stamp': 'measured', 'approach.duration': 0.4}
    made = {
        name: simulate(configure(resolve('paper_circle', {**stamps, **case})))
        for name, case in CASES.items()
    }
    times: dict[str, list[float]] = {name: [] for name in CASES}
    for each in made.values():
        cost(each)  # compiles
    for _ in range(rounds):
        for name, each in made.items():
            times[name].append(cost(each))
    found = [row(f'a cycle, {name}', 'us', values) for name, values in times.items()]
    for name, target in ((KALMAN, TARGET), (LATE, '')):
        of = ratios(times[name], times[NONE])
        found.append(row(f'{name}, times none', 'x', of, target))
    show(found)


def cost(made: Simulation) -> float:
    """Processor time of a control cycle [us]."""
    control, reference, run = made.experiment.control, made.reference, made.run
    count, period = run.steps, made.experiment.loop.period
    states = States(
        run.position,
        run.velocity,
        run.effort,
        np.full(count, period),
        np.arange(count),
        np.full(count, made.age),
    )
    motion = JointReference(reference.position, reference.velocity, reference.acceleration)
    control.law.reset_memory()
    control.setup.memory.state.value = control.state
    begun = time.process_time()
    done = answer(control.setup, motion, states, run.command)
    used = time.process_time() - begun
    assert done.answered == count
    return 1e6 * used / count


if __name__ == '__main__':
    main()
