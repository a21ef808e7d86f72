"""The command ``replay``: the torques of a bag computed again, by its law or another."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from parallel_robot.analysis import pictures
from parallel_robot.analysis.replay import bag_replay
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run.recorded_robot import SECONDS
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.commands.simulate import add_set_argument, given
from parallel_robot.cli.shared import (
    NOT_IN_FOREIGN,
    add_bag_arguments,
    add_format_argument,
    bag_view,
    show,
    warn,
)
from parallel_robot_control import law_loader
from parallel_robot_model.common.errors import InputError, WholeNeededError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag, or one file of it')
    parser.add_argument(
        '--law', metavar='LAW|FILE', help='control law, or its file; default: the recorded one'
    )
    add_set_argument(parser)
    add_bag_arguments(parser)
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='picture of both torques; with --law or --set: default BAG/replay_LAW.png '
        'in a bag of the suite',
    )
    add_format_argument(parser)
    add_trust_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    changes = given(arguments)
    if arguments.law is not None:
        of_law = law_loader.chosen(arguments.law, changes)
        if changes.get('law', of_law['law']) != of_law['law']:
            raise InputError(f'--law is {arguments.law}, but --set law={changes["law"]}')
        changes |= of_law
    if arguments.figure is not None:
        pictures.check_new(arguments.figure)
    try:
        found, figure, drawn = _replayed(arguments, changes, SECONDS)
    except WholeNeededError:
        found, figure, drawn = _replayed(arguments, changes, None)
    if figure is not None:
        found.save_figure(figure)
    warn(found.warnings)
    files = [f'figure  {drawn}'] if drawn else []
    show(arguments.format, found.parts(), found.as_data(), files)
    return int(found.failed)


def _replayed(
    arguments: argparse.Namespace, changes: Mapping[str, Any], seconds: float | None
) -> tuple[bag_replay.ReplayFigures, Path | None, str]:
    """What came of it, in windows of so many seconds or at once, where it is drawn, and words."""
    figure, bag, view = arguments.figure, arguments.bag, bag_view(arguments, {})
    with bag_replay.prepared(
        bag, changes, arguments.trust, MEMORY, view=view, seconds=seconds
    ) as prepared:
        if prepared.changed and figure is None:
            if prepared.log.foreign:
                return prepared.add_up(), None, NOT_IN_FOREIGN
            figure = (bag if bag.is_dir() else bag.parent) / f'replay_{prepared.law}.png'
            pictures.check_new(figure)
        return prepared.add_up(), figure, str(figure or '')
