"""A process that keeps time: priority, memory, its thread; whether nodes can hear each other."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import platform
import resource
import socket
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path

from parallel_robot_model.common.errors import InputError

LOOP = 20  # priority of SCHED_FIFO: above normal work, below the interrupt threads of Linux (50)
LISTENER = 10  # of nodes that must not delay the loop, nor fall behind: resending costs more
NORMAL = 'normal'
LOCKED = 'memory locked'
SLICE = 100_000  # ns, the shortest that Linux grants
SCHED_SETATTR = {'x86_64': 314, 'aarch64': 274}  # system call; that after it is sched_getattr
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4  # Linux: present pages, future pages, once used


def acquire(priority: int) -> str:
    """Give all threads of this process, and those to come, what the system permits.

    That is a real-time priority, else a negative nice value, else a short slice, which every user
    may take; and locked memory. All threads need it: those of the middleware carry the messages to
    the others. Call it after all slow work is done, because a busy thread with real-time
    priority leaves no time to normal ones.

    Args:
        priority: LOOP, LISTENER or 0: nothing is asked for.

    Returns:
        What was permitted, e.g. ``'SCHED_FIFO 20, memory locked'``, ``'nice -10'``,
        ``'normal, slice 0.1 ms'``, ``'normal'``.
    """
    if not priority:
        return NORMAL
    schedule = _schedule(priority)
    return f'{schedule}, {LOCKED}' if _lock_memory() else schedule


def lower_priority() -> None:
    """Let all others of the real-time priority of the calling thread interrupt it."""
    priority = os.sched_getparam(0).sched_priority
    if os.sched_getscheduler(0) == os.SCHED_FIFO and priority > 1:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority - 1))


def _schedule(priority: int) -> str:
    """Take the best that is permitted, up to the limit of the user."""
    for wanted in (priority, min(priority, _highest(resource.RLIMIT_RTPRIO))):
        if wanted and _fifo(wanted):
            return f'SCHED_FIFO {wanted}'
    nice = -priority // 2
    for wanted in (nice, max(nice, 20 - _highest(resource.RLIMIT_NICE))):
        if wanted < 0 and _nice(wanted):
            return f'nice {wanted}'
    return f'{NORMAL}, slice {SLICE * 1e-6:g} ms' if _slice(SLICE) else NORMAL


def _fifo(priority: int) -> bool:
    """Take a real-time priority; returns whether that was permitted."""
    parameter = os.sched_param(priority)
    return _all_threads(lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, parameter))


def _nice(value: int) -> bool:
    """Take a nice value; returns whether that was permitted."""
    permitted = _all_threads(lambda thread: os.setpriority(os.PRIO_PROCESS, thread, value))
    if permitted:
        _nice_session(value)
    return permitted


class _Attributes(ctypes.Structure):
    """struct sched_attr of Linux."""

    _fields_ = (
        ('size', ctypes.c_uint32),
        ('policy', ctypes.c_uint32),
        ('flags', ctypes.c_uint64),
        ('nice', ctypes.c_int32),
        ('priority', ctypes.c_uint32),
        ('runtime', ctypes.c_uint64),
        ('deadline', ctypes.c_uint64),
        ('period', ctypes.c_uint64),
    )


def _slice(nanoseconds: int) -> bool:
    """Ask for short slices: a thread with a shorter slice runs sooner (Linux 6.12)."""
    number = SCHED_SETATTR.get(platform.machine())
    if number is None:
        return False
    call = ctypes.CDLL(None).syscall

    def ask(thread: int) -> None:
        nice = os.getpriority(os.PRIO_PROCESS, thread)
        attributes = _Attributes(ctypes.sizeof(_Attributes), nice=nice, runtime=nanoseconds)
        call(number, thread, ctypes.byref(attributes), 0)

    _all_threads(ask)
    got = _Attributes()
    call(number + 1, 0, ctypes.byref(got), ctypes.sizeof(got), 0)  # sched_getattr
    return bool(got.runtime == nanoseconds)


def _nice_session(value: int) -> None:
    """Give the session a nice value: Linux may share among sessions before among threads."""
    with contextlib.suppress(OSError):
        Path('/proc/self/autogroup').write_text(str(value))


def _lock_memory() -> bool:
    """Keep in memory what is used, now and later; returns whether that was permitted.

    Under a limit of locked memory, allocations would fail once it is reached. So it is done only
    without one: when the limit is infinite, or when even a limit of zero does not hold.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    unlimited = hard == resource.RLIM_INFINITY
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard if unlimited else 0, hard))
    # Only pages in use: a stack has 8 MB, of which a thread uses little.
    locked: bool = ctypes.CDLL(None).mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0
    if not unlimited:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (soft, hard))
    return locked


