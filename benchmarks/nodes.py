"""The nodes beside an empty twin of their graph: processor, round trip, losses, lockstep, start.

The twin (empty_graph.py) has the same processes, messages, rates and quality of service, and
computes nothing. Both run alternately, in pairs; ratios are medians over pairs.

Usage: python benchmarks/nodes.py [--help]
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import signal
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import graph_figures as figures
import rclpy
from graph_processes import busy, end, start
from graphs import revision, warm
from rows import Row, row

from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.connections import message_class, qos_of
from parallel_robot_model.processes.node_processes import MODULES

FIRST = {
    'trajectory': topics.REFERENCE,
    'plant': topics.JOINT_STATES,
    'controller': topics.ACTIVE_LAW,
}
PARTS = ('start', 'wall', 'lockstep')
PROCESSOR, P50, P99, LOCKSTEP = 1.3, 1.2, 1.5, 0.8  # targets of the ratios
PACKAGES = ('ros-jazzy-rclpy', 'numpy', 'numba', 'mcap')
SIDES = ('empty', 'ours')
Pairs = list[dict[str, Any]]


def alternate(pairs: int, **runs: Callable[[], Any]) -> Pairs:
    """Run each of some graphs in turn, several times over."""
    rounds = []
    for number in range(pairs):
        rounds.append({})
        for name, run in runs.items():
            print(f'... {name.replace("_", " ")}, {number + 1} of {pairs}', flush=True)
            rounds[-1][name] = run()
    return rounds


def start_times(repeats: int) -> dict[str, list[float]]:
    """Time [s] from the start of each node to its first message; of the recorder, to its bag."""
    node = rclpy.create_node('benchmark_start')
    seconds: dict[str, list[float]] = {name: [] for name in MODULES}
    for name in [name for name in MODULES for _ in range(repeats)]:
        heard: list[bytes] = []
        if topic := FIRST.get(name):
            kind = message_class(topic.type)
            node.create_subscription(kind, topic.name, heard.append, qos_of(topic), raw=True)
        with tempfile.TemporaryDirectory() as directory:
            bag = Path(directory) / 'bag'
            begun = time.perf_counter()
            process = start(
                ['-m', MODULES[name], '--ros-args', '-p', f'recorder.out:={bag}'],
                stderr=subprocess.DEVNULL,
            )
            while process.poll() is None and not heard and not bag.exists():
                rclpy.spin_once(node, timeout_sec=0.02)
            if process.poll() is not None:
                raise RuntimeError(f'{name} ended with exit code {process.returncode}')
            seconds[name].append(time.perf_counter() - begun)
            end([process], signal.SIGINT)
        for subscription in list(node.subscriptions):
            node.destroy_subscription(subscription)
    node.destroy_node()
    return seconds


def median(values: Sequence[float | None]) -> float | None:
    """Median of the figures that there are."""
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


def compare(rounds: Pairs, get: Callable[[Any], float | None], names: Sequence[str]) -> Any:
    """Medians of a figure for the twin and for ours, and the ratio of each pair."""
    empty, ours = ([_try(get, one[name]) for one in rounds] for name in names)
    ratios = [b / a for a, b in zip(empty, ours, strict=True) if a and b is not None]
    medians = {'empty': median(empty), 'ours': median(ours), 'ratio': median(ratios)}
    return {**medians, 'all': ratios, 'values': [value for value in ours if value is not None]}


def show(label: str, one: Any, target: float | None = None, sign: str = '<=') -> None:
    """Print one line of a table."""
    cells = [f'{one[name]:10.3f}' if one[name] is not None else f'{"-":>10}' for name in SIDES]
    text = f'  {label:<34}{"".join(cells)}'
    if one['ratio'] is not None:
        text += f'{one["ratio"]:9.2f} ({min(one["all"]):.2f} - {max(one["all"]):.2f})'
    print(text + (f'  {sign} {target}' if target and one['ratio'] is not None else ''))


def show_wall(rounds: Pairs) -> dict[str, Any]:
    """Print the table of wall time; returns its rows."""
    wanted: list[tuple[str, Callable[[Any], Any], float | None]] = [
        (
            f'processor, {name} [%]',
            lambda run, name=name: run['processor_percent'][name],
            PROCESSOR,
        )
        for name in MODULES
    ]
    targets = {'p50': P50, 'p99': P99, 'max': None}
    for delay in ('round_trip', 'delay'):
        wanted += [
            (
                f'{delay.replace("_", " ")}, {part} [ms]',
                lambda run, delay=delay, part=part: run[f'{delay}_ms'][part],
                target if delay == 'round_trip' else None,
            )
            for part, target in targets.items()
        ]
    wanted += [
        ('states answered [%]', lambda run: 100 * run['answered'], None),
        ('messages missing in the bag', lambda run: run['missing'], None),
        ('steady error, rms [µm]', lambda run: run['steady_rms_um'], None),
    ]
    rows = {}
    for label, get, target in wanted:
        rows[label] = {**compare(rounds, get, SIDES), 'target': target}
        show(label, rows[label], target)
    print(f'  of the bags: {_all(rounds, "missing")} missing of {_all(rounds, "messages")}')
    failed = [one[side] for one in rounds for side in SIDES if one[side]['exit_code']]
    for run in failed:
        print(f'  failed, exit code {run["exit_code"]}: {run["said"]}')
    print(f'  runs that came to their end: {2 * len(rounds) - len(failed)} of {2 * len(rounds)}')
    return rows


def show_lockstep(rounds: Pairs) -> dict[str, Any]:
    """Print the table of lockstep; returns its rows."""
    rows = {}
    for kind, label in (('', 'three nodes'), ('_recorded', 'with recorder')):
        names = f'empty{kind}', f'ours{kind}'
        rows[label] = {
            **compare(rounds, lambda run: run['steps_per_s'], names),
            'target': LOCKSTEP,
        }
        show(f'steps/s, {label}', rows[label], LOCKSTEP, '>=')
    return rows


def rows_of(result: dict[str, Any]) -> list[Row]:
    """All figures of ours, and their ratios to the twin's."""
    found = [
        row(f'{name}: start to first message', 's', seconds)
        for name, seconds in result.get('start', {}).items()
    ]
    for part, sign in (('wall', '<='), ('lockstep', '>=')):
        for label, one in result.get(part, {}).get('table', {}).items():
            name, _, unit = label.removesuffix(']').partition(' [')
            unit = 'steps/s' if part == 'lockstep' else unit
            if one['values']:
                found.append(row(f'{part}: {name}', unit, one['values']))
            if one['all']:
                target = f'{sign} {one["target"]}' if one['target'] else ''
                found.append(row(f'{part}: {name}, times the twin', 'x', one['all'], target))
    return found


