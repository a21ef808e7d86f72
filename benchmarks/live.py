"""What the live page costs the loop: lag and processor time, with ten browsers and without.

One graph runs; a page with its browsers comes and goes. Each round has a phase without and one
with it, one after the other; the ratio is that of one round. A browser is a WebSocket that reads;
one of them reads nothing. The first is Chromium, where it is installed.

With --asleep, only the memory of the page is measured, over some minutes. With --foxglove,
clients of `live --foxglove` that take every topic are in the place of the browsers.

Usage: python benchmarks/live.py [--rounds N] [--seconds S] [--browsers N] [--asleep MINUTES]
    [--foxglove]
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from typing import NamedTuple
from urllib.parse import urlsplit

import aiohttp
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from graph_processes import end, memory, nodes_below, start

from parallel_robot.live.command import NAMES, started_graph
from parallel_robot_model.processes.node_processes import processor_seconds

LAG = 'lag p50/p99/max [ms]'
SETTLE = 4.0  # s, from a page that begins or ends to the measurement
PATIENCE = 60.0  # s
PROTOCOL = 'foxglove.sdk.v1'
CHROMIUM = shutil.which('chromium')
HANDSHAKE = (
    'GET /frames HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n'
    'Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n'
)


class Phase(NamedTuple):
    """What was measured for some seconds."""

    lag: float  # median over the seconds of the lag's p99 [ms]
    processor: float  # of the three nodes together [% of a core]
    page: float  # of the page's process [% of a core]
    memory: float  # of the page's process at the end [MB]


def lags(node: rclpy.node.Node, seconds: float) -> float:
    """Median of what the controller reports in some seconds."""
    found: list[float] = []

    def take(array: DiagnosticArray) -> None:
        for status in array.status:
            values = {item.key: item.value for item in status.values}
            if LAG in values:
                found.append(float(values[LAG].split('/')[1]))

    subscription = node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    due = time.monotonic() + seconds
    while (left := due - time.monotonic()) > 0.0:
        rclpy.spin_once(node, timeout_sec=left)
    node.destroy_subscription(subscription)
    return float(np.median(found))


def measure(node: rclpy.node.Node, seconds: float, page: int | None) -> Phase:
    """Measure for some seconds."""
    pids = [nodes_below(os.getpid())[name] for name in NAMES]
    every = [*pids, *([page] if page else [])]
    before = {pid: processor_seconds(pid) for pid in every}
    begun = time.monotonic()
    lag = lags(node, seconds)
    passed = time.monotonic() - begun
    used = {pid: 100.0 * (processor_seconds(pid) - before[pid]) / passed for pid in every}
    held = memory(page) / 1e6 if page else 0.0
    return Phase(lag, sum(used[pid] for pid in pids), used.get(page or 0, 0.0), held)


def watch_memory(minutes: int, count: int) -> None:
    """Print the memory of the page, after each minute with browsers of which one sleeps."""
    with page() as (pid, address), browsers(address, count):
        for minute in range(minutes + 1):
            time.sleep(2.0 * SETTLE if minute == 0 else 60.0)
            print(f'{minute} min: {memory(pid) / 1e6:.1f} MB', flush=True)


@contextlib.contextmanager
def page(*more: str) -> Iterator[tuple[int, str]]:
    """The page, or the server of Foxglove, in a process of its own: its pid, its address."""
    words = ['-m', 'parallel_robot', 'live', '--port', '0', '--namespace', '/']
    process = start([*words, *more], stdout=subprocess.PIPE)
    try:
        line = process.stdout.readline() if process.stdout else ''
        yield process.pid, line.split()[-1]
    finally:
        end([process], signal.SIGINT)


@contextlib.contextmanager
def clients(address: str, count: int) -> Iterator[None]:
    """Some clients of Foxglove's protocol that take every topic."""
    readers = start([__file__, '--read', address, str(count)])
    try:
        yield
    finally:
        end([readers], signal.SIGTERM)


@contextlib.contextmanager
def browsers(address: str, count: int) -> Iterator[None]:
    """Some browsers that look at the page, of which the last sleeps."""
    host = urlsplit(address).netloc
    with contextlib.ExitStack() as stack:
        if CHROMIUM:
            folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
            switches = ['--headless=new', '--no-sandbox', '--disable-dev-shm-usage']
            words = [CHROMIUM, *switches, f'--user-data-dir={folder}', '--remote-debugging-port=0']
            made = subprocess.Popen([*words, address], stderr=subprocess.DEVNULL)
            stack.callback(end, [made], signal.SIGTERM)
        place = urlsplit(address)
        asleep = stack.enter_context(socket.create_connection((place.hostname, place.port)))
        asleep.sendall(HANDSHAKE.format(host=host).encode())
        readers = start([__file__, '--read', f'http://{host}/frames', str(count - 2)])
        stack.callback(end, [readers], signal.SIGTERM)
        yield


async def read(url: str, count: int) -> None:
    """Read as some browsers, or as clients of Foxglove's protocol, for ever."""
    protocols = [PROTOCOL] if url.startswith('ws:') else []

    async def one(client: aiohttp.ClientSession) -> None:
        async with client.ws_connect(url, protocols=protocols) as stream:
            async for message in stream:
                if protocols and message.type is aiohttp.WSMsgType.TEXT:
                    channels = json.loads(message.data).get('channels', ())
                    wanted = [{'id': each['id'], 'channelId': each['id']} for each in channels]
                    await stream.send_json({'op': 'subscribe', 'subscriptions': wanted})

    async with aiohttp.ClientSession() as client:
        await asyncio.gather(*(one(client) for _ in range(count)))


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--seconds', type=float, default=10.0)
    parser.add_argument('--browsers', type=int, default=10)
    parser.add_argument('--foxglove', action='store_true')
    parser.add_argument('--asleep', type=int, metavar='MINUTES')
    parser.add_argument('--read', nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.read:
        asyncio.run(read(arguments.read[0], int(arguments.read[1])))
        return 0
    rounds = []
    with started_graph('paper_circle', {'duration': 0.0}, ''):
        if arguments.asleep:
            watch_memory(arguments.asleep, arguments.browsers)
            return 0
        rclpy.init(args=[])
        node = rclpy.create_node('benchmark_live')
        for k in range(arguments.rounds):
            time.sleep(SETTLE)
            without = measure(node, arguments.seconds, None)
            more, watch = (['--foxglove'], clients) if arguments.foxglove else ([], browsers)
            with page(*more) as (pid, address), watch(address, arguments.browsers):
                time.sleep(2.0 * SETTLE)
                with_page = measure(node, arguments.seconds, pid)
            rounds.append((without, with_page))
            print(f'round {k + 1}: without {shown(without)}; with {shown(with_page)}', flush=True)
        node.destroy_node()
        rclpy.try_shutdown()
    for name in ('lag', 'processor'):
        ratios = [getattr(b, name) / getattr(a, name) for a, b in rounds]
        spread = f'{min(ratios):.2f} to {max(ratios):.2f}'
        print(f'{name}, with / without: {np.median(ratios):.3f} ({spread}); target: at most 1.10')
    return 0


def shown(phase: Phase) -> str:
    """A phase in words."""
    own = f', page {phase.page:.1f} % and {phase.memory:.0f} MB' if phase.page else ''
    return f'lag p99 {phase.lag:.3f} ms, nodes {phase.processor:.1f} %{own}'


if __name__ == '__main__':
    sys.exit(main())
