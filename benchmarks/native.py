"""A law as native code at 1 kHz beside busy processes, and the controller node in the same run.

The native law is the library of its FMU in a host of C: woken by the clock, with real-time
priority and locked memory where the system allows them. Beside each cycle it spins for as long:
what the worst spin takes more than the median is the machine's. The node is not paced: its figure
is the time from the bytes of a joint state to the published command.

Usage: python benchmarks/native.py [--minutes M] [--seconds S] [--law LAW]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import checkout
import laws
import numpy as np
from rows import row, show

from parallel_robot.cli.command_line import main as command
from parallel_robot_sim.scenario_run import simulate

PERIOD_NS = 1_000_000
BUSY = 2  # processes for each core
PATIENT = {  # s, of the node: beside busy processes it waits
    f'safety.{key}': 60.0 for key in ('state_timeout', 'state_age', 'reference_timeout')
} | {'safety.residual_limit': 0.0}  # and it does not go where it is pushed
FIGURES = {
    'cycle': 'native cycle',
    'spin': 'a spin of the same length, beside it',
    'wake': 'native, late to wake',
}
WORST = '<= 50'  # us
NODE_CYCLES = 5000  # with more, the stamps run ahead of the clock


def burn() -> None:
    """Keep a core busy."""
    while True:
        sum(range(10_000))


def states_of(law: str) -> np.ndarray:
    """What a law takes on the paper's circle, one row a state, shape (N, 6 n + 1)."""
    run = simulate('paper_circle', law=law, duration=12.0)
    age = np.zeros((len(run.time), 1))
    parts = (
        run.position, run.velocity, run.torque, run.reference, run.reference_velocity,
        run.reference_acceleration, age,
    )  # fmt: skip
    return np.ascontiguousarray(np.hstack(parts))


def host(folder: Path) -> Path:
    """Compile the host."""
    file = folder / 'host'
    source = checkout.ROOT / 'benchmarks' / 'native_host.c'
    subprocess.run(['gcc', '-O2', '-rdynamic', str(source), '-o', str(file), '-ldl'], check=True)
    return file


def native(law: str, folder: Path, cycles: int) -> list[str]:
    """Make the host and what it needs; its command."""
    unit, states = folder / 'law.fmu', folder / 'states'
    assert command(['fmu', 'law', law, '--out', str(unit)]) == 0
    with zipfile.ZipFile(unit) as archive:
        archive.extractall(folder)
    root = ElementTree.parse(folder / 'modelDescription.xml').getroot()
    rows = states_of(law)
    rows.tofile(states)
    joints = (rows.shape[1] - 1) // 6
    library = folder / 'binaries' / 'linux64' / 'law.so'
    (torque,) = (
        variable.get('valueReference')
        for variable in root.iter('ScalarVariable')
        if variable.get('name') == 'torque[1]'
    )
    words = [host(folder), library, root.get('guid'), states, joints, cycles, PERIOD_NS, torque]
    return [*map(str, words)]


def main() -> None:
    """Print figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--minutes', type=float, default=0.0)
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--law', default='s_fotsmc')
    arguments = parser.parse_args()
    seconds = 60.0 * arguments.minutes or arguments.seconds
    busy = [
        multiprocessing.Process(target=burn, daemon=True)
        for _ in range(BUSY * (os.cpu_count() or 1))
    ]
    with tempfile.TemporaryDirectory() as folder:
        words = native(arguments.law, Path(folder), round(seconds * 1e9 / PERIOD_NS))
        laws.node_cost(arguments.law, 1, **PATIENT)  # compiles it
        for process in busy:
            process.start()
        try:
            ended = subprocess.run(words, capture_output=True, text=True, check=True)
            found: dict[str, Any] = json.loads(ended.stdout)
            node = np.array(laws.node_cost(arguments.law, NODE_CYCLES, **PATIENT))
        finally:
            for process in busy:
                process.kill()
    if found['status']:
        sys.exit('a cycle failed')
    print(
        f'{seconds:g} s, {len(busy)} busy processes; SCHED_FIFO '
        f'{"on" if found["fifo"] else "not allowed"}, memory '
        f'{"locked" if found["locked"] else "not locked"}'
    )
    figures = []
    for key, name in FIGURES.items():
        for what, figure in found[key].items():
            target = WORST if (key, what) == ('cycle', 'worst') else ''
            words = what.replace('p9999', '99.99 %')
            figures.append(row(f'{name}, {words}', 'us', [figure], target))
    for key in ('page_faults', 'allocations'):
        name = f'native, {key.replace("_", " ")} after the start'
        figures.append(row(name, '', [found[key]], '<= 0'))
    for what, figure in (
        ('median', np.median(node)),
        ('99 %', np.quantile(node, 0.99)),
        ('worst', node.max()),
    ):
        figures.append(row(f'node, bytes to command, {what}', 'us', [float(figure)]))
    show(figures)


if __name__ == '__main__':
    main()
