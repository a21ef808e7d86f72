"""Processor time of commands on a run of 1 s, beside the imports that any such program has.

Usage: python benchmarks/start.py [rounds]

The floor is `python -c "import rclpy, numba"`. Each command is a process of its own, in turns,
after one round that is not counted. `run` also counts the processes that it starts.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import checkout
from rows import ratios, row, show

COMMAND = [sys.executable, '-m', 'parallel_robot']
SECOND = ['paper_circle', '--law', 's_fotsmc', '--duration', '1']
FLOOR = 'import of rclpy and numba'
TARGETS = {'simulate': '<= 0.8', 'analyze': '<= 0.8', 'report': '<= 2', 'run': '<= 4'}


def commands(folder: Path) -> dict[str, list[str]]:
    """What is measured, by name; each makes what the next ones need."""
    bag = str(folder / 'bag')
    return {
        FLOOR: [sys.executable, '-c', 'import rclpy, numba'],
        'simulate': [*COMMAND, 'simulate', *SECOND, '--out', bag],
        'analyze': [*COMMAND, 'analyze', bag],
        'report': [*COMMAND, 'report', bag, '--out', str(folder / 'report')],
        'run': [*COMMAND, 'run', *SECOND, '--out', str(folder / 'run')],
        '--help': [*COMMAND, '--help'],
    }


def processor_seconds(command: list[str]) -> float:
    """Processor time of a command and of what it waited for [s]."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=checkout.ROOT)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f'exit code {process.returncode}: {" ".join(command)}')
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Run all commands in turns; print medians and their ratios to the floor."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    found: dict[str, list[float]] = {}
    for k in range(rounds + 1):
        with tempfile.TemporaryDirectory() as folder:
            for name, command in commands(Path(folder)).items():
                taken = processor_seconds(command)
                if k:
                    found.setdefault(name, []).append(taken)
    floor = found[FLOOR]
    lines = [row(name, 's', taken, TARGETS.get(name, '')) for name, taken in found.items()]
    others = [name for name in found if name != FLOOR]
    lines += [row(f'{name}, times the floor', 'x', ratios(found[name], floor)) for name in others]
    show(lines)


if __name__ == '__main__':
    main()
