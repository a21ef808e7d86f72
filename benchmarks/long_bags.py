"""Memory and processor time of analyze on bags of a minute, ten minutes and an hour.

Usage: python benchmarks/long_bags.py [seconds ...]
       python benchmarks/long_bags.py --bags BAG [BAG ...]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import checkout
from rows import Row, row, show

COMMAND = [sys.executable, '-m', 'parallel_robot']
LENGTHS = [60.0, 600.0, 3600.0]  # s
HOUR = 3600.0  # s, from which on the targets count
TARGETS = {'s': '<= 40', 'MB': '<= 700'}


def used(command: list[str]) -> tuple[float, float]:
    """Processor time [s] and largest memory [MB] of a command."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=checkout.ROOT)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f'exit code {process.returncode}: {" ".join(command)}')
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3


def analysed(bag: Path, name: str, targets: bool) -> list[Row]:
    """Figures of analyze with its JSON and its picture."""
    with tempfile.TemporaryDirectory() as folder:
        files = ['--json', f'{folder}/run.json', '--figure', f'{folder}/run.png']
        values = used([*COMMAND, 'analyze', str(bag), *files])
    return [
        row(f'analyze, {name}, {unit}', unit, [value], TARGETS[unit] if targets else '')
        for unit, value in zip(TARGETS, values, strict=True)
    ]


def main() -> None:
    """Analyse bags of several lengths, each made for it."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('seconds', nargs='*', type=float, help='lengths of the bags')
    parser.add_argument('--bags', nargs='+', type=Path, default=[], help='bags that are there')
    arguments = parser.parse_args()
    found = []
    for bag in arguments.bags:
        found += analysed(bag.resolve(), bag.name, targets=False)
    for seconds in [] if arguments.bags else arguments.seconds or LENGTHS:
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / 'bag'
            length = ['--duration', f'{seconds:g}']
            used([*COMMAND, 'simulate', 'paper_circle', *length, '--out', str(bag)])
            found += analysed(bag, f'{seconds:g} s', seconds >= HOUR)
    show(found)


if __name__ == '__main__':
    main()
