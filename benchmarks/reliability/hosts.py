"""Two hosts on one machine: network namespaces joined by a cable that can be pulled."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ENVIRONMENT = {
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
    # Namespaces share /dev/shm, which hosts do not: without this, nothing would use the cable.
    'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4',
}


CABLE = 'cable'  # the network interface of each host
MULTICAST = '224.0.0.0/4'


class Hosts(NamedTuple):
    """Names of two network namespaces, each with one end of the cable."""

    near: str
    far: str


def inside(host: str) -> list[str]:
    """Words that run a command on a host; none for this one."""
    return ['ip', 'netns', 'exec', host] if host else []


def pull(host: str) -> None:
    """Pull the cable out at a host."""
    _ip('-n', host, 'link', 'set', CABLE, 'down')


def plug(host: str) -> None:
    """Put the cable in again."""
    _ip('-n', host, 'link', 'set', CABLE, 'up')
    _ip('-n', host, 'route', 'replace', MULTICAST, 'dev', CABLE)


@contextlib.contextmanager
def two_hosts() -> Iterator[Hosts]:
    """Two hosts on one cable, for the duration of a block.

    Raises:
        PermissionError: network namespaces are not permitted here, or not possible.
    """
    hosts = Hosts(name(os.getpid(), 'near'), name(os.getpid(), 'far'))
    _remove_old()
    try:
        for host in hosts:
            _ip('netns', 'add', host)
        peer = ('peer', 'name', CABLE, 'netns', hosts.far)
        _ip('link', 'add', CABLE, 'netns', hosts.near, 'type', 'veth', *peer)
        for number, host in enumerate(hosts, 1):
            _ip('-n', host, 'address', 'add', f'10.77.0.{number}/24', 'dev', CABLE)
            _ip('-n', host, 'link', 'set', 'lo', 'up')
            plug(host)
        yield hosts
    finally:
        for host in hosts:
            with contextlib.suppress(PermissionError):
                _ip('netns', 'delete', host)


def name(process: int, end: str) -> str:
    """Name of the host that a process made for one end of its cable."""
    return f'parallel_robot_{process}_{end}'


def _remove_old() -> None:
    """Remove the hosts of processes that were killed."""
    for process, end in re.findall(r'^parallel_robot_(\d+)_(\w+)', _ip('netns', 'list'), re.M):
        if not Path(f'/proc/{process}').exists():
            _ip('netns', 'delete', name(int(process), end))


def _ip(*words: str) -> str:
    """Run iproute2's ``ip`` and return what it prints.

    Raises:
        PermissionError: it is not installed, or refuses.
    """
    if shutil.which('ip') is None:
        raise PermissionError('ip (iproute2) is not installed')
    done = subprocess.run(['ip', *words], capture_output=True, text=True)
    if done.returncode:
        raise PermissionError(f'ip {" ".join(words)}: {done.stderr.strip()}')
    return done.stdout
