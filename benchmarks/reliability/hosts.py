"""Two hosts on one machine: network namespaces joined by a cable that can be pulled."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator
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
    hosts = Hosts(f'pr{os.getpid()}near', f'pr{os.getpid()}far')
    try:
        for name in hosts:
            _ip('netns', 'add', name)
        peer = ('peer', 'name', CABLE, 'netns', hosts.far)
        _ip('link', 'add', CABLE, 'netns', hosts.near, 'type', 'veth', *peer)
        for number, name in enumerate(hosts, 1):
            _ip('-n', name, 'address', 'add', f'10.77.0.{number}/24', 'dev', CABLE)
            _ip('-n', name, 'link', 'set', 'lo', 'up')
            plug(name)
        yield hosts
    finally:
        for name in hosts:
            with contextlib.suppress(PermissionError):
                _ip('netns', 'delete', name)


def _ip(*words: str) -> None:
    """Run iproute2's ``ip``.

    Raises:
        PermissionError: it is not installed, or refuses.
    """
    if shutil.which('ip') is None:
        raise PermissionError('ip (iproute2) is not installed')
    done = subprocess.run(['ip', *words], capture_output=True, text=True)
    if done.returncode:
        raise PermissionError(f'ip {" ".join(words)}: {done.stderr.strip()}')
