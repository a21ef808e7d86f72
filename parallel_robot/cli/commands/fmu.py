"""The command ``fmu``: a law or the simulated robot as native code without Python."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from parallel_robot.bags import output
from parallel_robot.cli.shared import add_set_argument, given
from parallel_robot.fmu.contents import (
    Contents,
    law_contents,
    loop_contents,
    plant_contents,
)
from parallel_robot.fmu.ros2_package import KINDS, ros2_package
from parallel_robot.fmu.unit import identifier, need_compiler, unit
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.config_files import scenario_of
from parallel_robot_model.configuration.plain_data import merged, with_location
from parallel_robot_sim.configuration import Configuration, configure
from trajectory_gen.configuration import with_duration

SCENARIO = 'paper_circle'
STEPS = 1000  # of the default experiment; for more, fmpy takes longer ones unless it is told


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'kind',
        choices=('law', 'plant', 'loop'),
        help='law: with its control cycle; plant: the simulated robot, its motors and sensors; '
        'loop: both, with the motion of the scenario',
    )
    parser.add_argument(
        'name', help='law, or its file; of a plant or loop the scenario, or its file'
    )
    parser.add_argument(
        '--scenario', metavar='SCENARIO', help=f'robot and limits of a law; default: {SCENARIO}'
    )
    add_set_argument(parser)
    parser.add_argument('--fmi', type=int, choices=(2, 3), default=2, help='default 2: FMI 2.0')
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument('--out', type=Path, metavar='FILE', help='the FMU; must not exist')
    target.add_argument(
        '--ros2-control',
        type=Path,
        metavar='DIR',
        help='in place of an FMU a ROS 2 package in C++ for ros2_control: a law as a controller, '
        'a plant as hardware',
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    place = arguments.out or arguments.ros2_control
    output.check_new(place, '--out' if arguments.out else '--ros2-control')
    if arguments.out:
        if place.suffix != '.fmu':
            raise InputError(f'--out must be a name and .fmu, not {place}')
        need_compiler()
    changed: Any = given(arguments)
    scenario = arguments.name
    if arguments.kind == 'law':
        changed = merged([changed, law_loader.chosen(arguments.name, changed)])
        scenario = arguments.scenario or SCENARIO
    elif arguments.ros2_control and arguments.kind == 'loop':
        raise InputError('--ros2-control is for a law or a plant, not for a loop')
    elif arguments.scenario:
        raise InputError(
            f'--scenario is for a law; the {arguments.kind} is that of {arguments.name}'
        )
    scenario = scenario_of(scenario)
    if arguments.kind == 'loop':
        changed = with_duration(scenario, changed)
    values = resolve(scenario, changed)
    begun = time.monotonic()
    with with_location(values):
        configuration = configure(values)
        contents = _contents(arguments.kind, configuration)
        if arguments.ros2_control:
            package = ros2_package(contents, configuration, arguments.kind, place.name)
            output.save_directory(place, package)
            made = f'package {place}, {place.name}/{KINDS[arguments.kind].plugin}'
        else:
            content = unit(
                contents, identifier(place.stem), arguments.fmi, STEPS * contents.period
            )
            output.save(place, content)
            made = f'fmu     {place}, FMI {arguments.fmi}.0, {len(content) / 1e3:.0f} kB'
    roles = [each.role for each in contents.variables]
    print(
        f'{made}, {roles.count("input")} inputs, {roles.count("output")} outputs, '
        f'{roles.count("parameter")} tunable parameters, {time.monotonic() - begun:.1f} s'
    )
    return 0


def _contents(kind: str, configuration: Configuration) -> Contents:
    if kind == 'law':
        return law_contents(configuration)
    if kind == 'plant':
        return plant_contents(configuration)
    return loop_contents(configuration)
