"""Start of the command line: Ctrl-C works before anything slow is imported."""

from __future__ import annotations

import os
import signal
import sys
from functools import partial

from parallel_robot_model.processes.termination_signals import (
    Terminated,
    terminate,
    termination_signals,
)

STREAMS = {'stdin': 'r', 'stdout': 'w', 'stderr': 'w'}  # by their numbers


def main() -> int:
    """Run the command line; returns its exit code."""
    _open_standard_streams()
    try:
        if sys.argv[1:2] == ['node']:
            for number in termination_signals():  # until the node has its own handlers
                signal.signal(number, lambda *_: os._exit(0))
            signal.pthread_sigmask(signal.SIG_UNBLOCK, termination_signals())
        else:
            interrupt, *others = termination_signals()
            if signal.getsignal(interrupt) != signal.SIG_IGN:  # as of a command in the background
                signal.signal(interrupt, terminate)
            for number in others:
                signal.signal(number, terminate)
                default = partial(signal.signal, number, signal.SIG_DFL)
                os.register_at_fork(after_in_child=default)
        from parallel_robot.cli import command_line

        return command_line.main()
    except Terminated as ended:
        return ended.exit_code
    except KeyboardInterrupt:
        return 130


def _open_standard_streams() -> None:
    """Open those that were closed, so that no file takes their place; what they get is lost."""
    for number, (name, mode) in enumerate(STREAMS.items()):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115, to the end


if __name__ == '__main__':
    sys.exit(main())
