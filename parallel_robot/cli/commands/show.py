"""The command ``show``: the effective configuration, and where each value comes from."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from parallel_robot.analysis.table import fields_of
from parallel_robot.bags.experiment import OF_RUN
from parallel_robot.bags.output import as_it_is
from parallel_robot.cli.commands.simulate import add_law_argument, add_scenario_argument
from parallel_robot.cli.shared import add_set_argument, layers
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import load
from parallel_robot_model.common import tables
from parallel_robot_model.common.errors import clean, printable
from parallel_robot_model.common.tables import Table
from parallel_robot_model.configuration import config, config_files
from parallel_robot_model.configuration.config_files import scenario_of
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.configuration.plain_data import LocatedDict, merged
from parallel_robot_model.configuration.yaml_file import MARK, text_of
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.fastest import fastest

BY_COMMANDS = (*OF_RUN, 'duration')  # left out of files unless set
UNKNOWN = Field('', '')  # of the keys of the recorder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_scenario_argument(parser)
    add_law_argument(parser)
    add_set_argument(parser)
    parser.add_argument(
        '--fit-speed',
        action='store_true',
        help='say how fast the motion may run until a joint meets a limit of speed or torque; '
        'with --format, beside the configuration',
    )
    parser.add_argument(
        '--plot',
        type=Path,
        metavar='FILE',
        help='draw the motion before it runs, with the robot and the limits of its joints: a new '
        '.png, .pdf or .svg',
    )
    parser.add_argument(
        '--workspace',
        type=Path,
        metavar='FILE',
        help='draw where the tool can reach in the plane of its motion, with the margins to '
        'singularities and home: a new .png, .pdf or .svg',
    )
    parser.add_argument(
        '--format',
        choices=FORMATS,
        help='table or text (default); yaml: a scenario; ros: a parameter file for nodes; json; '
        'markdown; latex',
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.workspace:
        from parallel_robot.analysis import reach_picture  # slow to import

        reach_picture.check_picture(arguments.workspace)
    names = [*arguments.param_file, config.OVERRIDE]
    each_changes = map(config.changes, layers(arguments))
    given = [*zip(map(str, names), each_changes, strict=True)]
    if arguments.law is not None:
        so_far = merged(values for _, values in given)
        given.append(('--law', LocatedDict(law_loader.chosen(arguments.law, so_far))))
    changed = merged(values for _, values in given)
    scenario = scenario_of(arguments.scenario)
    values, sources = config.resolve_with_sources(scenario, changed, load(changed))
    made = configure(values)  # a wrong value is refused here as in a run
    if arguments.fit_speed:
        found = fastest(made)
        print(
            f'fastest: trajectory.speed_factor {found.factor:.4g}, span {found.span:.4g} s; '
            f'there {found.text}',
            file=sys.stderr if arguments.format else sys.stdout,
        )
    if arguments.plot is not None:
        from parallel_robot.analysis import pictures  # slow to import
        from parallel_robot.analysis.report import planned

        pictures.check_format(arguments.plot)
        pictures.save(planned.figure_of_motion(made), arguments.plot)
    if arguments.workspace:
        text = reach_picture.write_picture(made, arguments.workspace)
        print(f'workspace: {text}; {arguments.workspace}', file=sys.stderr)
    if arguments.fit_speed and arguments.format is None:
        return 0
    form = arguments.format or 'table'
    values['realtime'] = made.loop.realtime  # YAML reads an unquoted off as false
    overridden = {key for key, source in sources.items() if source == config.OVERRIDE}
    for name, layer in given:
        sources |= {key: name for key in layer if key in overridden}
    place = config_files.absolute_scenario(scenario)
    text = FORMATS[form](values, sources, place)
    if form in WHOLE:
        as_it_is(sys.stdout).write(''.join(f'{clean(line)}\n' for line in text.split('\n')))
    else:
        print(text)
    return 0


def as_table(values: Mapping[str, Any], sources: Mapping[str, str], place: str) -> str:
    """One line for each key: value, unit and source."""
    rows = [
        [key, f'{value} {unit}'.strip(), source]
        for key, value, unit, source in _rows(values, sources)
    ]
    return tables.text([Table(['key', 'value', 'source'], rows, 'l', widest=WIDEST)])


def as_document(form: str) -> Callable[[Mapping[str, Any], Mapping[str, str], str], str]:
    """The same with a column of units, in a format of :mod:`tables`."""
    head = ['key', 'value', 'unit', 'source']
    return lambda values, sources, place: tables.FORMATS[form](
        [Table(head, _rows(values, sources), 'l')]
    )


def _rows(values: Mapping[str, Any], sources: Mapping[str, str]) -> list[list[str]]:
    """Key, value, unit and source of each key."""
    fields = fields_of(values)
    rows = []
    for key in ordered(values):
        source = f'from {sources[key]}' if sources[key] in sources else sources[key]
        rows.append([key, _short(values[key]), fields.get(key, UNKNOWN).unit, source])
    return rows


def as_json(values: Mapping[str, Any], sources: Mapping[str, str], place: str) -> str:
    """Key to value, unit, meaning and source."""
    fields = fields_of(values)
    data = {
        key: {
            'value': values[key],
            'unit': fields.get(key, UNKNOWN).unit,
            'description': fields.get(key, UNKNOWN).description,
            'source': sources[key],
        }
        for key in ordered(values)
    }
    return json.dumps(data, indent=2, ensure_ascii=False)


def as_scenario(values: Mapping[str, Any], sources: Mapping[str, str], place: str) -> str:
    """A scenario of one's own that resolves to the same values."""
    code = {key: values[key] for key in sorted(config.CUSTOM) if values[key]}
    head = [f'# All values of the scenario {values["scenario"]}, as parallel_robot show has them.']
    head += [f'# It needs --set {key}={text_of(paths)}' for key, paths in code.items()]
    keys = [key for key in _own(values, sources) if key not in config.CUSTOM]
    return '\n'.join([*head, *_lines(keys, values, sources)])


