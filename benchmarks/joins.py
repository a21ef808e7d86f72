"""Processes that join a loop and leave, half of which change law or gains: stalls, faults, steps.

A node that stands still, plant or controller, is seen in the bag: the torque stays the same.

Usage: python benchmarks/joins.py [joins] [udp,default]
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.run import recording
from parallel_robot_control.messages import NO_FAULT

LIMITS = (0.02, 0.05, 0.2)  # s; with the last, the plant's time-out, the torque changes
SECONDS = 10.0  # for a join, at most
TRANSIENT = 1.0  # s at the start, where the torque begins with a step
RUN = [sys.executable, '-m', 'parallel_robot.cli.command_line', 'run', 'paper_circle']
JOINER = """
import sys, time, rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

PATIENCE = 60.0
rclpy.init()
node, done = rclpy.create_node('joiner'), rclpy.task.Future()
if len(sys.argv) == 1:
    node.create_subscription(JointState, 'joint_states', done.set_result, 10)
for word in sys.argv[1:]:
    key, _, value = word.partition('=')
    parameter = Parameter(key, value=value if key == 'law' else float(value))
    client = node.create_client(SetParameters, 'controller/set_parameters')
    assert client.wait_for_service(PATIENCE)
    done = client.call_async(SetParameters.Request(parameters=[parameter.to_parameter_msg()]))
rclpy.spin_until_future_complete(node, done, timeout_sec=PATIENCE)
answer = done.result()
assert isinstance(answer, JointState) or answer.results[0].successful
rclpy.shutdown()
"""
CHANGES = ([], ['law=fotsmc'], [], ['fotsmc.G=12'], [], ['law=s_fotsmc'], [], ['fotsmc.G=10'])


class Outcome(NamedTuple):
    """What joins did to a loop."""

    joins: int  # how many processes joined, did what they should, and left
    faults: tuple[str, ...]  # what the controller said
    step: float  # largest change of the applied torque in a period, after the start [N m]
    held: np.ndarray  # times for which the torque stayed the same [s]
    granted: str  # real-time priority of the controller, and the middleware


def joins(
    count: int,
    directory: Path,
    *words: str,
    changes: Sequence[list[str]] = CHANGES,
    together: int = 1,
) -> Outcome:
    """Let fresh processes join a run, then end it.

    Args:
        count: How many.
        directory: For the bag; must not exist.
        words: More arguments of `run`.
        changes: What the processes change, one after the other: KEY=VALUE; nothing: they listen.
        together: How many join at a time.
    """
    duration = str(count * SECONDS + 60.0)
    run = subprocess.Popen(
        [*RUN, '--duration', duration, '--out', str(directory), *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while run.poll() is None and not any(
        file.stat().st_size > 100_000 for file in directory.glob('*.mcap')
    ):
        time.sleep(0.1)
    with ThreadPoolExecutor(together) as pool:
        codes = list(pool.map(join, (changes[k % len(changes)] for k in range(count))))
        done = sum(code == 0 for code in codes)
    run.send_signal(signal.SIGINT)
    run.wait()
    return outcome(directory, done)


def join(changes: list[str]) -> int:
    """Let a process join, listen or change something, and leave; returns its exit code."""
    words = [sys.executable, '-c', JOINER, *changes]
    return subprocess.run(words, stderr=subprocess.DEVNULL).returncode


def outcome(bag: Path, done: int) -> Outcome:
    """Read from a bag what joins did."""
    log, past, _ = recording.read(bag)
    answered = np.flatnonzero(~np.isnan(log.answer[:, 0]))  # the last one by zero, at the end
    effort = log.effort[log.time > TRANSIENT][: answered[-1] - len(log.time)]
    steps = np.abs(np.diff(effort, axis=0)).max(axis=1)
    faults = [(status.fault, status.fault_text) for status in past.statuses]
    granted = past.parameters['/controller']
    return Outcome(
        done,
        tuple(text for (code, text), _ in itertools.groupby(faults) if code != NO_FAULT),
        float(steps.max()),
        np.diff(np.flatnonzero(steps)) * log.config['period'],
        f'{granted["granted.middleware"]}; {granted["granted.realtime"]}',
    )


def main() -> None:
    """Compare the transports."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    choices = sys.argv[2].split(',') if len(sys.argv) > 2 else ['udp', 'default']
    for choice in choices:
        with tempfile.TemporaryDirectory() as directory:
            found = joins(count, Path(directory) / 'bag', '--set', f'middleware={choice}')
        print(f'{choice}: {found.joins} of {count} joins ({found.granted})')
        counts = ', '.join(
            f'{(found.held >= limit).sum()} of {limit:g} s or more' for limit in LIMITS
        )
        print(f'  the torque waited: {counts}; longest {found.held.max():.3f} s')
        print(f'  largest step of the torque {found.step:.2f} N m')
        print(f'  faults: {", ".join(found.faults) or "none"}')


if __name__ == '__main__':
    main()
