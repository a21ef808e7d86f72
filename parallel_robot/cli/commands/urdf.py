"""The command ``urdf``: the robot of a scenario as URDF."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.analysis.monitor import posture_of
from parallel_robot.bags import output
from parallel_robot.cli.commands.simulate import add_scenario_argument, add_set_argument, given
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration.config_files import scenario_of
from parallel_robot_model.configuration.plain_data import with_location


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_scenario_argument(parser)
    add_set_argument(parser)
    parser.add_argument(
        '--out', type=Path, metavar='FILE', help='must not exist; default: the terminal'
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.out:
        output.check_new(arguments.out, '--out')
    values = resolve(scenario_of(arguments.scenario), given(arguments))
    with with_location(values):
        posture = posture_of(values)
    if not arguments.out:
        print(posture.description, end='')
        return 0
    output.save(arguments.out, posture.description.encode())
    print(f'urdf    {arguments.out}, {len(posture.links)} links')
    for line in posture.beside.unsaid:
        print(f'unsaid  {line}')
    return 0
