"""The command ``rerun``: the experiment of a bag once more, from the bag alone."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from pathlib import Path

from parallel_robot.analysis.replay import bag_rerun
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.commands import run, simulate
from parallel_robot.cli.shared import TEXT, add_format_argument, show, warn
from parallel_robot_model.common.errors import RunError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag of simulate or run')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='new bag; must not exist; default: BAG_rerun'
    )
    parser.add_argument(
        '--duration', type=float, metavar='S', help='seconds of motion, default: as recorded'
    )
    add_format_argument(parser)
    add_trust_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    bag, code = arguments.bag, 0
    out = arguments.out or bag_rerun.default_place(bag)
    with bag_rerun.prepared(bag, arguments.duration, arguments.trust) as experiment:
        warn(experiment.warnings)
        record = simulate.record if experiment.simulated else run.record
        shown = arguments.format in (None, TEXT)  # what a run prints of itself
        try:
            with contextlib.redirect_stdout(sys.stdout if shown else io.StringIO()):
                code = record(experiment.scenario, experiment.changes, out)
        except RunError as error:
            if not os.path.lexists(out):
                raise
            warn([error])  # as in the bag, perhaps
    found = experiment.compare(out)
    show(arguments.format, found.parts(), found.as_data())
    return code or int(bool(found.difference))
