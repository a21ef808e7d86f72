"""Time from a bag to arrays, beside rosbags' AnyReader with deserialize() on the same topics.

Usage: python benchmarks/reading.py [runs]
"""

from __future__ import annotations

import gc
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import checkout  # noqa: F401
import numpy as np
from rosbags.highlevel import AnyReader
from rows import ratios, row, show

from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import simulation_bag
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import simulate

DURATION = 60.0  # s of motion
NEEDED = [f'/{topic.name}' for topic in (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)]


def peer(bag: Path) -> int:
    """Deserialise every message of the three topics; only that: nothing is kept."""
    count = 0
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic in NEEDED]
        for connection, _, data in reader.messages(connections):
            reader.deserialize(data, connection.msgtype)
            count += 1
    return count


def ours(bag: Path) -> int:
    """Read the run: its three topics as arrays, and the counts of all ten."""
    log = recording.read(bag).log
    assert np.isfinite(log.reference_position).all()
    return sum(log.messages[name.removeprefix('/')].count for name in NEEDED)


def seconds(function: Callable[[Path], int], bag: Path, expected: int) -> float:
    """Time of a function, with what the one before left behind cleared away."""
    gc.collect()
    begun = time.perf_counter()
    count = function(bag)
    taken = time.perf_counter() - begun
    assert count == expected
    return taken


def main() -> None:
    """Alternate between both; print medians and their ratio."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / 'bag'
        values = config.resolve('paper_circle', {'duration': DURATION, 'time_mode': 'lockstep'})
        simulation_bag.write(bag, values, [simulate(configure(values))])
        count = 3 * len(recording.read(bag).log.time)  # also loads the kernels
        size = sum(file.stat().st_size for file in bag.iterdir())
        pairs = [(seconds(ours, bag, count), seconds(peer, bag, count)) for _ in range(runs)]
    print(f'{runs} runs, {count} messages, {size / 1e6:.1f} MB')
    own, other = zip(*pairs, strict=True)
    show(
        [
            row(f'{DURATION:g} s of a run into arrays', 's', own),
            row('the same topics by rosbags AnyReader, deserialize', 's', other),
            row('ours, times rosbags', 'x', ratios(own, other)),
        ]
    )


if __name__ == '__main__':
    main()
