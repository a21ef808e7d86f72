"""Laws at exactly one effort, from the fronts of their tunings or on the robots of a sweep.

Usage: python benchmarks/equal_effort.py TUNING... --effort VALUE [--study STUDY | --sweep DIR]

The error is interpolated in logarithms between the two nearest trials that enclose the effort;
searches of a law are one row. `--study` prints a study of the trials around the effort on the
samples of another study; with `--sweep` of that one, its medians take the place of the searches'.
"""

from __future__ import annotations

import argparse
import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas
import yaml

from parallel_robot.studies.sweep import study
from parallel_robot.studies.tuning.front import Front, check_fronts, read_front
from parallel_robot_model.common import tables
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.tables import Table
from parallel_robot_model.configuration.config_files import is_scenario_path, scenario_stem

STEPS = (0.64, 0.8, 1.0, 1.25, 1.5625)  # times the effort: near each of these a trial is taken


def study_of(fronts: Sequence[Front], effort: float, base: str) -> str:
    """A study of the trials around an effort, on the samples of another one."""
    file = study.file_of(base)
    judge = study.parse(study.read(file), str(file), file.parent)
    scenario = scenario_stem(str(fronts[0].manifest['scenario']))
    scenarios = [each for each in judge.scenarios if scenario_stem(each) == scenario]
    if not scenarios:
        raise InputError(f'{base} has no scenario {scenario}, that of the tunings')
    uncertainty = fronts[0].manifest.get('uncertainty')  # seed, method, uncertain parameters
    if isinstance(uncertainty, list) and uncertainty[0] == str(judge.seed):
        raise InputError(f'{base} has the seed {judge.seed} of the searches; give another one')
    laws = {
        f'{front.name}@{front.trials[k][0]}': {'law': front.law, **front.trials[k][1]}
        for front in fronts
        for k in sorted(_around(front, effort))
    }
    own = {'base': str(file.resolve()) if is_scenario_path(base) else base, 'scenarios': scenarios}
    return yaml.safe_dump({**own, 'laws': laws}, sort_keys=False, allow_unicode=True)


def _around(front: Front, effort: float) -> set[int]:
    """Indices of the trials of a study: some enclose the effort on other robots, too."""
    shares = np.array([spent / effort for spent, _ in front.points])  # falling
    above, below = np.flatnonzero(shares >= STEPS[-1]), np.flatnonzero(shares <= STEPS[0])
    near = [int(np.argmin(np.abs(np.log(shares / step)))) for step in STEPS]
    return {front.chosen, *near, *above[-1:].tolist(), *below[:1].tolist()}


def judged(front: Front, sweep: Path) -> Front:
    """The front of those trials that a sweep of the study has run, with its medians."""
    runs = pandas.read_parquet(sweep / 'runs.parquet')
    columns = [front.effort.key, front.error.key]
    runs.loc[runs.status != 'ok', columns] = math.inf
    medians = runs.groupby('law')[columns].median()
    names = [f'{front.name}@{number}' for number, _ in front.trials]
    own = medians.loc[[name for name in names if name in medians.index]]
    return replace(front, points=tuple(own.itertuples(index=False, name=None)))


def error_at(front: Front, effort: float) -> float:
    """The error of a front at an effort; NaN where no two points with a figure enclose it."""
    for (below, most), (above, least) in pairwise(sorted(front.points)):
        known = min(below, most, least) > 0.0 and max(above, most, least) < math.inf
        if known and below <= effort <= above:
            share = math.log(effort / below) / math.log(above / below) if below < above else 0.0
            return most * (least / most) ** share
    return math.nan


def table(fronts: Sequence[Front], effort: float) -> Table:
    """Median, least and largest error of the searches of each law."""
    error, searches = fronts[0].error, dict[str, list[float]]()
    for front in fronts:
        searches.setdefault(front.law, []).append(error_at(front, effort))
    rows = []
    for law, errors in searches.items():
        known = [error.scale * each for each in errors if each == each]
        figures = (statistics.median(known), min(known), max(known)) if known else ()
        shown = [f'{each:.4g}' for each in figures] or ['', '', '']
        rows.append([law, f'{len(known)} of {len(errors)}', *shown])
    heads = [f'{what} [{error.unit}]' for what in ('median', 'least', 'largest')]
    return Table(['law', 'searches', *heads], rows, 'lr')


def main() -> None:
    """Print the table, or the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('tunings', type=Path, nargs='+', help='results of `tune`')
    parser.add_argument('--effort', type=float, required=True, help='unit of its column')
    parser.add_argument('--study', help='print this study with the trials around the effort')
    parser.add_argument('--sweep', type=Path, help='results of a `sweep` of that study')
    words = parser.parse_args()
    fronts = [read_front(directory) for directory in words.tunings]
    check_fronts(fronts)
    if words.study:
        print(study_of(fronts, words.effort, words.study), end='')
        return
    if words.sweep:
        fronts = [judged(front, words.sweep) for front in fronts]
    print(tables.text([table(fronts, words.effort)]))


if __name__ == '__main__':
    main()
