"""Whether nodes of this machine can hear each other, before any is started."""

from __future__ import annotations

import fcntl
import os
import socket
import struct

from parallel_robot_model.common.errors import InputError

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
LOCALHOST_ONLY = 'ROS_LOCALHOST_ONLY'  # deprecated; 1 means the range LOCALHOST, whatever RANGE is
FLAGS_OF, UP = 0x8913, 1  # of an interface, see netdevice(7): SIOCGIFFLAGS, IFF_UP


def prepare() -> None:
    """Let nodes be heard on this machine alone, unless the user has said where.

    Raises:
        InputError: they would be heard nowhere.
    """
    os.environ.setdefault(RANGE, 'LOCALHOST')
    if text := doubt():
        raise InputError(text)


def doubt() -> str:
    """Why nodes of this process are heard nowhere; empty if they can be."""
    chosen = os.environ.get(RANGE)
    local = chosen == 'LOCALHOST' or os.environ.get(LOCALHOST_ONLY) == '1'
    if chosen == 'OFF' and not local:
        return f'{RANGE} is OFF: no node hears another; unset it, or set LOCALHOST'
    if local and not _is_up('lo'):
        return (
            'the interface lo is missing or down, over which the nodes of one machine talk; '
            'ip link set lo up'
        )
    return ''


def _is_up(interface: str) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            flags = fcntl.ioctl(asked, FLAGS_OF, struct.pack('16sH14x', interface.encode(), 0))
        except OSError:
            return False  # there is none
    return bool(struct.unpack('16sH14x', flags)[1] & UP)