def machine() -> dict[str, Any]:
    """What was measured, and on what."""
    return {
        'cores': len(os.sched_getaffinity(0)),
        'machine': platform.machine(),
        'system': platform.platform(),
        'python': platform.python_version(),
        'versions': {name: version(name) for name in PACKAGES},
        'revision': revision(),
        'load_average': os.getloadavg(),
    }


def arguments() -> argparse.Namespace:
    """What is to be measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add('--only', choices=PARTS, help='one part; default: all')
    add('--pairs', type=int, default=3, metavar='N', help='pairs of runs, default 3')
    add('--seconds', type=float, default=12.0, metavar='T', help='of each run, default 12')
    add('--starts', type=int, default=5, metavar='N', help='starts of each node, default 5')
    add(
        '--busy', type=int, default=0, metavar='N', help='busy processes per core beside all of it'
    )
    add(
        '--set',
        action='append',
        default=[],
        dest='assignments',
        metavar='KEY=VALUE',
        help="change a key of the suite's configuration; may be repeated",
    )
    add('--json', type=Path, metavar='FILE', help='write all figures there')
    return parser.parse_args()


def main() -> None:
    """Measure and print."""
    given = arguments()
    parts = [given.only] if given.only else PARTS
    result: dict[str, Any] = {'machine': machine()}
    result['options'] = {key: str(value) for key, value in vars(given).items()}
    print(json.dumps(result['machine']))
    rclpy.init(args=[])
    with contextlib.ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        warm(directory, given.assignments)
        stack.enter_context(busy(given.busy))
        if 'start' in parts:
            result['start'] = start_times(given.starts)
            print(f'start to first message [s], {given.starts} starts: median (min - max)')
            for name, seconds in result['start'].items():
                span = f'({min(seconds):.2f} - {max(seconds):.2f})'
                print(f'  {name:<12}{statistics.median(seconds):6.2f} {span}')
        listener = figures.Listener()
        common = (listener, given.seconds, directory)
        title = f'{given.pairs} pairs of {given.seconds:g} s, {given.busy} busy processes per core'
        heads = f'{"empty":>10}{"ours":>10}    ratio (min - max)  target'
        if 'wall' in parts:
            rounds = alternate(
                given.pairs,
                empty=lambda: figures.wall_empty(*common, given.assignments),
                ours=lambda: figures.wall_ours(*common, given.assignments),
            )
            print(f'wall time, {title}\n{"":<36}{heads}')
            result['wall'] = {'rounds': rounds, 'table': show_wall(rounds)}
        if 'lockstep' in parts:
            rounds = alternate(
                given.pairs,
                empty=lambda: figures.lockstep_empty(*common, False, given.assignments),
                ours=lambda: figures.lockstep_ours(*common, False, given.assignments),
                empty_recorded=lambda: figures.lockstep_empty(*common, True, given.assignments),
                ours_recorded=lambda: figures.lockstep_ours(*common, True, given.assignments),
            )
            print(f'lockstep, {title}\n{"":<36}{heads}')
            result['lockstep'] = {'rounds': rounds, 'table': show_lockstep(rounds)}
        listener.node.destroy_node()
    if given.json:
        given.json.write_text(json.dumps(result, indent=1))
    print(json.dumps(rows_of(result)))


def _try(get: Callable[[Any], float | None], run: Any) -> float | None:
    """A figure of a run, None when it has none."""
    try:
        return get(run)
    except (KeyError, TypeError):
        return None


def _all(rounds: Pairs, key: str) -> str:
    """Sum of a count over the runs of each side."""
    return ', '.join(f'{side} {sum(one[side][key] or 0 for one in rounds)}' for side in SIDES)


if __name__ == '__main__':
    main()
