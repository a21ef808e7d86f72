"""The command ``fmu``: a law or the simulated robot as an FMU, native code without Python."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from parallel_robot.bags import new_files
from parallel_robot.cli.commands.simulate import add_scenario_argument, add_set_argument, given
from parallel_robot.fmu.contents import Contents, law_contents, plant_contents
from parallel_robot.fmu.unit import identifier, unit
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration.placed import locating, merged
from parallel_robot_model.configuration.robot_names import scenario_of
from parallel_robot_sim.configuration import configure

DURATION = 12.0  # s, of the default experiment where the scenario has none


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    kinds = parser.add_subparsers(dest='kind', required=True, metavar='WHAT')
    law = kinds.add_parser('law', help='a law with its control cycle: limits, faults, estimator')
    law.add_argument('law', help='name of a law, or its file')
    law.add_argument(
        '--scenario', default='paper_circle', help='whose robot and limits; default paper_circle'
    )
    plant = kinds.add_parser('plant', help='the simulated robot: friction, motors, sensors, noise')
    add_scenario_argument(plant)
    for each in (law, plant):
        add_set_argument(each)
        each.add_argument('--fmi', type=int, choices=(2, 3), default=2, help='default 2, FMI 2.0')
        each.add_argument('--out', type=Path, required=True, metavar='FILE', help='must not exist')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    new_files.check(arguments.out, '--out')
    changed: Any = given(arguments)
    if arguments.kind == 'law':
        changed = merged([changed, _chosen(arguments.law)])
    values = resolve(scenario_of(arguments.scenario), changed)
    begun = time.monotonic()
    with locating(values):
        configuration = configure(values)
        contents: Contents = (
            law_contents(configuration.control)
            if arguments.kind == 'law'
            else plant_contents(configuration.plant)
        )
        content = unit(
            contents,
            identifier(arguments.out.stem),
            arguments.fmi,
            configuration.loop.duration or DURATION,
        )
    new_files.save(arguments.out, content)
    roles = [each.role for each in contents.variables]
    print(
        f'fmu     {arguments.out}, FMI {arguments.fmi}.0, {len(content) / 1e3:.0f} kB, '
        f'{roles.count("input")} inputs, {roles.count("output")} outputs, '
        f'{roles.count("parameter")} tunable parameters, {time.monotonic() - begun:.1f} s'
    )
    return 0


def _chosen(law: str) -> dict[str, Any]:
    """Keys that choose a law by its name, or by its file."""
    path = Path(law)
    if path.suffix == '.py':
        return {'law': path.stem, 'custom_laws': [str(path.absolute())]}
    return {'law': law}
