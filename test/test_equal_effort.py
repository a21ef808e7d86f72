"""`parallel_robot fronts --effort`: laws at exactly one effort, and on robots of a sweep."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas
import pytest
import yaml
from test_fronts import tuning

import parallel_robot as pr
from parallel_robot.cli.command_line import main
from parallel_robot.studies.tuning import front as fronts
from parallel_robot.studies.tuning import held_out

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
    front = fronts.read_front(tuning(tmp_path, 'a', table=power(7.0)))
    for effort in (0.1, 0.3, 0.41, 0.9):
        assert held_out.error_at(front, effort) == pytest.approx(7e-6 * effort**-0.6)
    for effort in (0.0999, 0.9001):
        assert np.isnan(held_out.error_at(front, effort))
    worse = replace(front, points=((1.5, 8e-6), (0.1, 54e-6), (0.34, 55e-6)))  # on other robots
    assert 54e-6 < held_out.error_at(worse, 0.3) < 55e-6
    for end in ((np.inf, np.inf), (0.0, 1.0)):  # half of the runs failed; a robot at rest
        broken = replace(front, points=((0.2, 1e-5), end))
        assert np.isnan(held_out.error_at(broken, 0.1 if end[0] == 0.0 else 0.3))


def searches(folder, factors=(4.0, 9.0, 5.0), **manifest):
    """Searches of PID with several seeds, one of which does not reach 0.3 N m, and one of SMC."""
    tables = [*map(power, factors), power(1.0, efforts=(0.4, 0.9))]
    found = [
        tuning(folder, f'pid_{seed}', table=table, seed=seed, **manifest)
        for seed, table in enumerate(tables)
    ]
    return [*found, tuning(folder, 'smc_0', 'smc', power(6.0), seed=0)]


def test_searches_of_a_law_are_one_row(tmp_path, capsys):
    words = ['fronts', *map(str, searches(tmp_path)), '--effort', 'chattering=0.3', '--out']
    assert main([*words, str(tmp_path / 'all.svg')]) == 0
    lines = capsys.readouterr().out.splitlines()
    pid, smc = (re.split(r'\s{2,}', line.strip()) for line in lines[2:4])
    shown = [f'{factor * 0.3**-0.6:.4g}' for factor in (5.0, 4.0, 9.0)]  # median, least, largest
    assert pid == ['pid_0', 'pid', '3 of 4', *shown]
    assert smc == ['smc_0', 'smc', '1 of 1', *[f'{6.0 * 0.3**-0.6:.4g}'] * 3]
    assert lines[4] == 'pid_3 is left out: its front, from 0.4 to 0.9 N m, misses 0.3 N m'
    assert main([*words, str(tmp_path / 'again.svg'), '--format', 'json']) == 0
    first, _ = json.loads(capsys.readouterr().out)
    assert first['fronts'].pop('pid_3') is None
    expected = [1e-6 * factor * 0.3**-0.6 for factor in (4.0, 9.0, 5.0)]
    assert [*first['fronts'].values()] == pytest.approx(expected)
    assert first['median xy_rms_m'] == pytest.approx(expected[2])


def test_searches_in_different_spaces_are_different_rows(tmp_path):
    narrow, wide = (
        fronts.read_front(tuning(tmp_path, name, seed=0, **{'search space': {'Kp': name}}))
        for name in ('narrow', 'wide')
    )
    assert [len(each.fronts) for each in held_out.laws_at_effort([narrow, wide], 0.5)] == [1, 1]


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('--effort', 'torque_max=3'), 'must be chattering=VALUE, as the tunings have it'),
        (('--effort', 'chattering'), "must be chattering=VALUE, as the tunings have it, not 'ch"),
        (('--effort', 'chattering=0'), 'must be a positive number'),
        (('--effort', 'chattering=0.3', '--study', 'laboratory'), 'must end with .yaml or .yml'),
        (('--effort', 'chattering=0.3', '--sweep', '{tmp}'), 'is not the directory of a sweep'),
    ],
)
def test_what_has_no_meaning_is_one_line(words, message, tmp_path, capsys):
    given = [*map(str, searches(tmp_path)), *(word.format(tmp=tmp_path) for word in words)]
    assert main(['fronts', *given, '--out', str(tmp_path / 'all.svg')]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1
    assert not (tmp_path / 'all.svg').exists()


def test_a_search_counts_once_and_has_a_name_of_its_own(tmp_path):
    first = tuning(tmp_path, 'a', table=power(4.0), seed=3)
    with pytest.raises(pr.InputError, match='are one search, with seed 3'):
        pr.fronts([first, first], tmp_path / 'out.svg', effort='chattering=0.3')
    (tmp_path / 'b').mkdir()
    other = tuning(tmp_path / 'b', 'a', table=power(5.0), seed=4)
    chosen = {'effort': 'chattering=0.3', 'study': 'laboratory'}
    with pytest.raises(pr.InputError, match='two tunings are called a; rename'):
        pr.fronts([first, other], tmp_path / 'out.yaml', **chosen)
    odd = tuning(tmp_path, 'odd: {name}', table=power(5.0), seed=4, uncertainty=3)
    found = yaml.safe_load(pr.fronts([odd], tmp_path / 'odd.yaml', **chosen).out.read_text())
    # Of 0.9, 0.41, 0.17 and 0.1 N m: the nearest and the first beyond 0.64 and 1.56 times 0.3.
    assert sorted(found['laws']) == ['odd: {name}@0', 'odd: {name}@1', 'odd: {name}@2']
    with pytest.raises(pr.InputError, match='--study needs --effort'):
        pr.fronts([first], tmp_path / 'out.yaml', study='laboratory')
    with pytest.raises(pr.InputError, match='laboratory_delta has no scenario paper_circle'):
        pr.fronts([first], tmp_path / 'out.yaml', **{**chosen, 'study': 'laboratory_delta'})
    assert not (tmp_path / 'out.yaml').exists()


@pytest.mark.usefixtures('inline', 'undrawn')
def test_on_robots_that_no_search_has_seen(tmp_path, capsys):
    for name, seed in (('seen', 1), ('other', 2)):
        (tmp_path / f'{name}.yaml').write_text(STUDY.format(seed=seed))
    directory = tmp_path / 'smc'
    chosen = {'bounds': {'z': (10, 50)}, 'trials': 16, 'workers': 1}
    pr.tune('smc', 'paper_circle', directory, study=tmp_path / 'seen.yaml', **chosen)
    low, high = (end(pandas.read_csv(directory / 'front.csv').chattering_nm) for end in (min, max))
    limit = f'chattering={(low * high) ** 0.5}'
    words = ['fronts', str(directory), '--effort', limit, '--study']
    out = tmp_path / 'judge.yaml'
    assert main([*words, str(tmp_path / 'seen.yaml'), '--out', str(out)]) == 2
    assert 'has the seed 1 of the searches' in capsys.readouterr().err
    assert main([*words, str(tmp_path / 'other.yaml'), '--out', str(out)]) == 0
    laws = yaml.safe_load(out.read_text())['laws']
    swept = tmp_path / 'swept'
    assert main(['sweep', str(out), '--out', str(swept), '--workers', '1']) == 0
    found = pr.fronts([directory], tmp_path / 'a.svg', effort=limit, sweep=swept)
    runs = pandas.read_parquet(swept / 'runs.parquet').groupby('law')
    medians = runs[['chattering_nm', 'xy_rms_m']].median()
    (front,) = found.fronts
    numbers = [int(name.removeprefix('smc@')) for name in laws]
    assert sorted(number for number, _ in front.trials) == sorted(numbers)
    for (number, gains), point in zip(front.trials, front.points, strict=True):
        assert laws[f'smc@{number}'] == {'law': 'smc', **gains}
        assert point == pytest.approx(tuple(medians.loc[f'smc@{number}']), rel=1e-12)
    text = (directory / 'front.csv').read_text()
    (directory / 'front.csv').write_text(text.replace('\n', '1\n').replace('u1\n', 'u\n', 1))
    with pytest.raises(pr.InputError, match='is not that trial of'):
        pr.fronts([directory], tmp_path / 'b.svg', effort=limit, sweep=swept)
    (swept / 'runs.parquet').unlink()
    with pytest.raises(pr.InputError, match='has not ended'):
        pr.fronts([directory], tmp_path / 'b.svg', effort=limit, sweep=swept)
