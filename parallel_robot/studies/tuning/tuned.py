"""A tuning from what it is asked for to its files, and what came of it in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from parallel_robot.studies.sweep.workers import Processes
from parallel_robot.studies.tuning import output
from parallel_robot.studies.tuning.asked import Asked
from parallel_robot.studies.tuning.front import choose, front
from parallel_robot.studies.tuning.output import Result
from parallel_robot.studies.tuning.space import at_ends, doubts, unit_of
from parallel_robot.studies.tuning.store import Store
from parallel_robot.studies.tuning.trial import Verdict, library
from parallel_robot.studies.tuning.tune import Tuning, infeasible, run
from parallel_robot_control import law_loader
from parallel_robot_model.common.errors import Frame, RunError, pandas
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.configuration.plain_data import merged

REASONS = 3  # most frequent reasons of infeasible trials to report


@dataclass(frozen=True, repr=False)
class Tuned(ShownResult):
    """A tuning that has ended.

    Attributes:
        tuning: What was tuned, and how.
        result: What came of it.
        warnings: What to doubt of the gains that are taken, one line each.
        files: Its files, by name.
    """

    tuning: Tuning
    result: Result
    warnings: tuple[str, ...]
    files: Mapping[str, Path]

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
        columns = tuning.error.column, tuning.effort.quantity.column
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
    count, workers = asked.count(rule), Processes(asked.processes())
    fields = unit_of(tuning.law)
    with Store(out, tuning.space, tuning.identity()) as store:
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
