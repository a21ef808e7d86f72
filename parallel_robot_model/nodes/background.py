"""Work of a node beside its loop, how long callbacks hold that up, and its diagnostics."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.service import Service

from parallel_robot_model.processes import realtime

SWITCH = 1e-4  # s, after which a thread that runs Python gives way to one that waits; usually 5e-3
LOOK = 0.1  # s, between two looks whether the loop has ended


class Background:
    """One thread that does what it is given, in order, and one for the rest of services.

    The loop takes its turn at any time, within :data:`SWITCH`. Before :meth:`start`, the caller
    does all at once.
    """

    def __init__(self, node: Node, on_error: Callable[[Exception], None]) -> None:
        """Prepare.

        Args:
            node: The node, for the executor of its loop.
            on_error: Called with what a work raises.
        """
        self._node, self._on_error = node, on_error
        self._pool: ThreadPoolExecutor | None = None
        self._rest = ThreadPoolExecutor(
            1, 'rest', realtime.lower_priority
        )  # starts when it is needed
        self._thread = 0  # identity of the thread
        self._closed = threading.Event()

    def start(self) -> None:
        """From now on, do the work in the thread; its priority is just below the caller's."""
        self._pool = ThreadPoolExecutor(1, 'background', self._begin)

    def do(self, work: Callable[[], object]) -> None:
        """Do something soon, outside the loop; nothing after :meth:`close`."""
        if self._pool is None:
            self._guarded(work)
        elif not self._closed.is_set():
            self._pool.submit(self._guarded, work)

    def in_loop(self, work: Callable[[], object]) -> None:
        """Do something between two callbacks of the loop, and wait until it is done."""
        if not self.is_current():
            work()
            return
        done = threading.Event()

        def act() -> None:
            try:
                work()
            finally:
                done.set()

        self._node.executor.create_task(self._guarded, act)
        while not (done.wait(LOOK) or self._closed.is_set()):
            pass

    def answer(self, service: Service) -> None:
        """Let a service be answered from here, not by its executor when the callback ends."""
        callback, send = service.callback, service.send_response

        def send_later(question: Any, header: Any) -> None:
            self.do(lambda: send(callback(*question), header))

        service.callback = lambda request, response: (request, response)
        service.send_response = send_later

    def finish(self, service: Service, work: Callable[[Any], None]) -> None:
        """Do the rest of a service's work outside the loop, at once, whatever else is to be done.

        Args:
            service: The service.
            work: Is given each answer before it is sent.
        """
        send = service.send_response

        def rest(response: Any, header: Any) -> None:
            work(response)
            send(response, header)

        def send_later(response: Any, header: Any) -> None:
            if not self._closed.is_set():
                self._rest.submit(self._guarded, partial(rest, response, header))

        service.send_response = send_later

    def is_current(self) -> bool:
        """Whether the caller is the thread."""
        return threading.get_ident() == self._thread

    def close(self) -> None:
        """Finish what has begun, and do nothing more."""
        self._closed.set()
        for pool in (self._rest, self._pool):
            if pool is not None:
                pool.shutdown(cancel_futures=True)

    def _begin(self) -> None:
        realtime.lower_priority()
        self._thread = threading.get_ident()

    def _guarded(self, work: Callable[[], object]) -> None:
        try:
            work()
        except Exception as error:
            if not self._closed.is_set():  # else its publisher or service is gone
                self._on_error(error)


# How long the callbacks of a node hold its loop.


class CallbackTimes:
    """The longest callback since the last look, with its name."""

    def __init__(self, background: Background) -> None:
        """Begin to measure; what the `background` does holds nothing."""
        self._background = background
        self._longest, self._name = 0, ''

    def timed(self, name: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """A callback whose time counts under a name."""

        @functools.wraps(callback)
        def timed(*arguments: Any) -> Any:
            begun = time.perf_counter_ns()
            try:
                return callback(*arguments)
            finally:
                taken = time.perf_counter_ns() - begun
                if taken > self._longest and not self._background.is_current():
                    self._longest, self._name = taken, name

        return timed

    def take(self) -> dict[str, str]:
        """Entry of the diagnostics; none if there was no callback since the last call."""
        longest, name = self._longest, self._name
        self._longest = 0
        return {'longest callback [ms]': f'{1e-6 * longest:.3f} {name}'} if longest else {}


# Diagnostics of a node: its message, its rate and its share of a processor.

# Keys that other programs read; all others are for people.
STATE_INDEX = 'state index'  # of the plant's last published state; absent while it is held
OUTSIDE = 'outside the workspace'  # whether the plant's robot was driven out: True or False


def diagnostics_message(
    node: Node, values: Mapping[str, Any], warnings: Collection[str], alarm: str
) -> DiagnosticArray:
    """The diagnostics of a node as a message.

    Args:
        node: The node.
        values: Key to value.
        warnings: Those of the keys that tell of something unusual.
        alarm: What is wrong; empty for nothing.
    """
    level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK
    status = DiagnosticStatus(
        level=DiagnosticStatus.ERROR if alarm else level,
        name=f'{node.get_name()}: loop',
        message=alarm or ', '.join(warnings) or 'ok',
        hardware_id=node.get_fully_qualified_name(),
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = node.get_clock().now().to_msg()
    return message


class Usage:
    """Measures the rate of a node and what it uses of its processor, from call to call."""

    def __init__(self) -> None:
        """Begin to measure."""
        self._time = time.monotonic()  # s
        self._busy = time.process_time()  # s
        self._samples = 0

    def measure(self, samples: int | None) -> dict[str, str]:
        """Entries of the diagnostics since the last call.

        Args:
            samples: How many the node has handled since its start; None if it has no rhythm.
        """
        now, busy = time.monotonic(), time.process_time()
        seconds, used = now - self._time, busy - self._busy
        handled = (samples or 0) - self._samples
        self._time, self._busy, self._samples = now, busy, samples or 0
        rate = {} if samples is None else {'rate [Hz]': f'{handled / seconds:.1f}'}
        return rate | {'processor [%]': f'{100.0 * used / seconds:.1f}'}
