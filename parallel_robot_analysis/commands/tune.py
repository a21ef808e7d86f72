"""The command ``tune``: gains of a law by error and chattering, under uncertainty."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from parallel_robot_analysis.commands import simulate
from parallel_robot_analysis.study import study
from parallel_robot_analysis.study.plan import plan
from parallel_robot_analysis.study.study import Study, Variant
from parallel_robot_analysis.study.sweep import default_workers
from parallel_robot_analysis.study.workers import Processes
from parallel_robot_analysis.tuning import output, weights
from parallel_robot_analysis.tuning.front import choose, front
from parallel_robot_analysis.tuning.sampler import library
from parallel_robot_analysis.tuning.space import space_of, unit_of
from parallel_robot_analysis.tuning.store import Store
from parallel_robot_analysis.tuning.trial import Trial
from parallel_robot_analysis.tuning.tune import Tuning, infeasible, run
from parallel_robot_base import config
from parallel_robot_base.errors import InputError, RunError, UnknownNameError
from parallel_robot_base.fields import Field, check
from parallel_robot_base.loop import DURATION
from parallel_robot_control.configuration import available, resolve

TRIALS = 100
MOST_TRIALS = 100_000
MOST_WORKERS = 1024
REASONS = 3  # most frequent reasons of infeasible trials that are told


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('law', help='control law')
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
        '--duration', type=float, metavar='S', help='seconds of each run, default: as of the study'
    )
    parser.add_argument(
        '--trials', type=int, default=TRIALS, metavar='N', help=f'in total, default {TRIALS}'
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
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument(
        '--pick', type=int, metavar='N', help='take trial N of the front, default: its knee'
    )
    chosen.add_argument(
        '--chattering',
        type=float,
        metavar='NM',
        help='take the trial of the front with the least error among those that chatter at most '
        'so much [N m]: laws tuned with the same value are compared at equal effort',
    )
    parser.add_argument(
        '--workers', type=int, metavar='N', help='processes, default: one for each core'
    )
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    library()
    trials = check('--trials', int, Field('', '', 1, MOST_TRIALS), arguments.trials)
    workers = default_workers() if arguments.workers is None else arguments.workers
    workers = check('--workers', int, Field('', '', 1, MOST_WORKERS), workers)
    if arguments.pick is not None:
        check('--pick', int, Field('', '', 0, trials - 1), arguments.pick)
    if arguments.chattering is not None:
        check('--chattering', float, Field('N m', '', 0.0), arguments.chattering)
    tuning, fields = _tuning(arguments)
    with Store(arguments.out, tuning.space, tuning.identity()) as store:
        found = run(tuning, store, trials, Processes(workers))
        points = front(found)
        if not points:
            reason = next(iter(infeasible(found)))
            raise RunError(f'all {trials} trials are infeasible, most of them: {reason}')
        chosen, why = choose(
            points, found[0], tuning.weights, arguments.pick, arguments.chattering
        )
        paths = output.write(tuning, store, fields, found, points, chosen, why)
    for line in _summary(tuning, found, points, chosen, why):
        print(line)
    print(f'gains   {paths[-2]}, for nodes {paths[-1]}')
    print(f'front   {paths[0]} (.svg, .png)')
    return 0


def _tuning(arguments: argparse.Namespace) -> tuple[Tuning, dict[str, Field]]:
    """What the arguments ask for, and unit and meaning of the gains.

    Raises:
        InputError: an argument is wrong.
    """
    law, scenario = arguments.law, arguments.scenario
    asked = weights.parse(arguments.weights) if arguments.weights is not None else None
    seed = check('--seed', int, Field('', '', 0, 2**63 - 1), arguments.seed)
    fixed = simulate.given(arguments)
    known = available(resolve(scenario, {k: fixed[k] for k in config.CUSTOM if k in fixed}))
    if law not in known:
        raise UnknownNameError('law', law, known)
    found = plan(_study(arguments, fixed))
    space = space_of(law, known[law], found.cases[0].nominal, arguments.bounds)
    for each in found.study.uncertainties:
        if each.key.removeprefix(f'{law}.') in space.default and each.key.startswith(f'{law}.'):
            raise InputError(f'uncertainty: {each.key} is a gain of the law that is tuned')
    return Tuning(found, space, asked, seed), unit_of(known[law])


def _study(arguments: argparse.Namespace, fixed: dict[str, Any]) -> Study:
    """The study of the law in the scenario alone."""
    scenarios, laws = (arguments.scenario,), (Variant(arguments.law, arguments.law, {}),)
    if arguments.study is not None:
        file = study.file_of(arguments.study)
        given = study.parse(study.read(file), str(file), file.parent)
        asked = replace(given, scenarios=scenarios, laws=laws)
    elif arguments.runs is not None:
        raise InputError('--runs are samples of the uncertainty of a --study')
    else:
        own = config.scenario_values(arguments.scenario).get('duration')
        duration = own or DURATION
        asked = Study(scenarios, laws, 1, 0, 'random', duration, {}, ())
    if arguments.duration is not None:
        seconds = check('--duration', float, Field('s', '', 0.0), arguments.duration)
        asked = replace(asked, duration=seconds)
    return asked.changed(arguments.runs, fixed)


def _summary(
    tuning: Tuning, trials: list[Trial], points: list[Trial], chosen: Trial, why: str
) -> list[str]:
    """What came of it, in lines."""
    failed = infeasible(trials)
    lines = [
        f'{len(trials)} trials, {sum(failed.values())} infeasible, {len(points)} on the front; '
        f'trial {chosen.number} is taken: {why}'
    ]
    lines += [f'  {count} x {reason}' for reason, count in list(failed.items())[:REASONS]]
    lines.append(f'default {output.figures(trials[0], tuning.error)}')
    lines.append(f'tuned   {output.figures(chosen, tuning.error)}')
    width = max(map(len, chosen.gains))
    for key in chosen.gains:
        among = tuning.space.varied.get(key, 'fixed')
        if key not in tuning.space.varied and key not in tuning.space.fixed:
            among = 'follows gamma1'
        before, after = (_short(each[key]) for each in (tuning.space.default, chosen.gains))
        lines.append(f'  {key:<{width}}  {before} -> {after}  ({among})')
    return lines


def _short(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
