"""The command ``compare``: all laws on one scenario, without ROS, and the paper's claims."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from parallel_robot.analysis import claims, metrics
from parallel_robot.analysis.metrics import METRICS, Metric
from parallel_robot.analysis.readable_metrics import (
    as_data,
    defined,
    shown,
    unsettled,
    window,
)
from parallel_robot.bags import output
from parallel_robot.bags.output import tracked
from parallel_robot.cli.commands import simulate
from parallel_robot.cli.commands.analyze import as_json
from parallel_robot.cli.shared import add_format_argument, add_window_arguments, show, warn
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import available, resolve
from parallel_robot_model.common.errors import InputError, RunError, UnknownNameError
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import HINGES
from parallel_robot_model.configuration import yaml_file
from parallel_robot_sim import simulation
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.motions import of_simulation
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.preflight import motion_warnings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    simulate.add_scenario_arguments(parser)
    add_window_arguments(parser)
    parser.add_argument(
        '--laws',
        nargs='+',
        metavar='LAW|FILE',
        help='laws to compare, or files of them, .py, .so, .fmu; default: all',
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write table and claims as JSON')
    add_format_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if 'law' in yaml_file.parse_assignments(arguments.assignments):
        raise InputError('--set law: compare has all laws, or those of --laws')
    overrides = simulate.overrides(arguments)
    values = resolve(arguments.scenario, overrides)
    scenario, known = str(values['scenario']), available(values['custom_laws'])
    laws = [law_loader.name_of(law) for law in arguments.laws or known]
    given = ' '.join(laws)
    if ',' in given:
        names = ' '.join(given.replace(',', ' ').split())
        raise InputError(f'--laws takes names with spaces between them, {names}, not {given}')
    for law in laws:
        if law not in known:
            raise UnknownNameError('law', law, known)
    if arguments.json:
        output.check_new(arguments.json, '--json')
    results = {}
    notes = [*motion_warnings(trajectory_of(values)), *_of_the_paper(values, laws)]
    failed: dict[str, str] = {}
    causes: dict[str, str] = {}
    for law in tracked(laws, len(laws), 'laws'):
        configuration = configure(resolve(arguments.scenario, overrides | {'law': law}))
        made = simulation.attempt(configuration)
        if made.failure:
            failed[law] = made.failure.removeprefix(f'{law}: ')
            causes[law] = failed[law] if made.driven_out else made.fault_text
        else:
            results[law] = metrics.figures(of_simulation(made), arguments.start, arguments.stop)
            notes += [f'{law}: {text}' for text in unsettled(results[law])]
        notes += [
            f'{law}: {text.removeprefix(f"{law}: ")}'
            for text in simulate.remarks(made, made.summary)
        ]
    verdicts = claims.verify(scenario, results)
    data = summarise(scenario, results, verdicts, causes)
    if arguments.json:
        output.save(arguments.json, as_json(data))
    parts = [*table(scenario, laws, results, failed), *map(line, verdicts)]
    show(arguments.format, parts, data)
    warn(notes)
    if not results:
        raise RunError('every law failed')
    return 0


def _of_the_paper(values: Mapping[str, Any], laws: Iterable[str]) -> list[str]:
    """A line on the laws whose gains are those of another robot, if there are any."""
    paper, keys = resolve('paper_circle'), [key for key in values if '.' in key]
    if values['robot_model'] == paper['robot_model']:
        return []
    same = {key.partition('.')[0] for key in keys if key in paper} - {
        key.partition('.')[0] for key in keys if values[key] != paper.get(key)
    }
    theirs = [law for law in laws if law in same]
    tuned = 'gains of the 3-RRR, not of this robot; tune finds its own'
    return [f'{", ".join(theirs)}: {tuned}'] if theirs else []


def table(
    scenario: str,
    laws: Iterable[str],
    results: Mapping[str, metrics.Metrics],
    failed: Mapping[str, str],
) -> list[Part]:
    """One row for each law, one column for each metric.

    Args:
        scenario: Name of the scenario.
        laws: The laws, one row each.
        results: Law to its metrics.
        failed: Law to why it has none.
    """
    found = next(iter(results.values()), None)
    units = found.units if found else HINGES
    columns = [metric.in_units(units) for metric in defined(METRICS, found)] if found else []
    head = f'{scenario}: ' + (_parts(found, columns) if found else 'no figures')
    rows = [
        [law, f'no figures: {failed[law]}']
        if law in failed
        else [law, *(shown(metric.printed(results[law])) for metric in columns)]
        for law in laws
    ]
    heads = [f'{metric.short}\n[{metric.unit}]' for metric in columns] or ['figures']
    return [head, Table(['law', *heads], rows)]


def _parts(found: metrics.Metrics, columns: Collection[Metric]) -> str:
    """Of which part of the run the columns are."""
    settling = (
        f'time until the end-effector error stays below a bound, for {metrics.BELOW:g} s or more; '
    )
    of_all = '' if found.window.requested else '; largest torque and variation over all of it'
    return (
        f'{settling if any(each.group == "transient" for each in columns) else ""}'
        f'errors, chattering and effort over {window(found)}{of_all}'
    )


def line(verdict: claims.Verdict) -> str:
    """One claim with its verdict and what was measured."""
    values = ', '.join(f'{law} {shown(value)}' for law, value in verdict.values.items())
    word = 'reproduced' if verdict.reproduced else 'not reproduced'
    return f'{word:<15} {verdict.claim.text}: {values} {verdict.claim.unit}'


def summarise(
    scenario: str,
    results: Mapping[str, metrics.Metrics],
    verdicts: list[claims.Verdict],
    causes: Mapping[str, str],
) -> dict[str, Any]:
    """Table, what failed by law, and claims as plain data, for JSON."""
    return {
        'scenario': scenario,
        'laws': {law: as_data(result) for law, result in results.items()},
        'faults': dict(causes),
        'claims': [
            {
                'claim': verdict.claim.text,
                'reproduced': verdict.reproduced,
                'figures': verdict.values,
                'unit': verdict.claim.unit,
            }
            for verdict in verdicts
        ],
    }
