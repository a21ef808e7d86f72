"""The command ``limit``: the least error of any controller, in a scenario or in a study."""

from __future__ import annotations

import argparse
import csv
import io
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from parallel_robot.analysis.readable_metrics import shown
from parallel_robot.analysis.report.figures import check_format, save
from parallel_robot.bags import new_files
from parallel_robot.bags.progress import tracked
from parallel_robot.cli.commands import simulate
from parallel_robot.studies.limit.causes import CAUSES, LeastError, least_error
from parallel_robot.studies.limit.picture import draw
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.scenario_file import DEEPEST, absolute, stem
from parallel_robot_sim.configuration import Configuration, configure
from parallel_robot_sim.simulation import ENDLESS

LEVELS = (0.1, 0.2, 0.3, 0.5, 1.0, 2.0)  # N m, of chattering
ESTIMATE = 'sensor.resolution: the step of an encoder counts as noise: an estimate, no bound'
TRAVELLED = 'travelled while a state is late'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'scenario', metavar='SCENARIO|STUDY', help='a name or a file; of a study, all its robots'
    )
    parser.add_argument(
        '--runs', type=int, metavar='N', help="robots of each scenario, default: the study's"
    )
    parser.add_argument('--duration', type=float, metavar='S', help='length of the motion [s]')
    parser.add_argument(
        '--out', type=Path, metavar='FILE', help='write one row for each robot, as CSV'
    )
    parser.add_argument(
        '--calm', action='store_true', help='also the least error with at most some chattering'
    )
    parser.add_argument(
        '--figure', type=Path, metavar='FILE', help='picture of that; png, pdf, svg'
    )
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.out:
        new_files.check(arguments.out, '--out')
    if arguments.figure:
        check_format(arguments.figure)
        new_files.check(arguments.figure, '--figure')
    calm = arguments.calm or arguments.figure is not None
    found: dict[str, list[LeastError]] = {}
    planar, encoders = True, False
    for scenario, configuration in _experiments(arguments):
        if not configuration.loop.duration:
            raise InputError(ENDLESS)
        planar &= configuration.plant.robot.module.PLANAR
        encoders |= bool(np.any(configuration.values['sensor.resolution']))
        found.setdefault(scenario, []).append(least_error(configuration, calm=calm))
    if encoders:
        print(f'warning: {ESTIMATE}', file=sys.stderr)
    for scenario, members in found.items():
        print('\n'.join(_table(scenario, members, planar)))
        if calm:
            print('\n'.join(_calm_table(members, planar)))
    if arguments.out:
        try:
            new_files.write(arguments.out, _rows(found, planar).encode())
        except OSError as error:
            raise InputError(f'cannot write {arguments.out}: {error.strerror}') from None
        print(f'rows    {arguments.out}')
    if arguments.figure:
        unit = 'end-effector error, rms [µm]' if planar else 'joint error, rms [µrad]'
        try:
            save(draw(found, unit), arguments.figure)
        except OSError as error:
            raise InputError(f'cannot write {arguments.figure}: {error.strerror}') from None
        print(f'figure  {arguments.figure}')
    return 0


def _experiments(arguments: argparse.Namespace) -> Iterator[tuple[str, Configuration]]:
    """Each robot with its motion, and the name of its scenario.

    Raises:
        InputError: no such scenario or study, or an argument is wrong.
    """
    name = arguments.scenario
    if not is_study(name):
        if arguments.runs is not None:
            raise InputError(f'--runs is for studies; {name} is a scenario')
        yield stem(name), configure(resolve(name, simulate.overrides(arguments)))
        return
    from parallel_robot.studies.sweep import study  # they take long to import
    from parallel_robot.studies.sweep.plan import plan

    file = study.file_of(name)
    if arguments.duration is not None:
        raise InputError(f'--duration is for scenarios; the study {name} has its own')
    fixed = simulate.given(arguments)
    asked = study.parse(study.read(file), str(file), file.parent).changed(arguments.runs, fixed)
    planned = plan(asked)
    first = {case.scenario: k for k, case in reversed([*enumerate(planned.cases)])}
    rows = [row for k in first.values() for row in planned.rows(k, 0, asked.runs)]
    for row in tracked(rows, len(rows), 'robots'):
        yield stem(row.scenario), configure(resolve(row.scenario, row.overrides))


def is_study(name: str, bases: int = DEEPEST) -> bool:
    """Whether a name or a file is that of a study, which may have so many bases."""
    if (config.directory() / 'studies' / f'{name}.yaml').is_file():
        return True
    path = Path(name)
    if not path.is_file():
        return False
    from parallel_robot.studies.sweep.study import read

    found = plain_data.mapping(read(path))
    base = found.get('base')
    if 'scenarios' in found or not isinstance(base, str) or not bases:
        return 'scenarios' in found
    return is_study(absolute(base, path.parent), bases - 1)


def _table(scenario: str, members: list[LeastError], planar: bool) -> list[str]:
    """The least errors of some robots, as lines."""
    what, unit = ('end-effector error', 'µm') if planar else ('joint error', 'µrad')
    count = f', {len(members)} robots' if len(members) > 1 else ''
    head = f'{scenario}{count}: least {what} of any controller, rms [{unit}], second half'
    columns = {name: [1e6 * one.errors[name] for one in members] for name in CAUSES}
    travelled = [1e6 * one.travelled for one in members]
    if np.isfinite(travelled).all():
        columns[TRAVELLED] = travelled
    lines = [head]
    if len(members) > 1:
        lines.append(f'  {"":<34}{"median":>10}{"5 %":>10}{"95 %":>10}')
    for name, values in columns.items():
        figures = np.percentile(values, [50, 5, 95] if len(members) > 1 else [50])
        lines.append(f'  {name:<34}' + ''.join(f'{shown(float(each)):>10}' for each in figures))
    return lines


def _calm_table(members: list[LeastError], planar: bool) -> list[str]:
    """The least errors with at most some chattering, as lines."""
    known = [one.calm for one in members if one.calm is not None]
    if not known:
        return ['  no noise: calm costs nothing']
    lines = [f'  with a chattering of at most [N m]; {len(known)} robots with noise']
    for level in LEVELS:
        values = [1e6 * each.at(level) for each in known]
        if np.isnan(values).any():
            continue  # calmer than the calmest controller that was computed for some robot
        figures = np.percentile(values, [50, 5, 95] if len(members) > 1 else [50])
        lines.append(f'  {level:<34g}' + ''.join(f'{shown(float(each)):>10}' for each in figures))
    return lines


def _rows(found: dict[str, list[LeastError]], planar: bool) -> str:
    """One row for each robot, as CSV in SI units."""
    unit = 'm' if planar else 'rad'
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    errors = [f'{name.replace(" ", "_")}_{unit}' for name in CAUSES]
    calm = any(one.calm for members in found.values() for one in members)
    levels = [f'at_{level:g}_nm_{unit}' for level in LEVELS] if calm else []
    writer.writerow(['scenario', 'sample', *errors, 'travelled_m', *levels])
    for scenario, members in found.items():
        for k, one in enumerate(members):
            travelled = '' if math.isnan(one.travelled) else one.travelled
            prices = [one.calm.at(level) if one.calm else math.nan for level in LEVELS]
            cells = ['' if math.isnan(price) else price for price in prices] if calm else []
            writer.writerow([scenario, k, *one.errors.values(), travelled, *cells])
    return stream.getvalue()
