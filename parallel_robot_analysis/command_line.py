"""The command line ``parallel_robot``: one module a subcommand."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from types import ModuleType

from parallel_robot_analysis.commands import (
    analyze,
    compare,
    export,
    recover,
    replay,
    report,
    rerun,
    run,
    simulate,
    top,
)
from parallel_robot_interface.errors import InputError, ParallelRobotError

COMMANDS: dict[str, tuple[ModuleType, str]] = {
    'run': (run, 'run the nodes in processes of their own and record them'),
    'simulate': (simulate, 'run the same closed loop without ROS and record it'),
    'top': (top, 'a running graph in the terminal: rates, times, law, fault; keys act on it'),
    'analyze': (analyze, 'figures of merit and a picture of a bag'),
    'replay': (replay, 'the torques of a bag computed again, by its law or another'),
    'rerun': (rerun, 'the experiment of a bag once more, from the bag alone'),
    'report': (report, "the paper's figures and an interactive page of one bag or several"),
    'export': (export, 'a bag as a table, one row a state'),
    'recover': (recover, 'a whole bag of what is intact in a broken one'),
    'compare': (compare, "all laws on one scenario, without ROS, beside the paper's claims"),
}


def build_parser() -> argparse.ArgumentParser:
    """Make the parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog='parallel_robot', description='Sliding-mode control of a 3-RRR parallel robot.'
    )
    subparsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, (module, text) in COMMANDS.items():
        module.add_arguments(subparsers.add_parser(name, help=text, description=text))
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        0; 1 when a run failed; 2 when the input is wrong, after one line that says so.
    """
    arguments = build_parser().parse_args(words)
    try:
        code: int = COMMANDS[arguments.command][0].execute(arguments)
    except ParallelRobotError as error:
        print(f'parallel_robot {arguments.command}: {error}', file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    return code


if __name__ == '__main__':
    sys.exit(main())
