"""The command ``compare``: all laws on one scenario, without ROS, beside the paper's claims."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from parallel_robot_analysis import claims, metrics
from parallel_robot_analysis.commands import simulate
from parallel_robot_analysis.commands.analyze import as_json
from parallel_robot_analysis.figures_of_merit import MERITS, shown
from parallel_robot_bags import new_files
from parallel_robot_bags.progress import tracked
from parallel_robot_base import config
from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_control.laws import available
from parallel_robot_sim import simulation


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    simulate.add_scenario_arguments(parser)
    parser.add_argument('--laws', nargs='+', metavar='LAW', help='laws to compare, default: all')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write table and claims as JSON')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    known = available(config.resolve(arguments.scenario, simulate.overrides(arguments)))
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
    notes: list[str] = []
    for law in tracked(laws, len(laws), 'laws'):
        changed = simulate.overrides(arguments) | {'law': law}
        values = config.resolve(arguments.scenario, changed)
        made = simulation.simulate(values)
        results[law] = evaluate(made)
        notes += simulate.remarks(made)
    verdicts = claims.judge(arguments.scenario, results)
    if arguments.json:
        try:
            data = as_data(arguments.scenario, results, verdicts)
            new_files.write(arguments.json, as_json(data))
        except OSError as error:
            raise InputError(f'cannot write {arguments.json}: {error.strerror}') from None
    print(table(arguments.scenario, results))
    for verdict in verdicts:
        print(line(verdict))
    for note in notes:
        print(f'warning: {note}', file=sys.stderr)
    return 0


def evaluate(made: simulation.Simulation) -> metrics.Metrics:
    """Figures of merit of a simulation that is not written to a bag."""
    poses = metrics.Poses(made.run.pose, made.reference.pose)
    return metrics.evaluate(simulate.motion(made), poses)


def table(scenario: str, results: dict[str, metrics.Metrics]) -> str:
    """One row a law, one column a figure."""
    rows = [
        f'{scenario}: time until the platform error stays below a bound; '
        'errors and chattering over the second half'
    ]
    rows.append(f'{"law":<20}' + ''.join(f'{merit.short:>11}' for merit in MERITS))
    rows.append(f'{"":<20}' + ''.join(f'{"[" + merit.unit + "]":>11}' for merit in MERITS))
    for law, result in results.items():
        cells = [shown(merit.value(result)) for merit in MERITS]
        rows.append(f'{law:<20}' + ''.join(f'{cell:>11}' for cell in cells))
    return '\n'.join(rows)


def line(verdict: claims.Verdict) -> str:
    """One claim with its verdict and figures."""
    figures = ', '.join(f'{law} {shown(value)}' for law, value in verdict.figures.items())
    word = 'reproduced' if verdict.reproduced else 'not reproduced'
    return f'{word:<15} {verdict.claim.text}: {figures} {verdict.claim.unit}'


def as_data(
    scenario: str, results: dict[str, metrics.Metrics], verdicts: list[claims.Verdict]
) -> dict[str, Any]:
    """Table and claims as plain data, for JSON."""
    return {
        'scenario': scenario,
        'laws': {
            law: {
                'transient': result.transient._asdict(),
                'steady': result.steady._asdict(),
                'torque': result.torque._asdict(),
            }
            for law, result in results.items()
        },
        'claims': [
            {
                'claim': verdict.claim.text,
                'reproduced': verdict.reproduced,
                'figures': verdict.figures,
                'unit': verdict.claim.unit,
            }
            for verdict in verdicts
        ],
    }
