"""The command ``compare``: all laws on one scenario, without ROS, and the paper's claims."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot_analysis import claims, metrics
from parallel_robot_analysis.readable_metrics import METRICS, TRANSIENT, as_data, defined, shown
from parallel_robot_bags import new_files
from parallel_robot_bags.progress import tracked
from parallel_robot_base import assignments
from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_cli.commands import simulate
from parallel_robot_cli.commands.analyze import as_json
from parallel_robot_control.configuration import available, resolve
from parallel_robot_sim import simulation
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.motions import of_simulation
from parallel_robot_studies.ideal_torque import torque_of

MARK = '!'  # of a law that ended in a fault


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    simulate.add_scenario_arguments(parser)
    parser.add_argument('--laws', nargs='+', metavar='LAW', help='laws to compare, default: all')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write table and claims as JSON')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if 'law' in assignments.parse(arguments.assignments):
        raise InputError('--set law: compare has all laws, or those of --laws')
    values = resolve(arguments.scenario, simulate.overrides(arguments))
    scenario, known = str(values['scenario']), available(values['custom_laws'])
    laws = arguments.laws or list(known)
    given = ' '.join(laws)
    if ',' in given:
        names = ' '.join(given.replace(',', ' ').split())
        raise InputError(f'--laws takes names with spaces between them, {names}, not {given}')
    for law in laws:
        if law not in known:
            raise UnknownNameError('law', law, known)
    if arguments.json:
        new_files.check(arguments.json, '--json')
    results = {}
    ideal: np.ndarray | None = None  # the same for all laws
    notes: list[str] = []
    faulted: dict[str, str] = {}
    for law in tracked(laws, len(laws), 'laws'):
        changed = simulate.overrides(arguments) | {'law': law}
        configuration = configure(resolve(arguments.scenario, changed))
        made = simulation.simulate(configuration)
        ideal = torque_of(configuration) if ideal is None else ideal
        results[law] = metrics.figures(of_simulation(made), ideal)
        if made.fault is not None:
            faulted[law] = made.fault_text
        notes += [f'{law}: {text.removeprefix(f"{law}: ")}' for text in simulate.remarks(made)]
    good = {law: found for law, found in results.items() if law not in faulted}
    verdicts = claims.verify(scenario, good)
    if arguments.json:
        try:
            data = summarise(scenario, results, verdicts, faulted)
            new_files.write(arguments.json, as_json(data))
        except OSError as error:
            raise InputError(f'cannot write {arguments.json}: {error.strerror}') from None
    print(table(scenario, results, faulted))
    for verdict in verdicts:
        print(line(verdict))
    for note in notes:
        print(f'warning: {note}', file=sys.stderr)
    return 0


def table(
    scenario: str, results: Mapping[str, metrics.Metrics], faulted: Collection[str] = ()
) -> str:
    """One row for each law, one column for each metric.

    Args:
        scenario: Name of the scenario.
        results: Law to its metrics.
        faulted: Laws that ended in a fault; their rows are marked.
    """
    columns = defined(METRICS, next(iter(results.values())))
    settling = 'time until the end-effector error stays below a bound; '
    rows = [
        f'{scenario}: {settling if TRANSIENT[0] in columns else ""}'
        'errors, chattering and effort over the second half'
    ]
    rows.append(f'{"law":<20}' + ''.join(f'{metric.short:>11}' for metric in columns))
    rows.append(f'{"":<20}' + ''.join(f'{"[" + metric.unit + "]":>11}' for metric in columns))
    for law, result in results.items():
        cells = [shown(metric.value(result)) for metric in columns]
        name = f'{law} {MARK}' if law in faulted else law
        rows.append(f'{name:<20}' + ''.join(f'{cell:>11}' for cell in cells))
    if faulted:
        rows.append(
            f'{MARK} ended in a fault: no figures of merit, and no claim is judged by them'
        )
    return '\n'.join(rows)


def line(verdict: claims.Verdict) -> str:
    """One claim with its verdict and what was measured."""
    values = ', '.join(f'{law} {shown(value)}' for law, value in verdict.values.items())
    word = 'reproduced' if verdict.reproduced else 'not reproduced'
    return f'{word:<15} {verdict.claim.text}: {values} {verdict.claim.unit}'


def summarise(
    scenario: str,
    results: Mapping[str, metrics.Metrics],
    verdicts: list[claims.Verdict],
    faulted: Mapping[str, str],
) -> dict[str, Any]:
    """Table, faults by law, and claims as plain data, for JSON."""
    return {
        'scenario': scenario,
        'laws': {law: as_data(result) for law, result in results.items()},
        'faults': dict(faulted),
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
