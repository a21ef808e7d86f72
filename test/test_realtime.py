"""Priority and memory that a process is granted, from full privileges to none."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from parallel_robot_model.processes import realtime

SYS_NICE, IPC_LOCK = 23, 14  # capabilities
NICE = os.getpriority(os.PRIO_PROCESS, 0)
CHILD = """
import ctypes, json, os, resource, sys, threading
from parallel_robot_model.processes import realtime

without, limits, priority = map(json.loads, sys.argv[1:])
libc = ctypes.CDLL(None)
header, sets = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
assert libc.capget(header, sets) == 0
for capability in without:
    for part in range(3):
        sets[part] &= ~(1 << capability)
assert libc.capset(header, sets) == 0
for name, value in limits.items():
    resource.setrlimit(getattr(resource, name), (value, value))

end = threading.Event()
before = threading.Thread(target=end.wait, daemon=True)
before.start()
granted = realtime.acquire(priority)
after = threading.Thread(target=end.wait, daemon=True)
after.start()
threads = {
    (os.sched_getscheduler(number), os.sched_getparam(number).sched_priority,
     os.getpriority(os.PRIO_PROCESS, number))
    for number in (thread.native_id for thread in (threading.main_thread(), before, after))
}
(locked,) = (line for line in open('/proc/self/status') if line.startswith('VmLck'))
much = bytearray(100_000_000)  # more than the limits below: it would fail if it had to be locked
print(json.dumps([granted, list(threads), int(locked.split()[1]) > 0]))
"""


def child(*without, priority=realtime.LOOP, **limits):
    """What a process got, policy, priority and nice value of its threads, whether it is locked."""
    words = map(json.dumps, (without, limits, priority))
    done = subprocess.run(
        [sys.executable, '-c', CHILD, *words], capture_output=True, text=True, check=True
    )
    granted, threads, locked = json.loads(done.stdout)
    return granted, [tuple(thread) for thread in threads], locked


def lacks(capability):
    status = Path('/proc/self/status').read_text().partition('CapEff:')[2]
    return not int(status.split()[0], 16) >> capability & 1


needs_nice = pytest.mark.skipif(lacks(SYS_NICE), reason='needs the capability SYS_NICE')
needs_lock = pytest.mark.skipif(lacks(IPC_LOCK), reason='needs the capability IPC_LOCK')


@needs_nice
@needs_lock
@pytest.mark.parametrize('priority', [realtime.LOOP, realtime.LISTENER])
def test_all_threads_get_the_priority_and_locked_memory(priority):
    granted, threads, locked = child(priority=priority, RLIMIT_MEMLOCK=65536)
    assert granted == f'SCHED_FIFO {priority}, memory locked'
    assert threads == [(os.SCHED_FIFO, priority, NICE)] and locked


@needs_nice
@pytest.mark.parametrize('limit', [65536, 50_000_000])
def test_memory_that_has_a_limit_is_not_locked(limit):
    hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    if hard != resource.RLIM_INFINITY and limit > hard:
        limit = hard
    granted, threads, locked = child(IPC_LOCK, RLIMIT_MEMLOCK=limit)
    assert granted == 'SCHED_FIFO 20' and threads == [(os.SCHED_FIFO, 20, NICE)] and not locked


@needs_nice
@pytest.mark.parametrize(('priority', 'after'), [(20, 19), (1, 1), (0, 0)])
def test_a_thread_that_gives_way_is_one_below(priority, after):
    code = """
import os, sys, threading
from parallel_robot_model.processes import realtime

priority = int(sys.argv[1])
os.sched_setscheduler(0, os.SCHED_FIFO if priority else os.SCHED_OTHER, os.sched_param(priority))
thread = threading.Thread(
    target=lambda: (realtime.lower_priority(), print(os.sched_getparam(0).sched_priority))
)
thread.start()
thread.join()
print(os.sched_getparam(0).sched_priority)
"""
    done = subprocess.run(
        [sys.executable, '-c', code, str(priority)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [str(after), str(priority)]


def test_without_privileges_all_stays_as_it_is():
    nothing = {'RLIMIT_RTPRIO': 0, 'RLIMIT_NICE': 0, 'RLIMIT_MEMLOCK': 65536}
    granted, threads, locked = child(SYS_NICE, IPC_LOCK, **nothing)
    assert granted in ('normal', 'normal, slice 0.1 ms') and not locked  # by the age of Linux
    assert threads == [(os.SCHED_OTHER, 0, NICE)]


def test_a_system_that_knows_no_slices_is_left_as_it_is(monkeypatch):
    monkeypatch.setattr(realtime, 'SCHED_SETATTR', {})
    assert not realtime._slice(realtime.SLICE)


def test_nothing_is_asked_for_without_a_priority():
    granted, threads, locked = child(priority=0)
    assert granted == 'normal' and not locked
    assert threads == [(os.SCHED_OTHER, 0, NICE)]


@pytest.mark.parametrize(
    ('rtprio', 'nice', 'granted'),
    [
        (99, 40, 'SCHED_FIFO 20'),
        (resource.RLIM_INFINITY, 0, 'SCHED_FIFO 20'),
        (7, 40, 'SCHED_FIFO 7'),
        (0, 40, 'nice -10'),
        (0, 25, 'nice -5'),
        (0, 20, 'normal'),
        (0, 0, 'normal'),
    ],
)
def test_a_user_gets_as_much_as_his_limits(rtprio, nice, granted, monkeypatch):
    """A system whose user has these limits, and no capability."""
    limits = {resource.RLIMIT_RTPRIO: rtprio, resource.RLIMIT_NICE: nice}
    soft = dict.fromkeys(limits, 0)

    def raise_limit(limit, values):
        assert values[1] == limits.get(limit, 65536)
        soft[limit] = values[0]

    def schedule(thread, policy, parameter):
        allowed = soft[resource.RLIMIT_RTPRIO]
        if allowed != resource.RLIM_INFINITY and parameter.sched_priority > allowed:
            raise PermissionError

    def prioritise(kind, thread, value):
        if value < 20 - soft[resource.RLIMIT_NICE]:
            raise PermissionError

    monkeypatch.setattr(resource, 'getrlimit', lambda limit: (0, limits.get(limit, 65536)))
    monkeypatch.setattr(resource, 'setrlimit', raise_limit)
    monkeypatch.setattr(os, 'sched_setscheduler', schedule)
    monkeypatch.setattr(os, 'setpriority', prioritise)
    monkeypatch.setattr(realtime, '_lock_memory', lambda: False)
    monkeypatch.setattr(realtime, '_nice_session', lambda value: None)
    monkeypatch.setattr(realtime, '_slice', lambda value: False)
    assert realtime.acquire(realtime.LOOP) == granted
