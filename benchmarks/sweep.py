"""Runs of a sweep per second: one worker process and two, and where the time of a run goes.

Usage: python benchmarks/sweep.py [runs] [repetitions]
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path

from parallel_robot_analysis.study import study
from parallel_robot_analysis.study.configurations import Configurations
from parallel_robot_analysis.study.plan import plan
from parallel_robot_analysis.study.run_chunk import run_chunk
from parallel_robot_analysis.study.sweep import sweep
from parallel_robot_analysis.study.workers import Processes
from parallel_robot_control.configuration import resolve

TEXT = study.read(study.file_of('robustness')).replace('laws: [', 'laws: [s_fotsmc] # ')


def main() -> None:
    """Alternate between one worker and two; print medians and their ratio."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    repetitions = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    planned = plan(study.parse(TEXT).changed(runs, {}))
    build, run, fixed = alone(planned, min(runs, 32))
    rates: dict[int, list[float]] = {1: [], 2: []}
    with tempfile.TemporaryDirectory() as directory:
        for repetition in range(repetitions):
            for count, found in rates.items():
                out = Path(directory) / f'{repetition}_{count}'
                begun = time.perf_counter()
                sweep(planned, TEXT, out, Processes(count), count)
                found.append(runs / (time.perf_counter() - begun))
    duration = planned.study.duration
    print(f'{runs} runs of {duration:g} s, s_fotsmc; median (min - max) of {repetitions}')
    for count, found in rates.items():
        name = f'{count} worker{"s" * (count > 1)}'
        print(f'  {name:<10} {shown(found, 1)} runs/s, start and end included')
    ratios = [b / a for a, b in zip(rates[1], rates[2], strict=True)]
    print(f'  ratio      {shown(ratios, 2)}')
    print('processor time of a run in a chunk')
    print(f'  build its configuration  {1e3 * build:7.2f} ms')
    print(f'  run and measure it       {1e3 * run:7.2f} ms, of which {1e3 * fixed:.2f} ms do not')
    print('                                      depend on its length')


def alone(planned, count: int) -> tuple[float, float, float]:
    """Processor time of building, of running and measuring, and of a run without length [s]."""
    times = []
    for duration in (planned.study.duration, 0.01):
        configurations = Configurations()
        rows = planned.rows(0, 0, count)
        for _ in range(2):  # the first loads the kernels and samples the motion
            begun = time.process_time()
            built = [
                configurations.build(
                    resolve(row.scenario, {**row.overrides, 'duration': duration})
                )
                for row in rows
            ]
            middle = time.process_time()
            run_chunk(built)
            ended = time.process_time()
        times.append(((middle - begun) / count, (ended - middle) / count))
    return times[0][0], times[0][1], times[1][1]


def shown(values: list[float], digits: int) -> str:
    """Median with its span."""
    low, middle, high = min(values), statistics.median(values), max(values)
    return f'{middle:.{digits}f} ({low:.{digits}f} - {high:.{digits}f})'


if __name__ == '__main__':
    main()
