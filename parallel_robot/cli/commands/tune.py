"""The command ``tune``: gains of a law by error and effort, under uncertainty."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from parallel_robot.cli.commands import simulate
from parallel_robot.cli.shared import add_format_argument, show, tell, warn
from parallel_robot.studies.tuning import trial
from parallel_robot.studies.tuning.trial import MEASURES
from parallel_robot.studies.tuning.tuned import IMPROVEMENT, MOST_UNTIL, PATIENCES, Asked, tune


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('law', metavar='LAW|FILE', help='control law, or its file in Python')
    simulate.add_scenario_argument(parser)
    parser.add_argument(
        '--out',
        type=Path,
        required=True,
        metavar='DIR',
        help='results; must not exist, or hold a part of the same tuning, which is continued',
    )
    parser.add_argument(
        '--study',
        metavar='STUDY',
        help='uncertainty, samples, duration and fixed keys of this study, a file or the name of '
        'one in config/studies; default: one exact run',
    )
    parser.add_argument('--runs', type=int, metavar='N', help="samples, default: the study's")
    parser.add_argument(
        '--study-seed',
        type=int,
        metavar='N',
        help="seed of the samples, default: the study's; with another one, `sweep` of the study "
        'shows the gains on samples that the search has not seen',
    )
    parser.add_argument(
        '--duration', type=float, metavar='S', help='seconds of each run, default: as of the study'
    )
    parser.add_argument(
        '--trials',
        type=int,
        metavar='N',
        help=f'in total, at most; default {PATIENCES} times --patience, so that the search can '
        f'converge; with --until-converged {MOST_UNTIL}',
    )
    parser.add_argument(
        '--until-converged',
        action='store_true',
        help='end when the best has hardly improved for a while',
    )
    parser.add_argument(
        '--patience',
        type=int,
        metavar='N',
        help=f'how many trials that is; default {trial.JUDGED_EACH} for each gain that is '
        f'searched, at least {trial.FEWEST_TRIALS}',
    )
    parser.add_argument(
        '--improvement',
        type=float,
        default=IMPROVEMENT,
        metavar='PERCENT',
        help=f'what is hardly an improvement, default {IMPROVEMENT:g}',
    )
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='default 0')
    parser.add_argument(
        '--weights',
        metavar='WEIGHTS',
        help='e.g. error=2,chattering=1: one objective, relative to the default gains, instead '
        'of a Pareto front',
    )
    parser.add_argument(
        '--bounds',
        action='append',
        default=[],
        metavar='GAIN=LOW:HIGH',
        help='where a gain is searched; GAIN=VALUE fixes it; may be repeated',
    )
    parser.add_argument(
        '--search',
        action='append',
        default=[],
        metavar='KEY',
        help='search this parameter, too, e.g. estimator.bandwidth; estimator stands for all of '
        'its parameters; may be repeated',
    )
    parser.add_argument(
        '--break-conditions',
        action='store_true',
        help='try gains, too, that break a condition of the law, of which it warns',
    )
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument(
        '--pick', type=int, metavar='N', help='take trial N of the front, default: its knee'
    )
    chosen.add_argument(
        '--chattering', type=float, metavar='NM', help='the same as --effort chattering=NM'
    )
    parser.add_argument(
        '--effort',
        metavar='MEASURE[=LIMIT]',
        help='what the error is traded against: '
        + ', '.join(f'{name} [{each.unit}]' for name, each in MEASURES.items())
        + f'; default {trial.DEFAULT_EFFORT}. With a limit, take the least error within it: '
        'laws tuned with the same limit are compared at equal effort',
    )
    parser.add_argument(
        '--workers', type=int, metavar='N', help='processes, default: one for each core'
    )
    add_format_argument(parser)
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    found = tune(asked(arguments), simulate.given(arguments), arguments.out)
    form = arguments.format
    show(form, found.parts(), found.as_data())
    warn(found.warnings)
    files = found.files
    tell(form, f'gains   {files["tuned.yaml"]}, for nodes {files["tuned_ros.yaml"]}')
    tell(form, f'front   {files["front.csv"]} (.svg, .png)')
    tell(form, f'trials  {files["trials.csv"]}, {files["convergence.svg"]} (.png)')
    return 0


def asked(arguments: argparse.Namespace) -> Asked:
    """What the arguments ask for."""
    return Asked(
        **{each.name: getattr(arguments, each.name) for each in dataclasses.fields(Asked)}
    )
