"""The options that say who runs the work of a command: processes here, or a cluster."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from parallel_robot.studies.sweep.sweep import MOST_WORKERS, default_workers
from parallel_robot.studies.sweep.workers import Cluster, Processes, Workers
from parallel_robot_model.common.errors import InputError


def add_worker_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--workers', type=int, metavar='N', help='processes, default: one for each core'
    )
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', help='run on the cluster of this dask scheduler instead'
    )


def workers_of(arguments: argparse.Namespace) -> tuple[Callable[[], Workers], int]:
    """What makes those who run the work, and how many they are.

    Raises:
        InputError: the options do not fit together.
    """
    if arguments.scheduler is not None:
        if arguments.workers is not None:
            raise InputError('--workers is for processes on this machine, not for --scheduler')
        return lambda: Cluster(arguments.scheduler), 2 * default_workers()
    count = default_workers() if arguments.workers is None else arguments.workers
    if not 1 <= count <= MOST_WORKERS:
        raise InputError(f'--workers must be from 1 to {MOST_WORKERS}, not {count}')
    return lambda: Processes(count), count
