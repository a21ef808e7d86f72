"""All benchmarks in turn, each a process: one JSON, and docs/benchmarks.md.

Usage: python benchmarks/all.py [--only NAME ...] [--quick] [--json FILE]

The JSON has machine, versions, and every figure with its median and spread. The page is written
only when all of them have run in full. The exit code is 1 when one of them has failed; a missed
target is a figure, not a failure. The campaigns of reliability (`make faults`, `make soak`) and
joins.py are not among them.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import checkout
from benchmark_page import PAGE, page

from parallel_robot.bags.experiment import processor

TIMEOUT = 3600.0  # s for one of them
MUJOCO = 'mujoco-core' if sys.version_info >= (3, 11) else 'mujoco'  # as in setup.py
PACKAGES = ('numpy', 'numba', 'llvmlite', MUJOCO, 'mcap', 'rosbags', 'ros-jazzy-rclpy')
BENCHMARKS: dict[str, tuple[list[str], list[str]]] = {  # arguments, and those of --quick
    'kernels': (['31', '3600'], ['3', '36']),
    'machines': (['31'], ['1']),
    'calibration': (['24', '40'], ['2', '8', 'planar_3rrr']),
    'reading': (['7'], ['1']),
    'length': (['3600'], ['60']),
    'sweep': (['1000', '3'], ['8', '1']),
    'laws': (['5000'], ['200']),
    'native': (['--seconds', '60'], ['--seconds', '2']),
    'estimators': (['31'], ['1']),
    'player': (['12'], ['2']),
    'recorder': (['60'], ['4']),
    'nodes': (
        ['--rounds', '3', '--seconds', '8'],
        ['--rounds', '1', '--seconds', '4', '--starts', '1'],
    ),
}


def main() -> int:
    """Run them, write what was measured; returns the exit code."""
    given = arguments()
    now = datetime.datetime.now().astimezone().replace(microsecond=0)
    file = given.json or checkout.ROOT / 'runs' / f'bench_{now:%Y%m%d_%H%M%S}.json'
    if file.exists():
        print(f'{file} exists and is kept; name another by --json', file=sys.stderr)
        return 2
    found: dict[str, Any] = {'date': now.isoformat(), 'machine': machine(), 'benchmarks': {}}
    names = given.only or list(BENCHMARKS)
    for name in names:
        begun = time.monotonic()
        outcome = measure(name, BENCHMARKS[name][given.quick])
        outcome['seconds'] = round(time.monotonic() - begun, 1)
        found['benchmarks'][name] = outcome
    failed = [name for name in names if 'error' in found['benchmarks'][name]]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(found, indent=1) + '\n')
    print(f'figures {file}')
    if failed:
        print(f'failed: {", ".join(failed)}', file=sys.stderr)
    elif names == list(BENCHMARKS) and not given.quick:
        PAGE.write_text(page(found))
        print(f'page    {PAGE}')
    return 1 if failed else 0


def measure(name: str, words: list[str]) -> dict[str, Any]:
    """Run one benchmark: its arguments and its rows, or the reason why there are none."""
    command = [sys.executable, str(Path(__file__).with_name(f'{name}.py')), *words]
    print(f'{name} {" ".join(words)}', flush=True)
    lines: list[str] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=checkout.ROOT) as run:
        assert run.stdout is not None
        deadline = time.monotonic() + TIMEOUT
        try:
            for line in run.stdout:
                lines.append(line.rstrip('\n'))
                if not line.startswith('['):  # the JSON
                    print(f'  {line}', end='', flush=True)
                if time.monotonic() > deadline:
                    raise TimeoutError
        except BaseException:
            run.kill()
            raise
    outcome: dict[str, Any] = {'arguments': words}
    if run.returncode:
        return {**outcome, 'error': f'exit code {run.returncode}'}
    try:
        return {**outcome, 'rows': json.loads(lines[-1])}
    except (IndexError, ValueError):
        return {**outcome, 'error': 'its last line is no JSON'}


def machine() -> dict[str, Any]:
    """What was measured, and on what."""
    return {
        'processor': processor(),
        'cores': len(os.sched_getaffinity(0)),
        'system': f'{platform.system()} {platform.release()}, {platform.machine()}',
        'python': platform.python_version(),
        'versions': {name: version(name) for name in PACKAGES},
        'revision': revision(),
        'load_average': os.getloadavg()[0],
    }


def revision() -> str:
    """Commit of the checkout, with a plus when files have changed since."""
    words = ['git', '-C', str(checkout.ROOT), 'describe', '--always', '--abbrev=7', '--dirty=+']
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def arguments() -> argparse.Namespace:
    """What is to be measured."""
    parser = argparse.ArgumentParser(description='All benchmarks, one JSON and a page.')
    parser.add_argument(
        '--only', nargs='+', choices=list(BENCHMARKS), metavar='NAME', help=', '.join(BENCHMARKS)
    )
    parser.add_argument('--quick', action='store_true', help='a short run of each: do they work?')
    parser.add_argument(
        '--json', type=Path, metavar='FILE', help='default: runs/bench_DATE.json; must not exist'
    )
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
