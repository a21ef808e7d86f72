"""The command ``tune``: gains of a law by error and effort, under uncertainty."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from parallel_robot.cli.commands import simulate
from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.plan import plan
from parallel_robot.studies.sweep.study import Study, Variant
from parallel_robot.studies.sweep.sweep import default_workers
from parallel_robot.studies.sweep.workers import Processes
from parallel_robot.studies.tuning import convergence, effort, output, weights
from parallel_robot.studies.tuning.effort import MEASURES, Effort
from parallel_robot.studies.tuning.front import choose, front
from parallel_robot.studies.tuning.output import Result
from parallel_robot.studies.tuning.sampler import library
from parallel_robot.studies.tuning.space import at_ends, doubts, space_of, unit_of
from parallel_robot.studies.tuning.store import Store
from parallel_robot.studies.tuning.trial import Trial
from parallel_robot.studies.tuning.tune import Tuning, infeasible, run
from parallel_robot_control.configuration import available, resolve
from parallel_robot_model.common.errors import InputError, RunError, UnknownNameError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import Field, check

PATIENCES = 2  # that a search takes unless told: it can show that it has converged
MOST_UNTIL = 2000  # trials of a search until it has converged
IMPROVEMENT = 2.0  # percent
MOST_TRIALS = 100_000
MOST_WORKERS = 1024
REASONS = 3  # most frequent reasons of infeasible trials to report


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
        help=f'how many trials that is; default {convergence.EACH} for each gain that is '
        f'searched, at least {convergence.FEWEST}',
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
        + f'; default {effort.DEFAULT}. With a limit, take the least error within it: laws tuned '
        'with the same limit are compared at equal effort',
    )
    parser.add_argument(
        '--workers', type=int, metavar='N', help='processes, default: one for each core'
    )
    simulate.add_set_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    library()
    tuning, fields = _tuning(arguments)
    rule = _rule(arguments, tuning)
    trials = arguments.trials
    if trials is None:
        usual = min(PATIENCES * rule.patience, MOST_TRIALS)
        trials = MOST_UNTIL if arguments.until_converged else usual
    trials = check('--trials', int, Field('', '', 1, MOST_TRIALS), trials)
    workers = default_workers() if arguments.workers is None else arguments.workers
    workers = check('--workers', int, Field('', '', 1, MOST_WORKERS), workers)
    if arguments.pick is not None:
        check('--pick', int, Field('', '', 0, trials - 1), arguments.pick)
    with Store(arguments.out, tuning.space, tuning.identity()) as store:
        until = rule if arguments.until_converged else None
        found = run(tuning, store, trials, Processes(workers), until)
        points = front(found)
        if not points:
            reason = next(iter(infeasible(found)))
            raise RunError(f'all {len(found)} trials are infeasible, most of them: {reason}')
        chosen, why = choose(points, found[0], tuning.weights, arguments.pick, tuning.effort)
        result = Result(found, points, chosen, why, tuning.judge(found, rule))
        paths = {path.name: path for path in output.write(tuning, store, fields, result)}
    for line in _summary(tuning, result):
        print(line)
    for text in _warnings(tuning, chosen, fields):
        print(f'warning: {text}', file=sys.stderr)
    print(f'gains   {paths["tuned.yaml"]}, for nodes {paths["tuned_ros.yaml"]}')
    print(f'front   {paths["front.csv"]} (.svg, .png)')
    print(f'trials  {paths["trials.csv"]}, {paths["convergence.svg"]} (.png)')
    return 0


def _rule(arguments: argparse.Namespace, tuning: Tuning) -> convergence.Rule:
    """When the search has converged.

    Raises:
        InputError: an argument is wrong.
    """
    patience = arguments.patience
    if patience is None:
        patience = convergence.patience_for(len(tuning.space.varied))
    patience = check('--patience', int, Field('', '', 1, MOST_TRIALS), patience)
    percent = check('--improvement', float, Field('%', '', 0.0, 100.0), arguments.improvement)
    return convergence.Rule(patience, percent / 100.0)


def _effort(arguments: argparse.Namespace) -> Effort:
    """The measure of effort and its limit.

    Raises:
        InputError: an argument is wrong, or two of them exclude each other.
    """
    if arguments.chattering is not None:
        if arguments.effort is not None:
            raise InputError('--chattering is the same as --effort chattering=NM: give one')
        least = check('--chattering', float, Field('N m', '', 0.0), arguments.chattering)
        return Effort(effort.DEFAULT, least)
    found = Effort() if arguments.effort is None else effort.parse(arguments.effort)
    if found.limit is not None and arguments.pick is not None:
        raise InputError('--pick and a limit of --effort exclude each other')
    return found


def _tuning(arguments: argparse.Namespace) -> tuple[Tuning, dict[str, Field]]:
    """What the arguments ask for, and unit and meaning of the gains.

    Raises:
        InputError: an argument is wrong.
    """
    law, scenario = arguments.law, arguments.scenario
    spent = _effort(arguments)
    asked = None
    if arguments.weights is not None:
        asked = weights.parse(arguments.weights, spent.measure)
    seed = check('--seed', int, Field('', '', 0, 2**63 - 1), arguments.seed)
    fixed = simulate.given(arguments)
    custom = {key: fixed[key] for key in config.CUSTOM if key in fixed}
    known = available(resolve(scenario, custom)['custom_laws'])
    if law not in known:
        raise UnknownNameError('law', law, known)
    found = plan(_study(arguments, fixed))
    space = space_of(
        law,
        known[law],
        found.cases[0].nominal,
        arguments.bounds,
        arguments.search,
        not arguments.break_conditions,
    )
    for each in found.study.uncertainties:
        if each.key in map(space.key, space.default):
            raise InputError(f'uncertainty: {each.key} is one of the gains that are tuned')
    return Tuning(found, space, asked, seed, spent), unit_of(known[law])


def _study(arguments: argparse.Namespace, fixed: dict[str, Any]) -> Study:
    """The study of the law in the scenario alone."""
    scenarios, laws = (arguments.scenario,), (Variant(arguments.law, arguments.law, {}),)
    if arguments.study is not None:
        file = study.file_of(arguments.study)
        given = study.parse(study.read(file), str(file), file.parent)
        asked = replace(given, scenarios=scenarios, laws=laws, scrambles=1)
        if arguments.study_seed is not None:
            seed = check('--study-seed', int, Field('', '', 0, 2**63 - 1), arguments.study_seed)
            asked = replace(asked, seed=seed)
    elif arguments.runs is not None:
        raise InputError('--runs are samples of the uncertainty of a --study')
    elif arguments.study_seed is not None:
        raise InputError('--study-seed is that of the samples of a --study')
    else:
        asked = Study(scenarios, laws, 1, 0, 'random', None, {}, ())
    if arguments.duration is not None:
        seconds = check('--duration', float, Field('s', '', 0.0), arguments.duration)
        asked = replace(asked, duration=seconds)
    return asked.changed(arguments.runs, fixed)


def _summary(tuning: Tuning, result: Result) -> list[str]:
    """What came of it, in lines."""
    trials, chosen = result.trials, result.chosen
    failed = infeasible(trials)
    lines = [
        f'{len(trials)} trials, {sum(failed.values())} infeasible, {len(result.points)} on the '
        f'front; trial {chosen.number} is taken: {result.why}',
        f'{result.verdict} (best: {tuning.goal})',
    ]
    lines += [f'  {count} x {reason}' for reason, count in list(failed.items())[:REASONS]]
    lines.append(f'default {output.figures(trials[0], tuning)}')
    lines.append(f'tuned   {output.figures(chosen, tuning)}')
    width = max(map(len, chosen.gains))
    for key in chosen.gains:
        among = tuning.space.varied.get(key, 'fixed')
        if key not in tuning.space.varied and key not in tuning.space.fixed:
            among = 'follows gamma1'
        before, after = (_short(each[key]) for each in (tuning.space.default, chosen.gains))
        lines.append(f'  {key:<{width}}  {before} -> {after}  ({among})')
    return lines


def _warnings(tuning: Tuning, chosen: Trial, fields: dict[str, Field]) -> list[str]:
    """What to doubt of the gains that are taken."""
    law, joints = tuning.law, len(tuning.nominal['joints'])
    doubted = doubts(tuning.space, law, chosen.gains, joints)
    return [*doubted, *at_ends(tuning.space, chosen.gains, fields)]


def _short(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
