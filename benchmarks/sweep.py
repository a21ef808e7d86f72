"""Runs of a sweep per second: one worker process and two, and where the time of a run goes.

Usage: python benchmarks/sweep.py [runs] [repetitions]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import checkout  # noqa: F401
from rows import ratios, row, show

from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.plan import plan
from parallel_robot.studies.sweep.run_chunk import floor_of, run_chunk
from parallel_robot.studies.sweep.sweep import run as run_plan
from parallel_robot.studies.sweep.workers import Processes
from parallel_robot_control.configuration import resolve
from parallel_robot_sim.configuration import configure

TEXT = study.read(study.file_of('uncertain_robot')).replace('laws: [', 'laws: [s_fotsmc] # ')


def main() -> None:
    """Alternate between one worker and two; print medians and their ratio."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    repetitions = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    planned = plan(study.parse(TEXT).changed(runs, {}))
    build, run, fixed = alone(planned, min(runs, 32))
    limit = limit_alone(planned, min(runs, 32))
    rates: dict[int, list[float]] = {1: [], 2: []}
    with tempfile.TemporaryDirectory() as directory:
        for repetition in range(repetitions):
            for count, found in rates.items():
                out = Path(directory) / f'{repetition}_{count}'
                begun = time.perf_counter()
                run_plan(planned, TEXT, out, Processes(count), count)
                found.append(runs / (time.perf_counter() - begun))
    print(f'{runs} runs of {planned.study.duration:g} s, s_fotsmc, in {repetitions} repetitions')
    show(
        [
            row('one worker, start and end included', 'runs/s', rates[1]),
            row('two workers', 'runs/s', rates[2], '>= 66.7'),
            row('two workers, times one', 'x', ratios(rates[2], rates[1]), '>= 1.8'),
            row('processor time to build a configuration', 'ms', [1e3 * build]),
            row('to run and measure it', 'ms', [1e3 * run]),
            row('of which does not depend on its length', 'ms', [1e3 * fixed]),
            row('limit of a sample, once for all laws', 'ms', [1e3 * limit]),
        ]
    )


def alone(planned, count: int) -> tuple[float, float, float]:
    """Processor time of building, of running and measuring, and of a run without length [s]."""
    times = []
    for duration in (planned.study.duration, 0.01):
        rows = planned.rows(0, 0, count)
        for _ in range(2):  # the first loads the kernels and samples the motion
            begun = time.process_time()
            built = [
                configure(resolve(row.scenario, {**row.overrides, 'duration': duration}))
                for row in rows
            ]
            middle = time.process_time()
            run_chunk(built)
            ended = time.process_time()
        times.append(((middle - begun) / count, (ended - middle) / count))
    return times[0][0], times[0][1], times[1][1]


def limit_alone(planned, count: int) -> float:
    """Processor time of the limit of a sample [s]."""
    rows = planned.rows(0, 0, count)
    built = [configure(resolve(row.scenario, row.overrides)) for row in rows]
    floor_of(built[0])
    begun = time.process_time()
    for each in built:
        floor_of(each)
    return (time.process_time() - begun) / count


if __name__ == '__main__':
    main()