def as_ros(values: Mapping[str, Any], sources: Mapping[str, str], place: str) -> str:
    """A parameter file for the nodes, as ``--params-file`` takes it."""
    shown = {**values, 'scenario': place}
    # ROS has no type for an empty list, nor for one of whole and other numbers.
    keys = ['scenario', *(key for key in _own(values, sources) if values[key] != [])]
    for key in keys:
        if isinstance(shown[key], list) and any(type(item) is float for item in shown[key]):
            shown[key] = [float(item) for item in shown[key]]
    lines = _lines(keys, shown, sources)
    return '\n'.join(['/**:', f'  {MARK}:', *(f'    {line}' for line in lines)])


FORMATS = {
    'table': as_table,
    'text': as_table,
    'yaml': as_scenario,
    'ros': as_ros,
    'json': as_json,
    **{form: as_document(form) for form in ('markdown', 'latex')},
}
WHOLE = ('yaml', 'ros', 'json')  # formats whose lines are not cut, however long
MANY = 100  # items of a list, of which not all are shown
LONG, BEGIN = 200, 60  # characters of a text that is not shown as a whole, and of what is
WIDEST = 44  # characters of a column; what is wider sticks out


def ordered(values: Iterable[str]) -> list[str]:
    """Keys without a group first, then group by group in the order in which they came."""
    groups = list(dict.fromkeys(key.partition('.')[0] for key in values if '.' in key))
    return sorted(
        values, key=lambda key: groups.index(key.partition('.')[0]) if '.' in key else -1
    )


def _own(values: Mapping[str, Any], sources: Mapping[str, str]) -> list[str]:
    """Keys for a file: none that follow from others, none that a command sets itself."""
    return [
        key
        for key in ordered(values)
        if sources[key] != key.removeprefix('true_')
        and key not in ('scenario', 'preset')
        and not (key in BY_COMMANDS and sources[key] == config.DEFAULTS)
    ]


def _lines(
    keys: Iterable[str], values: Mapping[str, Any], sources: Mapping[str, str]
) -> list[str]:
    """Keys and values as YAML, with unit and source in a comment."""
    fields = fields_of(values)
    lines, before = [], ''
    for key in keys:
        group, dot, name = key.partition('.')
        if dot and group != before:
            lines.append(f'{group}:')
            before = group
        unit = fields.get(key, UNKNOWN).unit
        source = printable(sources[key])
        comment = f'{unit}; {source}' if unit else source
        start = f'  {text_of(name)}' if dot else text_of(key)
        lines.append(f'{start}: {text_of(values[key])}  # {comment}')
    return lines


def _short(value: Any) -> str:
    """A value for people: numbers with ten digits, words without quotes, what is long cut."""
    if isinstance(value, list):
        if len(value) > MANY:
            first = ', '.join(map(_short, value[:3]))
            return f'[{first}, ... {_short(value[-1])}] ({len(value)} in all)'
        return f'[{", ".join(map(_short, value))}]'
    if isinstance(value, str) and len(value) > LONG:
        return f'{" ".join(value[:BEGIN].split())} ... ({len(value)} characters)'
    if isinstance(value, str) and value.isalpha():  # also off, which YAML quotes
        return value
    return f'{value:.10g}' if isinstance(value, float) else text_of(value)
