"""Trials around an effort as the laws of a study, and the fronts that its sweep makes of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.store import RUNS, STUDY, arrow, manifest_of
from parallel_robot.studies.tuning.front import Front
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.config_files import is_scenario_path, scenario_stem

STEPS = (0.64, 0.8, 1.0, 1.25, 1.5625)  # times the effort: near each of these a trial is taken


def study_of(fronts: Sequence[Front], effort: float, base: str) -> str:
    """The text of a study of trials around an effort, and of those that were taken.

    Args:
        fronts: The fronts, which can be compared.
        effort: The effort [unit of its column].
        base: Name or file of the study whose samples judge them.

    Raises:
        InputError: the study cannot be read, has another scenario or the samples of the searches,
            or two fronts have the same name.
    """
    file = study.file_of(base)
    judge = study.parse(study.read(file), str(file), file.parent)
    scenario = scenario_stem(str(fronts[0].manifest['scenario']))
    scenarios = [each for each in judge.scenarios if scenario_stem(each) == scenario]
    if not scenarios:
        raise InputError(f'--study: {base} has no scenario {scenario}, that of the tunings')
    told = fronts[0].manifest.get('uncertainty')  # seed, method, uncertain parameters
    if isinstance(told, list) and told[:1] == [str(judge.seed)] and told[-1] != '[]':
        what = f'{base} has the seed {judge.seed} of the searches, which have seen its samples'
        raise InputError(f'--study: {what}; give one with another seed')
    laws: dict[str, dict[str, object]] = {}
    for front in fronts:
        for name, k in _named(front):
            if k in _around(front, effort):
                if name in laws:
                    raise InputError(f'two tunings are called {front.name}; rename a directory')
                laws[name] = {'law': front.law, **front.trials[k][1]}
    own = {'base': str(file.resolve()) if is_scenario_path(base) else base, 'scenarios': scenarios}
    return yaml.safe_dump({**own, 'laws': laws}, sort_keys=False, allow_unicode=True)


def judged(fronts: Sequence[Front], directory: Path) -> list[Front]:
    """The fronts of those trials that a sweep has run, with its medians.

    Args:
        fronts: The fronts, which can be compared.
        directory: That of a sweep of the study by :func:`study_of`.

    Raises:
        InputError: it is not, or has not ended.
    """
    manifest_of(directory)
    parsed = study.parse(study.read(directory / STUDY), str(directory / STUDY))
    variants = {variant.name: variant for variant in parsed.laws}
    columns = [fronts[0].effort.column, fronts[0].error.column]
    try:
        table = arrow().parquet.read_table(
            directory / RUNS,
            columns=['law', 'status', *columns],
            filters=[('scenario', '=', scenario_stem(str(fronts[0].manifest['scenario'])))],
            partitioning=None,
        )
        law, status, *figures = (table[each].to_numpy() for each in ('law', 'status', *columns))
        spent, error = (np.where(status == 'ok', each, math.inf) for each in figures)
    except (OSError, ValueError, KeyError):
        raise InputError(
            f'the sweep in {directory} has not ended, or is of other robots'
        ) from None
    found = []
    for front in fronts:
        points = {}
        for name, k in _named(front):
            if name in variants:
                variant, (_, gains) = variants[name], front.trials[k]
                theirs = {key.removeprefix(f'{front.law}.'): v for key, v in variant.gains.items()}
                if (variant.law, theirs) != (front.law, gains):
                    raise InputError(f'{directory}: {name} is not that trial of {front.directory}')
                mine = law == name
                points[k] = float(np.median(spent[mine])), float(np.median(error[mine]))
        if front.chosen not in points:
            raise InputError(f'{directory} is no sweep of the trials of {front.directory}')
        order = sorted(points, key=lambda k: points[k][::-1])
        found.append(
            replace(
                front,
                points=tuple(points[k] for k in order),
                trials=tuple(front.trials[k] for k in order),
                chosen=order.index(front.chosen),
            )
        )
    return found


def _named(front: Front) -> Iterator[tuple[str, int]]:
    """What a study calls each trial of a front, and its index."""
    for k, (number, _) in enumerate(front.trials):
        yield f'{front.name}@{number}', k


def _around(front: Front, effort: float) -> set[int]:
    """Indices of the trials that a study has: some enclose the effort on other robots, too."""
    shares = np.array([spent / effort for spent, _ in front.points])  # falling
    above, below = np.flatnonzero(shares >= STEPS[-1]), np.flatnonzero(shares <= STEPS[0])
    with np.errstate(divide='ignore'):
        near = [int(np.argmin(np.abs(np.log(shares / step)))) for step in STEPS]
    return {front.chosen, *near, *above[-1:].tolist(), *below[:1].tolist()}
