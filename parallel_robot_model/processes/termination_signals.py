"""The signals that end a process of the suite in order."""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType

RETRY_DELAY = 0.01  # s, after which a signal is sent once more
CALLBACKS = '_raw_object_cache_'  # methods that machine code of llvmlite calls


class Terminated(KeyboardInterrupt):
    """A signal ends the command; custom code, and who compiles it, are not to blame.

    Args:
        number: The signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_code = 128 + number


def termination_signals() -> tuple[signal.Signals, ...]:
    """Ctrl-C, a request to end, and the end of the terminal, unless `nohup` keeps that away."""
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *(() if ignored else (signal.SIGHUP,)))


def terminate(number: int, frame: FrameType | None) -> None:
    """Handle a signal: what was begun is cleaned up.

    Raises:
        Ended: always, but where nobody hears it: in a callback of the compiler, a little later.
    """
    while frame is not None:
        if frame.f_code.co_name.startswith(CALLBACKS):
            threading.Timer(RETRY_DELAY, os.kill, (os.getpid(), number)).start()
            return
        frame = frame.f_back
    raise Terminated(number)
