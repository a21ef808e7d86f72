"""A worker process of a sweep: it runs the tasks that come through a pipe."""

from __future__ import annotations

import sys
from multiprocessing.connection import Connection

from parallel_robot.studies.sweep.run_chunk import run_task
from parallel_robot_model.common.errors import first_line


def main(descriptor: int) -> None:
    """Answer tasks until the other end of the pipe is closed.

    Args:
        descriptor: File descriptor of this end.
    """
    pipe: Connection = Connection(descriptor)
    try:
        pipe.send(None)  # ready
        while True:
            task = pipe.recv()
            try:
                answer = run_task(task)
            except Exception as error:
                pipe.send(first_line(error))
            else:
                pipe.send(answer)
    except (EOFError, OSError):  # the sweep has ended
        return


if __name__ == '__main__':
    main(int(sys.argv[1]))
