"""The gains of a law, tuned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from parallel_robot.python import arguments
from parallel_robot.studies.tuning import tuned
from parallel_robot.studies.tuning.tuned import IMPROVEMENT, Asked, Tuned
from parallel_robot_model.common.errors import InputError
from parallel_robot_sim.scenario_run import changes, named


def tune(
    law: str | Path,
    scenario: str | Path,
    out: str | Path,
    *,
    study: str | Path | None = None,
    runs: int | None = None,
    study_seed: int | None = None,
    duration: float | None = None,
    trials: int | None = None,
    until_converged: bool = False,
    patience: int | None = None,
    improvement: float = IMPROVEMENT,
    seed: int = 0,
    weights: Mapping[str, float] | None = None,
    bounds: Mapping[str, Any] | None = None,
    search: Sequence[str] = (),
    break_conditions: bool = False,
    pick: int | None = None,
    effort: str | None = None,
    workers: int | None = None,
    param_file: str | Path | Iterable[str | Path] | None = None,
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
        law: The law, or its file.
        scenario: Name or file of a scenario.
        out: Directory of the results; new, or that of the same tuning, which is continued.
        study: Name or file of a study, of which uncertainty, samples, duration and values are
            taken; default: one exact run.
        runs: Samples; default: the study's.
        study_seed: Their seed; default: the study's.
        duration: Length of each run [s]; default: as of the study.
        trials: In total, at most; default: so many that the search can converge.
        until_converged: Whether it ends when the best has hardly improved for a while.
        patience: How many trials that is; default: by the number of gains.
        improvement: What is hardly an improvement [%].
        seed: Of the search.
        weights: Of ``error`` and of the measure of effort, e.g. ``{'error': 2, 'chattering': 1}``:
            one objective in place of a front.
        bounds: Gain to the ends between which it is searched, or to the value that it keeps.
        search: Keys that are searched beside the gains, e.g. ``estimator.bandwidth``.
        break_conditions: Whether gains may break a condition of the law, of which it warns.
        pick: Number of the trial of the front that is taken; default: its knee.
        effort: What the error is traded against, e.g. ``'torque_max'``; or with a limit,
            ``'chattering=2'``, within which the least error is taken.
        workers: Processes; default: one for each core.
        param_file: YAML file with keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values in all runs.

    Returns:
        The gains that are taken as keys of the configuration, ``values``; its ``trials()`` and
        ``front()`` as tables, and whether the search has converged, ``verdict``.

    Raises:
        InputError: something in the arguments is wrong, or the directory is of another tuning.
        RunError: workers cannot run it, all trials are infeasible, or the disk is full; finished
            trials are kept.
    """
    for what, mapping in (('weights', weights), ('bounds', bounds)):
        if mapping is not None and not isinstance(mapping, Mapping):
            raise InputError(f'{what} must be names and values, not {mapping!r}')
    if isinstance(search, str):
        raise InputError(f'search must be a list of keys, not {search!r}')
    asked = Asked(
        law=named('law', law),
        scenario=named('scenario', scenario),
        study=None if study is None else named('study', study),
        runs=runs,
        study_seed=study_seed,
        duration=duration,
        trials=trials,
        until_converged=until_converged,
        patience=patience,
        improvement=improvement,
        seed=seed,
        weights=None if weights is None else ','.join(f'{k}={v}' for k, v in weights.items()),
        bounds=[f'{gain}={_among(each)}' for gain, each in (bounds or {}).items()],
        search=search,
        break_conditions=break_conditions,
        pick=pick,
        effort=None if effort is None else named('effort', effort),
        workers=workers,
    )
    return tuned.tune(asked, changes(param_file, values), arguments.path('out', out))


def _among(given: Any) -> str:
    """Where a gain is searched, as the command has it."""
    return ':'.join(map(str, given)) if isinstance(given, tuple) else str(given)
