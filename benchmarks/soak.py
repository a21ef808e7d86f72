"""The loop for ten minutes with its recorder: memory, rate, losses.

Usage: python benchmarks/soak.py [--duration SECONDS]

Writes its section of docs/safety.md when the duration is at least the default. The exit code
is 1 when memory grows, a state is missing, or a message is lost.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml
from graph_processes import memory, nodes_below
from reliability import endurance, page

from parallel_robot.bags.run import recording

DURATION = 600.0  # s
LOOK = 1.0  # s, between two looks at the memory


def main() -> int:
    """Run, look, judge."""
    parser = argparse.ArgumentParser(description='Run the loop for a long time.')
    parser.add_argument('--duration', type=float, default=DURATION, metavar='S')
    duration = parser.parse_args().duration
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # ends its nodes
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / 'bag'
        command = [sys.executable, '-m', 'parallel_robot.cli.command_line', 'run']
        command += ['paper_circle', '--duration', str(duration), '--out', str(bag)]
        process = subprocess.Popen(command, cwd=folder)
        try:
            grown = watch(process)
        finally:
            process.terminate()  # if it still runs
            process.wait()
        if not bag.exists():
            print(f'soak: the run ended with code {process.returncode}', file=sys.stderr)
            return 1
        facts = yaml.safe_load((bag / 'metadata.yaml').read_text())
        recorded = facts['rosbag2_bagfile_information']['duration']['nanoseconds'] * 1e-9
        log, past, _ = recording.read(bag)
        soak = endurance.judge(duration, grown, log, past.lost, recorded, process.returncode)
    text = page.soak(soak)
    print(text)
    if duration >= DURATION:
        page.write('soak', text)
    for failure in soak.failures:
        print(f'soak: {failure}', file=sys.stderr)
    return int(bool(soak.failures))


def watch(process: subprocess.Popen[bytes]) -> dict[str, list[tuple[float, float]]]:
    """(time since the first look [s], resident memory [B]) of each node, until a run ends."""
    found: dict[str, list[tuple[float, float]]] = {}
    begun = time.monotonic()
    while process.poll() is None:
        for name, pid in nodes_below(process.pid).items():
            with contextlib.suppress(OSError, IndexError):  # it has just ended
                found.setdefault(name, []).append((time.monotonic() - begun, memory(pid)))
        time.sleep(LOOK)
    return found


if __name__ == '__main__':
    sys.exit(main())
