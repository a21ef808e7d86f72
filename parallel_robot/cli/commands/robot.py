"""The command ``robot``: what a description of a machine is for the suite."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.analysis.machine import draw, facts_of, readable
from parallel_robot.bags import output
from parallel_robot.cli.shared import JSON, add_format_argument, add_set_argument, given, show
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config_files
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.robots.registry import robot_of

PICTURES = ('.png', '.pdf', '.svg')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'machine',
        metavar='FILE',
        help='description: MJCF, URDF or SDF; or the name of a shipped one',
    )
    add_set_argument(parser)
    parser.add_argument(
        '--state', metavar='Q1,Q2,..', help='actuated joints [rad, m], default: home'
    )
    parser.add_argument(
        '--rate', metavar='V1,V2,..', help='their rates [rad/s, m/s], default: zero'
    )
    parser.add_argument(
        '--plot',
        type=Path,
        metavar='FILE',
        help='draw it in three views: a new .png, .pdf or .svg',
    )
    parser.add_argument('--json', action='store_true', help='the same as --format json')
    add_format_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.plot:
        if arguments.plot.suffix not in PICTURES:
            raise InputError(f'--plot must end with {", ".join(PICTURES)}, not {arguments.plot}')
        output.check_new(arguments.plot, '--plot')
    position, velocity = (_numbers(key, getattr(arguments, key)) for key in ('state', 'rate'))
    machine = str(arguments.machine)
    if machine in config_files.builtin_machines():
        machine = str(config_files.machine_path(machine))
    elif not config_files.is_robot_scenario(machine):
        raise UnknownNameError('machine', machine, config_files.builtin_machines())
    values = resolve(machine, given(arguments))
    with with_location(values):
        facts = facts_of(robot_of(values), position, velocity)
    files = []
    if arguments.plot:
        draw(facts, arguments.plot)
        files.append(f'picture {arguments.plot}')
    show(JSON if arguments.json else arguments.format, readable(facts), facts.plain(), files)
    return 0


def _numbers(key: str, text: str | None) -> list[float]:
    """Numbers with commas between them."""
    try:
        return [float(word) for word in text.split(',')] if text else []
    except ValueError:
        raise InputError(f'--{key} must be numbers with commas between them, not {text}') from None
