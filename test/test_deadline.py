"""The thread that keeps absolute deadlines."""

import threading
import time

import pytest

from parallel_robot_model.processes.realtime import DeadlineThread

PERIOD = 2_000_000  # ns
PATIENCE = 100.0  # s; what takes so long never comes


class Ticks:
    """Runs a thread until it has ticked so often."""

    def __init__(self, count, ahead=0, on_tick=lambda stamp: None):
        self.stamps, self.times, self.errors = [], [], []
        self._count, self._on_tick = count, on_tick
        self._done = threading.Event()
        self.thread = DeadlineThread(PERIOD, self._tick, self._failed, ahead)
        self.begun = time.time_ns()
        self.thread.start()
        try:
            assert self._done.wait(PATIENCE)
        finally:
            self.thread.stop()

    def _tick(self, stamp):
        self.stamps.append(stamp)
        self.times.append(time.time_ns())
        if len(self.stamps) == self._count:
            self._done.set()
        self._on_tick(stamp)

    def _failed(self, error):
        self.errors.append(error)
        self._done.set()


def test_stamps_lie_on_the_grid_of_the_epoch_without_gaps():
    ticks = Ticks(50)
    assert all(stamp % PERIOD == 0 for stamp in ticks.stamps)
    steps = {b - a for a, b in zip(ticks.stamps, ticks.stamps[1:], strict=False)}
    assert steps == {PERIOD} and not ticks.errors


@pytest.mark.parametrize('ahead', [0, 3 * 10**9])
def test_ticks_come_when_they_are_due_and_not_before(ahead):
    ticks = Ticks(20, ahead)
    assert ticks.stamps[0] > ticks.begun + ahead
    lead = [stamp - at for stamp, at in zip(ticks.stamps, ticks.times, strict=True)]
    assert max(lead) < ahead + 200_000  # ns; the system clock itself may be slewed
    assert max(lead) > ahead - 10**9


def test_a_late_tick_is_caught_up():
    def stall(stamp):
        if stamp == first[0]:
            time.sleep(25e-9 * PERIOD)  # the load, not a wait for anything

    first = []
    ticks = Ticks(60, on_tick=lambda stamp: (first.append(stamp), stall(stamp)))
    steps = {b - a for a, b in zip(ticks.stamps, ticks.stamps[1:], strict=False)}
    assert steps == {PERIOD}
    late = [at - stamp for stamp, at in zip(ticks.stamps, ticks.times, strict=True)]
    assert late[1] > 20 * PERIOD and min(late[2:]) < late[1] - 10 * PERIOD


def test_nothing_ticks_after_stop():
    ticks = Ticks(3)
    assert not ticks.thread.is_alive()
    ticks.thread.stop()


@pytest.mark.parametrize('period', [PERIOD, 3600 * 10**9])
def test_a_thread_that_waits_can_be_stopped(period):
    thread = DeadlineThread(period, lambda stamp: None, lambda error: None)
    thread.start()
    thread.stop()
    assert not thread.is_alive()


def test_a_tick_may_stop_its_own_thread():
    ticks = Ticks(1, on_tick=lambda stamp: threading.current_thread().stop())
    assert len(ticks.stamps) == 1 and not ticks.errors


def test_an_error_is_handed_over_and_ends_the_thread():
    def fail(stamp):
        raise ValueError(stamp)

    ticks = Ticks(10**9, on_tick=fail)
    assert len(ticks.stamps) == 1
    assert [error.args for error in ticks.errors] == [(ticks.stamps[0],)]
    assert not ticks.thread.is_alive()
