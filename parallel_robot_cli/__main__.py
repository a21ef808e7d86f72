"""Start of the command line: Ctrl-C works before anything slow is imported."""

from __future__ import annotations

import os
import signal
import sys


def main() -> int:
    """Run the command line; returns its exit code."""
    try:
        if sys.argv[1:2] == ['node']:
            for number in (signal.SIGINT, signal.SIGTERM):  # until the node has its own handlers
                signal.signal(number, lambda *_: os._exit(0))
            signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT, signal.SIGTERM))
        else:
            signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # cleans up
            default = signal.SIGTERM, signal.SIG_DFL
            os.register_at_fork(after_in_child=lambda: signal.signal(*default))
        from parallel_robot_cli import command_line

        return command_line.main()
    except KeyboardInterrupt:
        return 130


if __name__ == '__main__':
    sys.exit(main())
