"""A tuning from what it is asked for to its files, and what came of it in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from parallel_robot.studies.sweep import study
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
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.configuration.plain_data import merged

# What a tuning is asked for, by the options of the command, and what follows.

PATIENCES = 2  # that a search takes unless told: it can show that it has converged
MOST_UNTIL = 2000  # trials of a search until it has converged
IMPROVEMENT = 2.0  # percent
MOST_TRIALS = 100_000
SEEDS = Field('', '', 0, 2**63 - 1)


@dataclass(frozen=True)
class Asked:
    """The options of a tuning, as the command has them; see ``parallel_robot tune --help``."""

    law: str
    scenario: str
    study: str | None = None
    runs: int | None = None
    study_seed: int | None = None
    duration: float | None = None
    trials: int | None = None
    until_converged: bool = False
    patience: int | None = None
    improvement: float = IMPROVEMENT
    seed: int = 0
    weights: str | None = None
    bounds: Sequence[str] = ()
    search: Sequence[str] = ()
    break_conditions: bool = False
    pick: int | None = None
    chattering: float | None = None
    effort: str | None = None
    workers: int | None = None

    def tuning(self, fixed: Mapping[str, Any]) -> Tuning:
        """What is tuned, and how.

        Args:
            fixed: Keys of the configuration and their values in all runs.

        Raises:
            InputError: an option is wrong.
        """
        law, spent = self.law, self._effort()
        asked = None
        if self.weights is not None:
            asked = trial.parse_weights(self.weights, spent.measure)
        seed = check('--seed', int, SEEDS, self.seed)
        custom = {key: fixed[key] for key in config.CUSTOM if key in fixed}
        known = available(resolve(self.scenario, custom)['custom_laws'])
        if law not in known:
            raise UnknownNameError('law', law, known)
        found = plan(self.varied(fixed))
        nominal, keep = found.cases[0].nominal, not self.break_conditions
        space = space_of(law, known[law], nominal, self.bounds, self.search, keep)
        for each in found.study.uncertainties:
            if each.key in map(space.key, space.default):
                raise InputError(f'uncertainty: {each.key} is one of the gains that are tuned')
        return Tuning(found, space, asked, seed, replace(spent, units=found.units))

    def rule(self, tuning: Tuning) -> trial.Rule:
        """When the search has converged.

        Raises:
            InputError: an option is wrong.
        """
        patience = self.patience
        if patience is None:
            patience = trial.patience_for(len(tuning.space.varied))
        patience = check('--patience', int, Field('', '', 1, MOST_TRIALS), patience)
        percent = check('--improvement', float, Field('%', '', 0.0, 100.0), self.improvement)
        return trial.Rule(patience, percent / 100.0)

    def count(self, rule: trial.Rule) -> int:
        """How many trials are made at most.

        Raises:
            InputError: an option is wrong.
        """
        trials = self.trials
        if trials is None:
            usual = min(PATIENCES * rule.patience, MOST_TRIALS)
            trials = MOST_UNTIL if self.until_converged else usual
        trials = check('--trials', int, Field('', '', 1, MOST_TRIALS), trials)
        if self.pick is not None:
            check('--pick', int, Field('', '', 0, trials - 1), self.pick)
        return trials

    def varied(self, fixed: Mapping[str, Any]) -> Study:
        """The study of the law in the scenario alone.

        Raises:
            InputError: an option is wrong.
        """
        scenarios, laws = (self.scenario,), (Variant(self.law, self.law, {}),)
        if self.study is not None:
            file = study.file_of(self.study)
            given = study.parse(study.read(file), str(file), file.parent)
            asked = replace(given, scenarios=scenarios, laws=laws, scrambles=1)
            if self.study_seed is not None:
                seed = check('--study-seed', int, SEEDS, self.study_seed)
                asked = replace(asked, seed=seed)
        elif self.runs is not None:
            raise InputError('--runs are samples of the uncertainty of a --study')
        elif self.study_seed is not None:
            raise InputError('--study-seed is that of the samples of a --study')
        else:
            asked = Study(scenarios, laws, 1, 0, 'random', None, {}, ())
        if self.duration is not None:
            seconds = check('--duration', float, Field('s', '', 0.0), self.duration)
            asked = replace(asked, duration=seconds)
        return asked.changed(self.runs, fixed)

    def _effort(self) -> Effort:
        """The measure of effort and its limit."""
        if self.chattering is not None:
            if self.effort is not None:
                raise InputError('--chattering is the same as --effort chattering=NM: give one')
            least = check('--chattering', float, Field('N m', '', 0.0), self.chattering)
            return Effort(trial.DEFAULT_EFFORT, least)
        found = Effort() if self.effort is None else trial.parse_effort(self.effort)
        if found.limit is not None and self.pick is not None:
            raise InputError('--pick and a limit of --effort exclude each other')
        return found


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


def tune(asked: Asked, fixed: Mapping[str, Any], out: Path) -> Tuned:
    """Tune a law, or what is left of it.

    Args:
        asked: The options; its law may be a file.
        fixed: Keys of the configuration and their values in all runs.
        out: Directory of the results; new, or that of the same tuning, which is continued.

    Raises:
        InputError: an option is wrong, or the directory is of another tuning.
        RunError: workers cannot run it, all trials are infeasible, or the disk is full; finished
            trials are kept.
    """
    library()
    files = law_loader.files_of([asked.law], fixed)
    tuning = replace(asked, law=law_loader.name_of(asked.law)).tuning(merged([fixed, files]))
    rule = asked.rule(tuning)
    count, workers = asked.count(rule), Processes(worker_count(asked.workers, '--workers'))
    fields = unit_of(tuning.law)
    with Store(out, tuning.identity()) as store:
        found = run(tuning, store, count, workers, rule if asked.until_converged else None)
        points = front(found)
        if not points:
            reason = next(iter(infeasible(found)))
            raise RunError(f'all {len(found)} trials are infeasible, most of them: {reason}')
        chosen, why = choose(points, found[0], tuning.weights, asked.pick, tuning.effort)
        result = Result(found, points, chosen, why, tuning.judge(found, rule))
        written = {path.name: path for path in output.write(tuning, store, fields, result)}
    joints = len(tuning.nominal['joints'])
    doubted = doubts(tuning.space, tuning.law, chosen.gains, joints)
    warnings = (*doubted, *at_ends(tuning.space, chosen.gains, fields))
    return Tuned(tuning, result, warnings, written)


def _short(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
