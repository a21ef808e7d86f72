"""What a tuning is asked for, by the options of the command, and what follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.plan import plan
from parallel_robot.studies.sweep.study import Study, Variant
from parallel_robot.studies.sweep.sweep import MOST_WORKERS, default_workers
from parallel_robot.studies.tuning import trial
from parallel_robot.studies.tuning.space import space_of
from parallel_robot.studies.tuning.trial import Effort
from parallel_robot.studies.tuning.tune import Tuning
from parallel_robot_control.configuration import available, resolve
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import Field, check

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

    def processes(self) -> int:
        """How many processes run them.

        Raises:
            InputError: the option is wrong.
        """
        workers = default_workers() if self.workers is None else self.workers
        count: int = check('--workers', int, Field('', '', 1, MOST_WORKERS), workers)
        return count

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
