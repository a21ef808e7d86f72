"""A thread that acts at absolute times: after a delay it catches up; it never drifts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

SLICE = 0.05  # s, longest sleep between checks of the stop flag


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
        ahead: int = 0,
    ) -> None:
        """Prepare the thread.

        Args:
            period: Time between two stamps [ns].
            tick: What to do; called with the stamp [ns].
            failed: Called with the exception that ended `tick`; the thread ends.
            ahead: How long before its stamp a tick is due [ns].
        """
        super().__init__(name='deadline', daemon=True)
        self._period = period
        self._tick = tick
        self._failed = failed
        self._ahead = ahead
        self._ended = False  # no Event: a signal handler that sets one can wait for itself

    def run(self) -> None:
        """Tick until :meth:`stop`."""
        offset = time.time_ns() - time.monotonic_ns()
        stamp = (time.time_ns() + self._ahead) // self._period * self._period + self._period
        try:
            while not self._ended:
                left = (stamp - self._ahead - offset - time.monotonic_ns()) * 1e-9
                if left > SLICE:
                    time.sleep(SLICE)
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
