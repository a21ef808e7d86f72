"""A tuning from what it is asked for to its files, and what came of it in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from parallel_robot.studies.sweep import study as study_files
from parallel_robot.studies.sweep.plan import plan
from parallel_robot.studies.sweep.study import Study, Variant
from parallel_robot.studies.sweep.sweep import worker_count
from parallel_robot.studies.sweep.workers import Processes
from parallel_robot.studies.tuning import output, trial
from parallel_robot.studies.tuning.front import choose, front
from parallel_robot.studies.tuning.output import Result
from parallel_robot.studies.tuning.space import at_ends, doubts, space_of, unit_of
from parallel_robot.studies.tuning.trial import Effort, Verdict, library
from parallel_robot.studies.tuning.tune import Store, Tuning, infeasible, run
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import available, resolve
from parallel_robot_model.common.errors import (
    Frame,
    InputError,
    RunError,
    UnknownNameError,
    pandas,
)
from parallel_robot_model.common.options import named, path
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.config import Changes, Place, changes
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.configuration.plain_data import merged

REASONS = 3  # most frequent reasons of infeasible trials to report


@dataclass(frozen=True, repr=False)
class Tuned(ShownResult):
    """A tuning that has ended."""

    tuning: Tuning  # what was tuned, and how
    result: Result  # what came of it
    warnings: tuple[str, ...]  # what to doubt of the gains that are taken, one line each
    files: Mapping[str, Path]  # its files, by name

    @property
    def values(self) -> dict[str, Any]:
        """The gains that are taken, as keys of the configuration and their values."""
        gains = self.result.chosen.gains
        return {self.tuning.space.key(name): value for name, value in gains.items()}

    @property
    def verdict(self) -> Verdict:
        """Whether the search has converged."""
        return self.result.verdict

    def file_lines(self) -> list[str]:
        """Its files."""
        files = self.files
        return [
            f'gains   {files["tuned.yaml"]}, for nodes {files["tuned_ros.yaml"]}',
            f'front   {files["front.csv"]} (.svg, .png)',
            f'trials  {files["trials.csv"]}, {files["convergence.svg"]} (.png)',
        ]

    def front(self) -> Frame:
        """The front as a pandas.DataFrame, as in ``front.csv``."""
        return pandas().read_csv(self.files['front.csv'])

    def trials(self) -> Frame:
        """All trials as a pandas.DataFrame, as in ``trials.csv``."""
        return pandas().read_csv(self.files['trials.csv'])

    def as_data(self) -> dict[str, Any]:
        """What came of it as plain data, figures in SI units."""
        tuning, result = self.tuning, self.result
        columns = tuning.error.key, tuning.effort.quantity.key
        first, chosen = (
            dict(zip(columns, (each.error, each.effort), strict=True))
            | {'gains': dict(each.gains)}
            for each in (result.trials[0], result.chosen)
        )
        return {
            'law': tuning.space.law,
            'trials': len(result.trials),
            'infeasible': sum(infeasible(result.trials).values()),
            'front': len(result.points),
            'taken': result.chosen.number,
            'why': result.why,
            'verdict': f'{result.verdict}',
            'default': first,
            'tuned': chosen,
        }

    def parts(self) -> list[Part]:
        """What came of it."""
        tuning, result = self.tuning, self.result
        trials, chosen = result.trials, result.chosen
        failed = infeasible(trials)
        rows = []
        for key in chosen.gains:
            among = tuning.space.varied.get(key, 'fixed')
            if key not in tuning.space.varied and key not in tuning.space.fixed:
                among = 'follows gamma1'
            before, after = (_short(each[key]) for each in (tuning.space.default, chosen.gains))
            rows.append([key, before, after, f'{among}'])
        return [
            f'{len(trials)} trials, {sum(failed.values())} infeasible, {len(result.points)} on '
            f'the front; trial {chosen.number} is taken: {result.why}',
            f'{result.verdict} (best: {tuning.goal})',
            *(f'  {count} x {reason}' for reason, count in list(failed.items())[:REASONS]),
            f'default {output.figures(trials[0], tuning)}',
            f'tuned   {output.figures(chosen, tuning)}',
            Table(['gain', 'default', 'tuned', 'searched'], rows, 'lrrl'),
        ]


PATIENCES = 2  # that a search takes unless told: it can show that it has converged
MOST_UNTIL = 2000  # trials of a search until it has converged
IMPROVEMENT = 2.0  # percent
MOST_TRIALS = 100_000
SEEDS = Field('', '', 0, 2**63 - 1)


def tune(
    law: Place,
    scenario: Place,
    out: Place,
    *,
    study: Place | None = None,
    runs: int | None = None,
    study_seed: int | None = None,
    duration: float | None = None,
    trials: int | None = None,
    until_converged: bool = False,
    patience: int | None = None,
    improvement: float = IMPROVEMENT,
    seed: int = 0,
    weights: Mapping[str, float] | str | None = None,
    bounds: Mapping[str, Any] | Sequence[str] = (),
    search: Sequence[str] = (),
    break_conditions: bool = False,
    pick: int | None = None,
    chattering: float | None = None,
    effort: str | None = None,
    workers: int | None = None,
    param_file: Changes = None,
    **values: Any,
) -> Tuned:
    """Tune the gains of a law, or what is left of it, as ``parallel_robot tune`` does.

    >>> import parallel_robot as pr
    >>> bounds = {'z': (10, 50), 'G': 12}
    >>> found = pr.tune(
    ...     'smc', 'paper_circle', 'runs/tuned', duration=0.2, trials=2, workers=1, bounds=bounds
    ... )
    >>> found.values['smc.G'], len(found.trials())
    (12.0, 2)

    Args:
        law: Control law, or its file in Python.
        scenario: Name of a scenario in ``config/scenarios``, or the path of a YAML file.
        out: Directory of the results; new, or that of the same tuning, which is continued.
        study: File of a study, or name of one in ``config/studies``, of which uncertainty,
            samples, duration and fixed keys are taken; default: one exact run.
        runs: Samples; default: the study's.
        study_seed: Seed of the samples; default: the study's; with another one, `sweep` of the
            study shows the gains on samples that the search has not seen.
        duration: Length of each run [s]; default: as of the study.
        trials: In total, at most; default: 2 times `patience`, so that the search can converge;
            with `until_converged` 2000.
        until_converged: Whether it ends when the best has hardly improved for a while.
        patience: How many trials that is; default: 20 for each gain that is searched, at least
            120.
        improvement: What is hardly an improvement [%]; default: 2.
        seed: Of the search; default: 0.
        weights: Of error and effort, e.g. error=2,chattering=1: one objective, relative to the
            default gains, in place of a Pareto front; in Python a mapping.
        bounds: Where a gain is searched, GAIN=LOW:HIGH; GAIN=VALUE fixes it; may be repeated; in
            Python ``{'z': (10, 50), 'G': 12}``.
        search: Key that is searched beside the gains, e.g. estimator.bandwidth; estimator stands
            for all of its parameters; may be repeated.
        break_conditions: Whether gains are tried, too, that break a condition of the law, of which
            it warns.
        pick: Number of the trial of the front that is taken; default: its knee.
        chattering: The same as `effort` chattering=LIMIT [N m].
        effort: MEASURE[=LIMIT], what the error is traded against: chattering, excess_chattering,
            torque_max, torque_rms, total_variation or energy; default: chattering. With a limit,
            the least error within it is taken: laws tuned with the same limit are compared at
            equal effort.
        workers: Processes; default: one for each core.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values in all runs.

    Returns:
        The gains that are taken as keys of the configuration, ``values``; its ``trials()`` and
        ``front()`` as tables, and whether the search has converged, ``verdict``.

    Raises:
        InputError: something in the arguments is wrong, or the directory is of another tuning.
        RunError: workers cannot run it, all trials are infeasible, or the disk is full; finished
            trials are kept.
    """
    for what, wanted in (('weights', weights), ('bounds', None if bounds == () else bounds)):
        kinds = (Mapping, str) if what == 'weights' else (Mapping, list, tuple)
        if wanted is not None and not isinstance(wanted, kinds):
            raise InputError(f'{what} must be names and values, not {wanted!r}')
    if isinstance(search, str):
        raise InputError(f'search must be a list of keys, not {search!r}')
    file, where, directory = named('law', law), named('scenario', scenario), path('out', out)
    fixed = changes(param_file, values)
    library()
    fixed, name = merged([fixed, law_loader.files_of([file], fixed)]), law_loader.name_of(file)
    spent = _effort(effort, chattering, pick)
    weighed = None if weights is None else trial.weights_of(weights, spent.measure)
    check('--seed', int, SEEDS, seed)
    custom = {key: fixed[key] for key in config.CUSTOM if key in fixed}
    known = available(resolve(where, custom)['custom_laws'])
    if name not in known:
        raise UnknownNameError('law', name, known)
    planned = plan(study_of(name, where, fixed, study, runs, study_seed, duration))
    nominal = planned.cases[0].nominal
    space = space_of(name, known[name], nominal, bounds, search, not break_conditions)
    for each in planned.study.uncertainties:
        if each.key in map(space.key, space.default):
            raise InputError(f'uncertainty: {each.key} is one of the gains that are tuned')
    tuning = Tuning(planned, space, weighed, seed, replace(spent, units=planned.units))
    rule = _rule(patience, improvement, len(space.varied))
    if trials is None:
        trials = MOST_UNTIL if until_converged else min(PATIENCES * rule.patience, MOST_TRIALS)
    check('--trials', int, Field('', '', 1, MOST_TRIALS), trials)
    if pick is not None:
        check('--pick', int, Field('', '', 0, trials - 1), pick)
    processes, fields = Processes(worker_count(workers)), unit_of(tuning.law)
    with Store(directory, tuning.identity()) as store:
        found = run(tuning, store, trials, processes, rule if until_converged else None)
        points = front(found)
        if not points:
            reason = next(iter(infeasible(found)))
            raise RunError(f'all {len(found)} trials are infeasible, most of them: {reason}')
        chosen, why = choose(points, found[0], tuning.weights, pick, tuning.effort)
        result = Result(found, points, chosen, why, tuning.judge(found, rule))
        written = {each.name: each for each in output.write(tuning, store, fields, result)}
    doubted = doubts(space, tuning.law, chosen.gains, len(tuning.nominal['joints']))
    warnings = (*doubted, *at_ends(space, chosen.gains, fields))
    return Tuned(tuning, result, warnings, written)


def _effort(effort: str | None, chattering: float | None, pick: int | None) -> Effort:
    """The measure of effort and its limit."""
    if chattering is not None:
        if pick is not None:
            raise InputError('--chattering: not allowed with argument --pick')
        if effort is not None:
            raise InputError('--chattering is the same as --effort chattering=NM: give one')
        least = check('--chattering', float, Field('N m', '', 0.0), chattering)
        return Effort(trial.DEFAULT_EFFORT, least)
    found = Effort() if effort is None else trial.parse_effort(named('effort', effort))
    if found.limit is not None and pick is not None:
        raise InputError('--pick and a limit of --effort exclude each other')
    return found


def _rule(patience: int | None, improvement: float, gains: int) -> trial.Rule:
    """When the search of so many gains has converged."""
    given = trial.patience_for(gains) if patience is None else patience
    trials = check('--patience', int, Field('', '', 1, MOST_TRIALS), given)
    percent = check('--improvement', float, Field('%', '', 0.0, 100.0), improvement)
    return trial.Rule(trials, percent / 100.0)


def study_of(
    law: str,
    scenario: str,
    fixed: Mapping[str, Any],
    judge: Place | None = None,
    runs: int | None = None,
    seed: int | None = None,
    duration: float | None = None,
) -> Study:
    """The study of a law in a scenario alone, with the samples of another; see :func:`tune`.

    Raises:
        InputError: an option is wrong.
    """
    scenarios, laws = (scenario,), (Variant(law, law, {}),)
    if judge is not None:
        file = study_files.file_of(named('study', judge))
        given = study_files.parse(study_files.read(file), str(file), file.parent)
        asked = replace(given, scenarios=scenarios, laws=laws, scrambles=1)
        if seed is not None:
            asked = replace(asked, seed=check('--study-seed', int, SEEDS, seed))
    elif runs is not None:
        raise InputError('--runs are samples of the uncertainty of a --study')
    elif seed is not None:
        raise InputError('--study-seed is that of the samples of a --study')
    else:
        asked = Study(scenarios, laws, 1, 0, 'random', None, {}, ())
    if duration is not None:
        asked = replace(asked, duration=check('--duration', float, Field('s', '', 0.0), duration))
    return asked.changed(runs, fixed)


def _short(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
