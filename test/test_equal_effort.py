"""benchmarks/equal_effort.py: laws at exactly one effort, and on robots of a sweep."""

import sys
from dataclasses import replace

import equal_effort
import numpy as np
import pandas
import pytest
import yaml
from test_fronts import tuning

import parallel_robot as pr
from parallel_robot.studies.tuning.front import read_front

pytest_plugins = ['sweeping']
STUDY = """scenarios: [paper_circle]
laws: [pid]
runs: 5
seed: {seed}
duration: 0.1
uncertainty:
  true_robot.m1: {{distribution: uniform, relative: 0.2}}
"""


def power(factor, exponent=-0.6, efforts=(0.1, 0.17, 0.41, 0.9)):
    """The table of a front on which error is a power of effort, in micrometres and N m."""
    rows = [
        f'{k},{int(k == 1)},{1e-6 * factor * effort**exponent},{effort},{k}.5'
        for k, effort in enumerate(reversed(efforts))
    ]
    return '\n'.join(['trial,chosen,xy_rms_m,chattering_nm,Kp', *rows, ''])


def test_a_power_law_is_interpolated_exactly_and_not_extrapolated(tmp_path):
    front = read_front(tuning(tmp_path, 'a', table=power(7.0)))
    for effort in (0.1, 0.3, 0.41, 0.9):
        assert equal_effort.error_at(front, effort) == pytest.approx(7e-6 * effort**-0.6)
    for effort in (0.0999, 0.9001):
        assert np.isnan(equal_effort.error_at(front, effort))
    worse = replace(front, points=((1.5, 8e-6), (0.1, 54e-6), (0.34, 55e-6)))  # on other robots
    assert 54e-6 < equal_effort.error_at(worse, 0.3) < 55e-6
    for end in ((np.inf, np.inf), (0.0, 1.0)):  # half of the runs failed; a robot at rest
        broken = replace(front, points=((0.2, 1e-5), end))
        assert np.isnan(equal_effort.error_at(broken, 0.1 if end[0] == 0.0 else 0.3))


def test_searches_of_a_law_are_one_row(tmp_path):
    tables = [*map(power, (4.0, 9.0, 5.0)), power(1.0, efforts=(0.4, 0.9))]  # which misses 0.3 N m
    found = [tuning(tmp_path, f'pid_{k}', table=table) for k, table in enumerate(tables)]
    found.append(tuning(tmp_path, 'smc_0', 'smc', power(6.0)))
    pid, smc = equal_effort.table([*map(read_front, found)], 0.3).rows
    shown = [f'{factor * 0.3**-0.6:.4g}' for factor in (5.0, 4.0, 9.0)]  # median, least, largest
    assert pid == ['pid', '3 of 4', *shown]
    assert smc == ['smc', '1 of 1', *[f'{6.0 * 0.3**-0.6:.4g}'] * 3]


@pytest.mark.usefixtures('inline', 'undrawn')
def test_on_robots_that_no_search_has_seen(tmp_path, capsys, monkeypatch):
    for name, seed in (('seen', 1), ('other', 2)):
        (tmp_path / f'{name}.yaml').write_text(STUDY.format(seed=seed))
    directory = tmp_path / 'smc'
    chosen = {'bounds': {'z': (10, 50)}, 'trials': 16, 'workers': 1}
    pr.tune('smc', 'paper_circle', directory, study=tmp_path / 'seen.yaml', **chosen)
    front = read_front(directory)
    limit = (front.points[0][0] * front.points[-1][0]) ** 0.5
    for base, reason in (('seen.yaml', 'has the seed 1 of'), ('laboratory_delta', 'no scenario')):
        with pytest.raises(pr.InputError, match=reason):
            equal_effort.study_of([front], limit, str(tmp_path / base if '.' in base else base))
    words = ['equal_effort.py', str(directory), '--effort', str(limit)]
    monkeypatch.setattr(sys, 'argv', [*words, '--study', str(tmp_path / 'other.yaml')])
    capsys.readouterr()
    equal_effort.main()
    judge = tmp_path / 'judge.yaml'
    judge.write_text(capsys.readouterr().out)
    pr.sweep(judge, tmp_path / 'swept', workers=1)
    runs = pandas.read_parquet(tmp_path / 'swept' / 'runs.parquet').groupby('law')
    medians = runs[['chattering_nm', 'xy_rms_m']].median()
    judged = equal_effort.judged(front, tmp_path / 'swept')
    assert sorted(judged.points) == sorted(map(tuple, medians.to_numpy().tolist()))
    laws = yaml.safe_load(judge.read_text())['laws']
    assert len(laws) == len(medians) and all(law['law'] == 'smc' for law in laws.values())
    gains = {f'smc@{number}': gains for number, gains in front.trials}
    assert all(law == {'law': 'smc', **gains[name]} for name, law in laws.items())
    monkeypatch.setattr(sys, 'argv', [*words, '--sweep', str(tmp_path / 'swept')])
    equal_effort.main()
    assert capsys.readouterr().out.splitlines()[1].split()[:4] == ['smc', '1', 'of', '1']
