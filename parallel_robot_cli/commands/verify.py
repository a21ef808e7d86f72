"""The command ``verify``: the simulated plants against MuJoCo."""

from __future__ import annotations

import argparse

from parallel_robot_bags.progress import tracked
from parallel_robot_base.errors import InputError
from parallel_robot_studies.verification import SCENARIOS, verify

TOLERANCE = 1e-9  # m or rad


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        '--robots', type=int, default=10, metavar='N', help='of each kind, default 10'
    )
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='default 0')
    parser.add_argument(
        '--duration', type=float, default=1.0, metavar='S', help='of each motion, default 1'
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.robots < 1:
        raise InputError(f'--robots must be at least 1, not {arguments.robots}')
    if arguments.seed < 0:
        raise InputError(f'--seed must not be negative, not {arguments.seed}')
    if not 0.001 <= arguments.duration <= 10.0:
        raise InputError(f'--duration must be 0.001 to 10 s, not {arguments.duration:g}')
    print(f'largest difference of the poses over {arguments.duration:g} s, [m] or [rad]')
    failed = False
    for kind in SCENARIOS:
        numbers = tracked(range(arguments.robots), arguments.robots, kind)
        found = verify(kind, numbers, arguments.seed, arguments.duration)
        worst = max(found, key=lambda difference: difference.largest)
        least = min(difference.path for difference in found)
        agrees = worst.largest < TOLERANCE
        failed |= not agrees
        print(
            f'  {kind:12} {worst.largest:8.1e}, robot {worst.robot} of {len(found)}; each moved '
            f'by {least:.2g} or more: {"agrees" if agrees else f"more than {TOLERANCE:g}"}'
        )
    return 1 if failed else 0
