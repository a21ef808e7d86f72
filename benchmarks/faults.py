"""Faults injected into a running loop: reaction, worst error, time to recover.

Usage: python benchmarks/faults.py [--quick] [--only WORDS] [--set KEY=VALUE] [--json FILE]

The whole campaign writes its section of docs/safety.md. The exit code is 1 when something
happened in a row that must not happen.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import checkout  # noqa: F401 first: the installed suite would be loaded
import numpy as np
from reliability import hosts, page
from reliability.bench import Bench
from reliability.judging import Outcome, judge
from reliability.rows import ROWS, Row

from parallel_robot_control.configuration import configure
from parallel_robot_control.controller import Controller
from parallel_robot_model.common.errors import ParallelRobotError, RunError
from parallel_robot_model.configuration import config, yaml_file
from parallel_robot_model.processes.node_processes import domain_lock
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator

ATTEMPTS = 3  # to start a loop


def campaign(
    rows: Sequence[Row], changed: Mapping[str, Any], folder: Path, far: str = ''
) -> Iterator[Outcome]:
    """Run rows, those with the same topics through the relay on one loop.

    Args:
        rows: What to do.
        changed: Configuration that differs from the defaults.
        folder: For the output of the nodes.
        far: Name of the host of the controller, if it is another one.

    Raises:
        RunError: the loop could not be started several times in a row.
    """
    failed = 0
    for relay, group in itertools.groupby(rows, key=lambda row: row.relay):
        waiting = list(group)
        while waiting:
            place = Path(tempfile.mkdtemp(dir=folder))
            try:
                with Bench(place, changed, relay, far) as bench:
                    failed = 0
                    yield from on_one_loop(waiting, bench)
            except RunError as error:
                failed += 1
                if failed == ATTEMPTS:
                    raise
                name = waiting.pop(0).name
                yield Outcome(name, 'not begun', 0.0, None, 0.0, (str(error),))


def compile_kernels(values: Mapping[str, Any]) -> None:
    """Put on disk what the nodes will need, so that they start at once."""
    Controller(configure(values))
    Simulator(configure_plant(values)).advance(np.zeros(3))


def on_one_loop(waiting: list[Row], bench: Bench) -> Iterator[Outcome]:
    """Run rows, taking them from the list, until one leaves a loop that is of no more use."""
    limit = min(bench.values['safety.torque_limit'])
    while waiting:
        outcome = judge(waiting[0].name, bench.run(waiting[0].inject), limit)
        waiting.pop(0)
        yield outcome
        if outcome.failures:
            return


def across(rows: Sequence[Row], words: Sequence[str], folder: Path) -> Iterator[Outcome]:
    """Run rows with the controller on another host: this program again, inside the near one."""
    result = folder / 'across.json'
    with hosts.two_hosts() as (near, far):
        command = [*hosts.inside(near), sys.executable, __file__, *words]
        command += ['--far', far, '--json', str(result)]
        command += [word for row in rows for word in ('--only', row.name)]
        environment = {**os.environ, **hosts.ENVIRONMENT}
        subprocess.run(command, env=environment, stdout=subprocess.DEVNULL)
        if not result.exists():
            raise RunError('no result across hosts')
        for fields in json.loads(result.read_text()):
            yield Outcome(**{**fields, 'failures': tuple(fields['failures'])})


def main() -> int:
    """Run what is wanted; write the page when that is everything."""
    arguments = parse()
    try:
        changed = yaml_file.parse_assignments(arguments.assignments)
        compile_kernels(config.resolve('paper_circle', changed))
    except ParallelRobotError as error:
        print(f'faults: {error}', file=sys.stderr)
        return 2
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # ends its nodes
    rows = [row for row in ROWS if row.quick or not arguments.quick]
    if arguments.only:
        rows = [row for row in rows if any(part in row.name for part in arguments.only)]
    if not rows:
        print(f'faults: no row has {" or ".join(arguments.only)} in its name', file=sys.stderr)
        return 2
    outcomes = []
    lock = nullcontext() if arguments.far else domain_lock()
    try:
        with tempfile.TemporaryDirectory() as name, lock:
            for outcome in outcomes_of(rows, changed, Path(name), arguments):
                outcomes.append(outcome)
                print(page.row(outcome), flush=True)
    except RunError as error:
        print(f'faults: given up: {error}', file=sys.stderr)
        return 1
    if arguments.json:
        arguments.json.write_text(json.dumps([outcome._asdict() for outcome in outcomes]))
    if not (arguments.quick or arguments.only):
        page.write('faults', page.faults(outcomes, arguments.assignments))
    failed = [outcome for outcome in outcomes if outcome.failures]
    for outcome in failed if not arguments.far else ():
        print(f'faults: {outcome.fault}: {"; ".join(outcome.failures)}', file=sys.stderr)
    return int(bool(failed))


def outcomes_of(
    rows: Sequence[Row], changed: Mapping[str, Any], folder: Path, arguments: argparse.Namespace
) -> Iterator[Outcome]:
    """Run rows, each on its hosts; those across hosts are left out where that is not permitted."""
    if arguments.far:
        yield from campaign(rows, changed, folder, arguments.far)
        return
    yield from campaign([row for row in rows if not row.across], changed, folder)
    words = [word for pair in arguments.assignments for word in ('--set', pair)]
    distant = [row for row in rows if row.across]
    try:
        if distant:
            yield from across(distant, words, folder)
    except PermissionError as error:
        print(f'faults: no rows across hosts: {error}', file=sys.stderr)


def parse() -> argparse.Namespace:
    """Arguments of the command line."""
    parser = argparse.ArgumentParser(description='Inject faults into a running loop.')
    parser.add_argument('--quick', action='store_true', help='one row of each kind')
    parser.add_argument(
        '--only', action='append', metavar='WORDS', help='rows whose name contains this'
    )
    parser.add_argument(
        '--set', action='append', default=[], dest='assignments', metavar='KEY=VALUE',
        help='change a key of the configuration',
    )  # fmt: skip
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the rows as JSON')
    parser.add_argument('--far', default='', help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == '__main__':
    sys.exit(main())