def _all_threads(change: Callable[[int], object]) -> bool:
    """Change each thread of this process; returns whether that was permitted."""
    for thread in os.listdir('/proc/self/task'):
        try:
            change(int(thread))
        except ProcessLookupError:
            pass  # it has just ended
        except OSError:
            return False
    return True


def _highest(limit: int) -> int:
    """Raise a limit as far as this process may; returns its new value."""
    hard = resource.getrlimit(limit)[1]
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(limit, (hard, hard))
    return hard if hard != resource.RLIM_INFINITY else 99


# A thread that acts at absolute times: after a delay it catches up; it never drifts.

WAIT_SLICE = 0.05  # s, longest sleep between checks of the stop flag


class DeadlineThread(threading.Thread):
    """Calls ``tick(stamp)`` for every stamp of a grid, each at its time on the system clock.

    The grid consists of whole multiples of the period since the epoch, so samples of independent
    nodes carry the same stamps.
    """

    def __init__(
        self,
        period: int,
        tick: Callable[[int], None],
        failed: Callable[[Exception], None],
        lead: int = 0,
    ) -> None:
        """Prepare the thread.

        Args:
            period: Time between two stamps [ns].
            tick: What to do; called with the stamp [ns].
            failed: Called with the exception that ended `tick`; the thread ends.
            lead: How long before its stamp a tick is due [ns].
        """
        super().__init__(name='deadline', daemon=True)
        self._period = period
        self._tick = tick
        self._failed = failed
        self._lead = lead
        self._ended = False  # no Event: a signal handler that sets one can wait for itself

    def run(self) -> None:
        """Tick until :meth:`stop`."""
        offset = time.time_ns() - time.monotonic_ns()
        stamp = (time.time_ns() + self._lead) // self._period * self._period + self._period
        try:
            while not self._ended:
                left = (stamp - self._lead - offset - time.monotonic_ns()) * 1e-9
                if left > WAIT_SLICE:
                    time.sleep(WAIT_SLICE)
                    continue
                if left > 0.0:
                    time.sleep(left)
                self._tick(stamp)
                stamp += self._period
        except Exception as error:  # passed on: nothing above a thread catches it
            self._failed(error)

    def end(self) -> None:
        """Let this tick be the last; a signal handler may call this."""
        self._ended = True

    def stop(self) -> None:
        """Ask the thread to end, and wait for it unless it is the caller."""
        self.end()
        if self.is_alive() and threading.current_thread() is not self:
            self.join()


# Whether nodes of this machine can hear each other, before any is started.

DISCOVERY_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
LOCALHOST_ONLY = (
    'ROS_LOCALHOST_ONLY'  # deprecated; 1 means the range LOCALHOST, whatever DISCOVERY_RANGE is
)
FLAGS_OF, UP = 0x8913, 1  # of an interface, see netdevice(7): SIOCGIFFLAGS, IFF_UP


def prepare_discovery() -> None:
    """Limit discovery of nodes to this machine, unless the user has said where.

    Raises:
        InputError: they would be discovered nowhere.
    """
    os.environ.setdefault(DISCOVERY_RANGE, 'LOCALHOST')
    if text := discovery_warning():
        raise InputError(text)


def discovery_warning() -> str:
    """Why nodes of this process cannot be discovered; empty if they can be."""
    chosen = os.environ.get(DISCOVERY_RANGE)
    local = chosen == 'LOCALHOST' or os.environ.get(LOCALHOST_ONLY) == '1'
    if chosen == 'OFF' and not local:
        return f'{DISCOVERY_RANGE} is OFF: no node hears another; unset it, or set LOCALHOST'
    if local and not _is_up('lo'):
        return (
            'the interface lo is missing or down, over which the nodes of one machine talk; '
            'ip link set lo up'
        )
    return ''


def _is_up(interface: str) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            flags = fcntl.ioctl(probe, FLAGS_OF, struct.pack('16sH14x', interface.encode(), 0))
        except OSError:
            return False  # there is none
    return bool(struct.unpack('16sH14x', flags)[1] & UP)
