"""Processor time and memory of commands on long runs.

Usage: python benchmarks/length.py [seconds of motion ...]

Each command is a process of its own. With several lengths, the others are compared with the first.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import checkout
from rows import Row, row, show

COMMAND = [sys.executable, '-m', 'parallel_robot']
LENGTH = 3600.0  # s of motion
RATE, FRAMES = 25.0, 300  # frames a second of the video, of all of it
TARGETS = {  # s of processor, MB for LENGTH
    'simulate': (60.0, 700.0),
    'analyze': (40.0, 700.0),
    'identify': (None, 700.0),
}


def commands(seconds: float, folder: Path) -> dict[str, list[str]]:
    """What is measured, by name; each makes what the next ones need."""
    bag, motion = str(folder / 'bag'), ['paper_circle', '--duration', f'{seconds:g}']
    files = ['--json', str(folder / 'run.json'), '--figure', str(folder / 'run.png')]
    words = {
        'simulate': [*motion, '--out', bag],
        'analyze': [bag, *files],
        'export': [bag, '--out', str(folder / 'run.parquet')],
        'replay': [bag],
        'identify': [bag],
        'report': [bag, '--out', str(folder / 'report')],
        'video': [
            bag,
            '--out',
            str(folder / 'run.mp4'),
            '--speed',
            f'{seconds / FRAMES * RATE:g}',
        ],
    }
    return {name: [*COMMAND, name, *more] for name, more in words.items()}


def measured(command: Sequence[str]) -> tuple[float, float]:
    """Processor time [s] and largest resident memory [MB] of a command."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=checkout.ROOT)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f'exit code {process.returncode}: {" ".join(command)}')
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def figures(seconds: float) -> list[Row]:
    """Time and memory of every command on a run of some length."""
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        for name, command in commands(seconds, Path(folder)).items():
            time, memory = measured(command)
            most = TARGETS.get(name, ()) if seconds == LENGTH else ()
            targets = [*(f'<= {each:g}' if each else '' for each in most), '', '']
            lines += [
                row(f'{name}, {seconds:g} s of motion', 's', [time], targets[0]),
                row(f'{name}, {seconds:g} s of motion, memory', 'MB', [memory], targets[1]),
            ]
    return lines


def main() -> None:
    """Measure all lengths; print times and memory, and their ratios to those of the first."""
    lengths = [float(word) for word in sys.argv[1:]] or [LENGTH]
    with tempfile.TemporaryDirectory() as folder:  # machine code is there
        for command in commands(1.0, Path(folder)).values():
            measured(command)
    first = figures(lengths[0])
    lines = [*first]
    for seconds in lengths[1:]:
        others = figures(seconds)
        lines += others
        for one, base in zip(others, first, strict=True):
            lines.append(row(f'{one["name"]}, times', 'x', [one['median'] / base['median']]))
    show(lines)


if __name__ == '__main__':
    main()
