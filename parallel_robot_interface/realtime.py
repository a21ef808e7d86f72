"""Priority and memory of a process that keeps time, as far as the system permits."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
from collections.abc import Callable
from pathlib import Path

PRIORITY = 20  # of SCHED_FIFO: above all normal work, below the interrupt threads of Linux (50)
NICE = -10
NORMAL = 'normal'
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4  # Linux: what there is, what will be, when used


def acquire() -> str:
    """Give all threads of this process, and those to come, what the system permits.

    That is a real-time priority, else a negative nice value, else nothing; and locked memory. All
    threads need it: those of the middleware carry the messages to the others. Call it when all
    that is slow is done, for a busy thread of real-time priority leaves nothing to normal ones.

    Returns:
        What was permitted, e.g. ``'SCHED_FIFO 20, memory locked'``, ``'nice -10'``, ``'normal'``.
    """
    schedule = _schedule()
    return f'{schedule}, memory locked' if _lock_memory() else schedule


def _schedule() -> str:
    for priority in (PRIORITY, min(PRIORITY, _highest(resource.RLIMIT_RTPRIO))):
        if priority and _fifo(priority):
            return f'SCHED_FIFO {priority}'
    for value in (NICE, max(NICE, 20 - _highest(resource.RLIMIT_NICE))):
        if value < 0 and _nice(value):
            return f'nice {value}'
    return NORMAL


def _fifo(priority: int) -> bool:
    """Take a real-time priority; returns whether that was permitted."""
    parameter = os.sched_param(priority)
    return _all_threads(lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, parameter))


def _nice(value: int) -> bool:
    """Take a nice value; returns whether that was permitted."""
    permitted = _all_threads(lambda thread: os.setpriority(os.PRIO_PROCESS, thread, value))
    if permitted:
        with contextlib.suppress(OSError):
            # Linux may share the processor among sessions before it does among threads.
            Path('/proc/self/autogroup').write_text(str(value))
    return permitted


def _lock_memory() -> bool:
    """Keep in memory what is used, now and later; returns whether that was permitted.

    Under a limit of locked memory, allocations would fail once it is reached. So it is done only
    without one: when the limit is infinite, or when even a limit of zero does not hold.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    unlimited = hard == resource.RLIM_INFINITY
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard if unlimited else 0, hard))
    # When used: a stack has 8 MB of which a thread uses little.
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
